"""Tables of a calibration: poses, held-out errors, noise, priors, repeats, scale and starts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.job.calibration import Calibration
from suta_calib.report.errors import in_words
from suta_calib.report.listing import Column, Listing, shown_as, written
from suta_calib.report.poses import axes_with_std
from suta_calib.solver.interface import Minimum
from suta_calib.solver.solution import Estimate
from suta_calib.solver.weights import Learned
from suta_calib.terms.block import Block
from suta_calib.trust.clocks import ClockOffset
from suta_calib.trust.external_poses import ExternalPose
from suta_calib.trust.held_out import PROBABILITIES, HeldOutErrors
from suta_calib.trust.repeats import TouchRepeatability
from suta_calib.trust.scale_effects import ScaleEffect
from suta_calib.units import Unit, ms, text, unit_name, us
from suta_calib.words import kept, listed


# ── poses beside the arm ─────────────────────────────────────────────────────────────────────
def _rpy(pose: ExternalPose) -> FloatArray | None:
    return None if pose.rotation is None else rpy_from_rotation(pose.rotation)


def _spaced(
    numbers: Callable[[ExternalPose], FloatArray | None], unit: Unit
) -> Callable[[ExternalPose], str]:
    """A cell with several numbers; empty for a point, which has no orientation."""

    def cell(pose: ExternalPose) -> str:
        components = None if pose.rotation is None else numbers(pose)
        return "" if components is None else "  ".join(text(float(v), unit) for v in components)

    return cell


EXTERNAL_POSES: Final = Listing[ExternalPose](
    "External poses",
    Column("name", "frame"),
    Column("what", "pose", lambda pose: pose.frame.what, cell=lambda pose: f"{pose.words}, mm"),
    Column("within", None, lambda pose: pose.frame.within),
    *axes_with_std(lambda pose: pose.position, lambda pose: pose.std[:3]),
    shown_as("roll  pitch  yaw, deg", _spaced(_rpy, "rad")),
    shown_as("± turn about its x  y  z", _spaced(lambda pose: pose.std[3:], "rad")),
    shown_as("quaternion x  y  z  w", _spaced(lambda pose: pose.quaternion, "1")),
    shown_as("± std", _spaced(lambda pose: pose.quaternion_std, "1")),
    *written("matrix", "inverse"),
    Column("position", unit="m"),
    Column("position_std", value=lambda pose: pose.std[:3], unit="m"),
    Column("rpy", value=_rpy, unit="rad"),
    Column("rotation_std", value=lambda pose: pose.std[3:], unit="rad"),
    Column("quaternion_xyzw", value=lambda pose: pose.quaternion),
    Column("quaternion_std"),
    Column("held", "not determined", cell=lambda pose: listed(pose.held, 3), optional=True),
    Column("given", "valid while", cell=lambda pose: kept(pose.given), optional=True),
    key="external_poses",
    named=True,
)
# A terminal has no room for what says the same again, and angles may stand below their row.
IN_SHORT: Final = Listing[ExternalPose](
    EXTERNAL_POSES.title,
    *(
        replace(column, numeric=False) if "  " in (column.heading or "") else column
        for column in EXTERNAL_POSES.columns
        if column.heading not in ("quaternion x  y  z  w", "± std")
    ),
)
NOTE: Final = (
    "A pose is T_within_what, in metres in result.json, where its inverse is too. ± of a turn is "
    "about the frame's own axes."
)
NOTE_GIVEN: Final = (
    "“valid while” names parameters of the arm or keys of the job that no measurement checks. If "
    "their nominal value is wrong, the pose is wrong too."
)


# ── clocks ───────────────────────────────────────────────────────────────────────────────────
def _ms(value: Callable[[ClockOffset], float | None]) -> Callable[[ClockOffset], float | None]:
    """A time in ms; None of none."""

    def in_ms(clock: ClockOffset) -> float | None:
        time = value(clock)
        return None if time is None else ms(time)

    return in_ms


TIME_OFFSETS: Final = Listing[ClockOffset](
    "Clocks",
    Column("name", "time offset"),
    Column("offset_ms", "ms", _ms(attrgetter("offset")), form=".3f", sign=True),
    Column("std_ms", "±", _ms(attrgetter("std")), form=".3f"),
    Column("tip", "at the tip, mm", unit="m"),
    Column("tip_std", "±", unit="m"),
    Column("rows", "rows", form="d"),
    Column("left_out", "left out", form="d"),
    key="time_offsets",
    named=True,
)
LINE_DELAYS: Final = Listing[Estimate](
    "Rolling shutters",
    Column("name", "line delay"),
    Column("line_delay_us", "µs", lambda delay: us(delay.value), form=".3f"),
    Column(
        "std_us",
        "±",
        lambda delay: None if delay.std is None else us(delay.std),
        form=".3f",
    ),
    Column("state", "state"),
    key="line_delays",
    named=True,
)
NOTE_CLOCKS: Final = (
    "A time offset is added to the time of what the instrument saw: below zero, it was seen before "
    "the joints were read. “at the tip”: how far the tip moves in this time, root mean square of "
    "the rows; without the time offset, they would be wrong by as much. Rows near a gap in time "
    "are left out."
)


# ── held-out errors, each with the label of the job's row ────────────────────────────────────
def _of_held_out(row: tuple[str, HeldOutErrors]) -> str:
    return in_words(row[1].term.kind, row[1].name, row[1].term.poses.chain)


def _rms(key: str, heading: str, name: str) -> Column[HeldOutErrors]:
    def value(errors: HeldOutErrors) -> float:
        return float(np.sqrt(np.mean(getattr(errors, name) ** 2)))

    return Column(key, heading, value, attrgetter("unit"), si=True)


def _within(probability: float) -> Column[HeldOutErrors]:
    def shown(errors: HeldOutErrors) -> str:
        coverage = errors.coverage(probability)
        return f"{100 * coverage.share:.0f} ± {100 * coverage.std:.0f} %"

    percent = f"{100 * probability:.0f}"
    return Column(
        f"within_{percent}",
        f"within {percent} %",
        lambda errors: errors.coverage(probability).share,
        "%",
        cell=shown,
    )


_HELD_OUT: Final = (
    Column[HeldOutErrors]("block", None, lambda errors: errors.name),
    Column[HeldOutErrors]("count", "count", lambda errors: len(errors.residual)),
    Column[HeldOutErrors]("unit", "unit", cell=lambda errors: unit_name(errors.unit)),
    _rms("std", "found", "residual"),
    _rms("predicted_std", "predicted", "predicted"),
    _rms("parameters_std", "by parameters", "by_parameters"),
    *map(_within, PROBABILITIES),
    Column[HeldOutErrors]("each_predicted_std", None, lambda errors: errors.predicted),
)
HELD_OUT: Final = Listing[tuple[str, HeldOutErrors]](
    "Validation errors per axis: measured and predicted",
    Column("kind", "of", lambda row: row[1].term.kind, cell=_of_held_out),
    Column("label", None, lambda row: row[0]),
    *(column.over(lambda row: row[1]) for column in _HELD_OUT),
    key="held_out",
)


def held_out_rows(result: Calibration) -> Iterator[tuple[str, HeldOutErrors]]:
    """Of every block that was held out; the solution has converged."""
    for label, term in result.labelled_terms["validation"]:
        for errors in result.examined.held_out:
            if errors.term is term.term:
                yield label, errors


# ── noise and priors: as given or assumed, and as the data show them ─────────────────────────
@dataclass(frozen=True, eq=False)
class BlockNoise:
    """Noise of one block of residuals: as it was assumed, and as the residuals show it.

    Attributes:
        kind, label: of its term.
        block: of residuals.
        assumed: standard deviation of one component, m or rad.
        found: the same; None where the solution did not converge.
        interval: where it is with a chance of 95 %; None where it was weighed against nothing.
    """

    kind: str
    label: str
    block: Block
    assumed: float
    found: float | None
    interval: tuple[float, float] | None


def _unit(row: BlockNoise) -> Unit:
    return row.block.unit


def _between(interval: tuple[float, float], unit: Unit | None = None) -> str:
    return " … ".join(f"{end:.2f}" if unit is None else text(end, unit) for end in interval)


NOISE: Final = Listing[BlockNoise](
    "Noise",
    Column("kind"),
    Column("", "residuals", lambda row: f"{row.kind.replace('_', ' ')}: {row.block.name}"),
    Column("label", "label"),
    Column("block", None, lambda row: row.block.name),
    Column("unit", "unit", _unit, cell=lambda row: unit_name(_unit(row))),
    Column("assumed", "assumed", unit=_unit, si=True),
    Column(
        "given",
        "from",
        lambda row: row.block.noise.sigma is not None,
        cell=lambda row: "default" if row.block.noise.sigma is None else "the job",
    ),
    Column("found", "found", unit=_unit, si=True),
    Column(
        "interval",
        "95 %",
        unit=_unit,
        si=True,
        optional=True,
        cell=lambda row: _between(row.interval, row.block.unit) if row.interval else "",
    ),
)
PRIORS: Final = Listing[tuple[str, Learned]](
    "Priors",
    Column("group", "of", lambda row: row[0]),
    Column("factor", "times the job's value", lambda row: row[1].value, form=".2f"),
    Column(
        "interval", "95 %", lambda row: row[1].interval, cell=lambda row: _between(row[1].interval)
    ),
    Column("contradicted", None, lambda row: row[1].contradicted),
)


def noise_of(result: Calibration) -> list[BlockNoise]:
    """Of every block that was fitted."""
    solution = result.solution
    learned = [None] * len(solution.noise)
    intervals = (
        learned
        if solution.weights is None
        else [level.interval for level in solution.weights.noise]
    )
    blocks = [
        (term.term.kind, label, block)
        for label, term in result.labelled_terms["calibration"]
        for block in term.term.blocks
    ]
    return [
        BlockNoise(*block, assumed, estimated if solution.converged else None, interval)
        for block, assumed, estimated, interval in zip(
            blocks, solution.problem.assumed_sigmas(), solution.noise, intervals, strict=True
        )
    ]


def priors_of(result: Calibration) -> list[tuple[str, Learned]]:
    """What was learned of the size of each group of priors."""
    weights = result.solution.weights
    return [] if weights is None else list(weights.priors.items())


# ── what is short ────────────────────────────────────────────────────────────────────────────
REPEATABILITY: Final = Listing[tuple[str, TouchRepeatability]](
    "Repeatability, mm: distance of the tip from the mean of repeated touches",
    Column("data", "data", lambda row: row[0]),
    Column("rms", "RMS", lambda row: row[1].rms, "m"),
    Column("std", "± std", lambda row: row[1].std, "m"),
    Column("touches", "touches", lambda row: row[1].touches, form="d"),
    Column("places", "places", lambda row: row[1].places, form="d"),
)
SCALE: Final = Listing[ScaleEffect](
    "",
    Column("carrier", value=lambda row: row.what),
    *written("name"),
    Column("grade", value=lambda row: row.scale.grade or None),
    Column("ppm", value=lambda row: row.scale.ppm),
    *written("carries"),
    Column("tip", value=lambda row: row.tip, unit="m"),
)
ABOUT: Final = Listing[tuple[str, str]](
    "", Column("", "", lambda row: row[0]), Column("", "", lambda row: row[1])
)
# Of combinations in words.
COMBINATIONS: Final = Listing[str](
    "Combinations that change no observation",
    Column("", "m and rad, per unit of the parameter that stands first", lambda row: row),
)
STARTS: Final = Listing[tuple[int, Minimum]](
    "How it was computed",
    Column("", "start", lambda row: row[0], form="d"),
    Column("status", "status", lambda row: row[1].status),
    Column("iterations", "iterations", lambda row: row[1].iterations, form="d"),
    Column("cost", "cost", lambda row: row[1].cost, form=".6g"),
)


def repeatability_of(result: Calibration) -> list[tuple[str, TouchRepeatability]]:
    """Of every set of data and term that has enough repeats."""
    return [(name, term) for name, terms in result.repeatability.items() for term in terms]
