"""Repeats of many points, told: scatter of the tip and of every joint."""

from __future__ import annotations

from functools import partial

from suta_calib.analysis.repeatability import JointRepeats, RepeatedTouches, joints_rms
from suta_calib.report.document import Figure, Part
from suta_calib.report.listing import Column, Json, Listing
from suta_calib.report.repeatability_plots import touches_plot
from suta_calib.units import Unit, shown, text, unit_name


def _unit(joint: JointRepeats) -> Unit:
    return joint.unit


def _joints(confidence: float) -> Listing[JointRepeats]:
    return Listing(
        "Repeatability of the joints",
        Column("joint", "joint"),
        Column("std", "std", lambda row: row.std.value, _unit),
        Column("std_interval", None, lambda row: row.std.interval(confidence).ends, _unit),
        Column("peak_to_peak", "peak to peak", unit=_unit),
        Column("largest", "largest", unit=_unit),
        Column("largest_at", "at"),
        Column("tip", "tip, mm", unit="m"),
        named=True,
    )


def _touches(confidence: float) -> Listing[RepeatedTouches]:
    return Listing(
        "",
        Column("touches"),
        Column("points", value=lambda row: len(row.points)),
        Column("confidence_pct", value=lambda row: 100 * row.confidence),
        Column("rms", value=lambda row: row.rms.value, unit="m"),
        Column("rms_interval", value=lambda row: row.rms.interval(confidence).ends, unit="m"),
        Column(
            "rms_of_others",
            value=lambda row: row.rms_of_others and row.rms_of_others.value,
            unit="m",
        ),
        Column("elsewhere"),
    )


def touches_parts(touches: RepeatedTouches) -> list[Part]:
    """A table and a picture of the joints; the sentence of the assessment tells the tip."""
    unit = " or ".join(sorted({unit_name(joint.unit) for joint in touches.joints}))
    overall = joints_rms(touches.joints)
    over_joints = "" if overall is None else f"; RMS over joints {text(overall, 'rad')} deg"
    joints = _joints(touches.confidence)
    title = f"{joints.title} among repeats of a touch, {unit}, peak to peak per point{over_joints}"
    return [Figure(partial(touches_plot, touches)), joints.of(touches.joints, title)]


def touches_data(touches: RepeatedTouches) -> Json:
    """For JSON."""
    overall = joints_rms(touches.joints)
    return {
        **_touches(touches.confidence).record(touches),
        "joints": _joints(touches.confidence).records(touches.joints),
        "joints_rms_deg": None if overall is None else float(shown(overall, "rad")),
    }
