"""Report of a recorded motion against a reference: errors, latency, and errors at reversals."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import homogeneous
from suta_calib.plotting.look import BLUE, GREY, LARGE, ORANGE
from suta_calib.report.document import Document, Figure, Part, Text
from suta_calib.report.listing import Column, Json, Listing, shown_as, written
from suta_calib.report.poses import pose_record
from suta_calib.report.svg import picture, svg_text
from suta_calib.tracking.path_accuracy import UPDATE_RATES, MotionQuarter, PathAccuracy
from suta_calib.tracking.record_faults import RecordFault
from suta_calib.tracking.reversals import ChannelReversals
from suta_calib.units import NOTHING, Unit, mm, ms, shown, unit_name, with_std

# Of its picture too: what the command was called at first.
NAME: Final = "dynamics"


# One way to look at the error: its key and name, its unit, and its sizes (n,), m or rad.
ErrorKind = tuple[str, str, Unit, FloatArray]


def _error_unit(errors: ErrorKind) -> Unit:
    return errors[2]


ERRORS: Final = Listing[ErrorKind](
    "Distance from the reference",
    Column("", "", lambda row: f"{row[1]}, {unit_name(row[2])}"),
    Column("rms", "RMS", lambda row: np.sqrt(np.mean(row[3] ** 2)), _error_unit),
    Column("mean", "mean", lambda row: row[3].mean(), _error_unit),
    Column("p95", "95 %", lambda row: np.percentile(row[3], 95), _error_unit),
    Column("max", "max", lambda row: row[3].max(), _error_unit),
    Column("count", None, lambda row: len(row[3])),
)


def _by_motion(title: str, key: str, unit: str) -> Listing[MotionQuarter]:
    """Errors by speed or acceleration, in SI: that is what people state them in."""
    return Listing(
        title,
        shown_as(f"from to, {unit}", lambda row: f"{row.low:.3f} to {row.high:.3f}"),
        Column(f"{key}_low", None, lambda row: row.low),
        Column(f"{key}_high", None, lambda row: row.high),
        Column("rms_same_time", "at the same time", unit="m"),
        Column("rms", "latency removed", unit="m"),
        Column("std", "± std", unit="m"),
    )


SPEEDS: Final = _by_motion(
    "Distance by speed, mm RMS, each class a quarter of the rows", "speed_m_s", "m/s"
)
ACCELERATIONS: Final = _by_motion(
    "Distance by acceleration, mm RMS, each class a quarter of the rows",
    "acceleration_m_s2",
    "m/s²",
)
# Rate in Hz, and how far the motion gets ahead of the last pose.
RATES: Final = Listing[tuple[float, float]](
    "Distance moved since the last pose, by update rate",
    Column("rate_hz", "Hz", lambda row: row[0], form=".0f"),
    Column("rms", "RMS, mm", lambda row: row[1], "m"),
)
# What happens where one joint or axis turns back, its hysteresis and that one's standard
# uncertainty; NaN where they are not known.
Reversals = tuple[ChannelReversals, float, float]


def _joint_unit(reversals: Reversals) -> Unit:
    return reversals[0].channel.unit


def _hysteresis_text(reversals: Reversals) -> str:
    _, hysteresis, std = reversals
    if math.isnan(hysteresis):
        return NOTHING
    unit = _joint_unit(reversals)
    return with_std(hysteresis, std, unit)


AXES: Final = Listing[Reversals](
    "Error at reversals of the motion, mm RMS",
    Column("name", "axis", lambda row: row[0].channel.name),
    Column("count", "times", lambda row: len(row[0].reversals), form="d"),
    Column("error_before", "before", lambda row: row[0].error_before, "m"),
    Column("error_after", "after", lambda row: row[0].error_after, "m"),
    Column("jump", "jump", lambda row: row[0].jump, "m"),
)
JOINTS: Final = Listing[Reversals](
    AXES.title,
    replace(AXES.columns[0], heading="joint"),
    *AXES.columns[1:],
    Column("hysteresis", "hysteresis", lambda row: row[1], _joint_unit, cell=_hysteresis_text),
    Column("hysteresis_std", value=lambda row: row[2], unit=_joint_unit),
)


def _fault_unit(fault: RecordFault) -> Unit:
    return fault.unit


# Written only: the notes of the assessment contain them.
FAULTS: Final = Listing[RecordFault](
    "Errors of the record itself",
    *written("kind", "first", "last"),
    *written("since", "until", unit="s"),
    Column("count"),
    *written("size", "std", unit=_fault_unit),
    Column("explained"),
    Column("rms", unit="m"),
    Column("latency_ms", value=lambda row: ms(row.latency)),
    Column("spoils"),
)


def path_accuracy_document(accuracy: PathAccuracy) -> Document:
    """Latency, errors, what happens where joints turn back, and the transform if one was found.

    In JSON ``errors`` has ``same_time`` (recorded minus reference at one time),
    ``latency_removed``, ``path`` (the part of it across the motion) and, with orientations,
    ``orientation``; ``faults`` has what the record itself got wrong, and ``rms`` and ``latency``
    without that.
    """
    alignment = accuracy.alignment
    same_time, aligned = np.linalg.norm([accuracy.error_same_time, accuracy.error], axis=2)
    errors: list[ErrorKind] = [
        ("same_time", "at the same time", "m", same_time),
        ("latency_removed", "latency removed", "m", aligned),
        ("path", "across the path", "m", accuracy.path_error),
    ]
    if accuracy.angle_error is not None:
        errors.append(("orientation", "orientation", "rad", accuracy.angle_error))
    reversals = JOINTS if accuracy.per == "joint" else AXES
    unknown = (math.nan, math.nan)
    rows = [
        (reversal, *accuracy.hysteresis.get(reversal.channel.name, unknown))
        for reversal in accuracy.reversals
    ]
    rates = [(rate, accuracy.staleness(rate)) for rate in UPDATE_RATES]
    late = "later" if alignment.latency >= 0 else "earlier"
    latency = (
        f"Latency {ms(alignment.latency):.3f} ± {ms(alignment.latency_std):.3f} ms: the "
        f"recording comes {late} than the reference ({len(accuracy.time)} rows, "
        f"{accuracy.time[-1] - accuracy.time[0]:.1f} s)"
    )
    parts: list[Part] = [
        Text(latency),
        ERRORS.of(errors),
        SPEEDS.of(accuracy.by_speed),
        ACCELERATIONS.of(accuracy.by_acceleration),
        RATES.of(rates),
        reversals.of(rows),
        Figure(partial(path_accuracy_plot, accuracy)),
    ]
    registration: Json | None = None
    if alignment.registered:
        pose = homogeneous(alignment.rotation, alignment.position)
        registration = {"T_reference_recorded": pose, **pose_record(pose)}
    data: Json = {
        "latency": {
            "value_ms": ms(alignment.latency),
            "std_ms": ms(alignment.latency_std),
            "searched_ms": ms(float(alignment.shifts[-1])),
            "as_good_ms": [ms(latency) for latency in alignment.as_good],
        },
        "errors": {error[0]: ERRORS.record(error) for error in errors},
        "by_speed": SPEEDS.records(accuracy.by_speed),
        "by_acceleration": ACCELERATIONS.records(accuracy.by_acceleration),
        "by_update_rate": RATES.records(rates),
        "reversals": {"per": accuracy.per, "channels": reversals.records(rows)},
        "faults": FAULTS.records(accuracy.faults),
        "registration": registration,
        "samples": {"compared": len(accuracy.time), "recorded": len(accuracy.recorded.time)},
        "seconds": float(accuracy.time[-1] - accuracy.time[0]),
        "input": {
            "recorded": str(accuracy.recorded.path),
            "reference": str(accuracy.reference.path),
        },
    }
    return Document(NAME, "Path accuracy", accuracy.assessment, parts, data, "result")


def path_accuracy_plot(accuracy: PathAccuracy) -> str:
    """An SVG: error over time, distance by latency, and what happens at reversals."""
    with picture(NAME, (LARGE, 5.6)) as figure:
        below = ["latency", "reversals"] + ["hysteresis"] * (accuracy.per == "joint")
        layout: Any = [["time"] * len(below), below]
        panels = figure.subplot_mosaic(layout)
        _over_time(panels["time"], accuracy)
        _by_latency(panels["latency"], accuracy)
        _at_reversals(panels["reversals"], accuracy)
        if accuracy.per == "joint":
            _hysteresis(panels["hysteresis"], accuracy)
        description = "Dynamic accuracy: error over time, by latency, and at reversals"
        return svg_text(figure, NAME, description)


def _over_time(axes: Axes, accuracy: PathAccuracy) -> None:
    most_points = 2000
    step = max(1, len(accuracy.time) // most_points)
    rows = len(accuracy.time) // step * step
    for error, colour, label in (
        (accuracy.error_same_time, ORANGE, "at the same time"),
        (accuracy.error, BLUE, "latency removed"),
    ):
        # The largest of every few rows: no peak is lost, and the file stays small.
        size = mm(np.linalg.norm(error, axis=1))[:rows].reshape(-1, step).max(axis=1)
        axes.plot(accuracy.time[:rows:step], size, color=colour, lw=0.9, label=label)
    axes.set_ylim(bottom=0)
    axes.set_title("Distance from the reference", pad=24)
    axes.set_xlabel("time, s")
    axes.set_ylabel("distance, mm")
    axes.grid(axis="y")
    axes.legend(ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)


def _by_latency(axes: Axes, accuracy: PathAccuracy) -> None:
    alignment = accuracy.alignment
    axes.plot(ms(alignment.shifts), mm(alignment.rms), color=BLUE, lw=1.2)
    axes.axvline(ms(alignment.latency), color=GREY, lw=1.2, ls="--")
    axes.set_ylim(bottom=0)
    axes.set_title(
        f"Latency {ms(alignment.latency):.3f} ± {ms(alignment.latency_std):.3f} ms", pad=24
    )
    axes.set_xlabel("latency removed, ms")
    axes.set_ylabel("RMS distance, mm")
    axes.grid()


def _at_reversals(axes: Axes, accuracy: PathAccuracy) -> None:
    for shift, colour, mark, what in (
        (-0.2, BLUE, "o", "before"),
        (0.0, ORANGE, "s", "after"),
        (0.2, "black", "D", "jump"),
    ):
        values = [
            reversal.jump if what == "jump" else getattr(reversal, f"error_{what}")
            for reversal in accuracy.reversals
        ]
        places = np.arange(len(values)) + shift
        axes.plot(places, mm(np.array(values)), mark, color=colour, ms=4.5, label=what)
    axes.margins(y=0.1)
    axes.set_ylim(bottom=0)
    axes.set_title("Error of the tip at reversals", pad=24)
    axes.set_ylabel("RMS, mm")
    axes.legend(ncols=3, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)
    _name(axes, accuracy)


def _hysteresis(axes: Axes, accuracy: PathAccuracy) -> None:
    """Each joint's hysteresis with twice its standard uncertainty, in mm for one that slides."""
    for k, reversal in enumerate(accuracy.reversals):
        pair = accuracy.hysteresis.get(reversal.channel.name)
        if pair is not None:
            size, std = shown(np.array(pair), reversal.channel.unit)
            axes.errorbar(k, size, 2 * std, fmt="o", color=BLUE, ms=5, capsize=4)
    axes.axhline(0, color=GREY, lw=0.8)
    units = {unit_name(reversal.channel.unit) for reversal in accuracy.reversals}
    axes.set_title("Hysteresis (bars: 2 std)", pad=24)
    axes.set_ylabel(f"hysteresis, {' or '.join(sorted(units))}")
    _name(axes, accuracy)


def _name(axes: Axes, accuracy: PathAccuracy) -> None:
    names = [reversal.channel.name for reversal in accuracy.reversals]
    axes.set_xticks(range(len(names)), names)
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.tick_params(axis="x", labelrotation=45 if len(names) > 3 else 0)
    axes.grid(axis="y")
