"""Repeats of many points, told: scatter of the tip and of every joint."""

from __future__ import annotations

from functools import partial

from suta_calib.analysis.repeatability import JointRepeats, RepeatedTouches, joints_rms
from suta_calib.report.document import Figure, Part
from suta_calib.report.listing import Column, Json, Listing
from suta_calib.report.repeatability_plots import touches_plot
from suta_calib.units import Unit, shown, text, unit_name


def _unit(each: JointRepeats) -> Unit:
    return each.unit


def _joints(confidence: float) -> Listing[JointRepeats]:
    return Listing(
        "Repeatability of the joints",
        Column("joint", "joint"),
        Column("std", "std", lambda each: each.std.value, _unit),
        Column("std_interval", None, lambda each: each.std.interval(confidence).ends, _unit),
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
        Column("points", value=lambda found: len(found.points)),
        Column("confidence_pct", value=lambda found: 100 * found.confidence),
        Column("rms", value=lambda found: found.rms.value, unit="m"),
        Column("rms_interval", value=lambda found: found.rms.interval(confidence).ends, unit="m"),
        Column(
            "rms_of_others",
            value=lambda found: found.rms_of_others and found.rms_of_others.value,
            unit="m",
        ),
        Column("elsewhere"),
    )


def touches_parts(found: RepeatedTouches) -> list[Part]:
    """A table and a picture of the joints; the sentence of the assessment tells the tip."""
    unit = " or ".join(sorted({unit_name(each.unit) for each in found.joints}))
    overall = joints_rms(found.joints)
    said = "" if overall is None else f"; RMS over joints {text(overall, 'rad')} deg"
    joints = _joints(found.confidence)
    title = f"{joints.title} among repeats of a touch, {unit}, peak to peak per point{said}"
    return [Figure(partial(touches_plot, found)), joints.of(found.joints, title)]


def touches_data(found: RepeatedTouches) -> Json:
    """For JSON."""
    overall = joints_rms(found.joints)
    return {
        **_touches(found.confidence).record(found),
        "joints": _joints(found.confidence).records(found.joints),
        "joints_rms_deg": None if overall is None else float(shown(overall, "rad")),
    }
