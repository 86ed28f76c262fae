"""Rows that are no visits as they stand: copies, misread columns, a joint that stood still.

Copies tell nothing new, and make every interval narrower.

An arm that comes back to a point from several sides moves every joint, and what one does to the tip
the others undo. Where a joint counts the other way or in another unit than the others, or two
columns are exchanged, they do not, and the scatter is that of joints which have nothing to do with
each other. So it is of an arm that comes back in one and the same posture, where only noise moves
the joints: there no reading of the columns makes them undo each other, and none is named.

An arm whose joint is locked comes back with the others alone, which undo among themselves what they
do to the tip: it scatters like any. Where the joint moved and its encoder did not, what it did is
missing. The tip then scatters the way this joint moves it, and far less across; and by no little
part of what the other joints move it by, each for itself, however far that is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
from scipy.special import fdtrc

from suta_calib.analysis.repeatability.scatter import departures, tip_levers
from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.numbers import rms_length
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel
from suta_calib.terms.poses import resolutions, together
from suta_calib.trust.hypothesis import known_hypotheses
from suta_calib.trust.misreadings import MisreadJoints
from suta_calib.trust.repeats import about_mean
from suta_calib.units import Unit, from_deg, from_mm, mm

LEAST, MOST = 5e-7, 3e-6
# Visits that are enough for no reading to fit by chance, and for a joint that stands still to show;
# and ways in which the joints must have moved for a reading to fit: between two points they move in
# one way, which some reading undoes.
ENOUGH: Final = 8
WAYS: Final = 2
# Units in which a single column may be, beside those it should be in, and how much one of them is.
UNITS: Final[dict[Unit, dict[str, float]]] = {
    "rad": {"degrees": from_deg(1.0), "turns": 2 * np.pi},
    "m": {"mm": from_mm(1.0)},
}


def first_written(q: FloatArray, units: Sequence[Unit]) -> BoolArray:
    """(n,) rows of readings (n, joints) that are no copies of one before, jittered or not.

    Of an arm whose encoders are all so coarse that it may well read the same when it comes back,
    all of them.
    """
    if len(q) < 2:
        return np.ones(len(q), dtype=np.bool_)
    moving = np.flatnonzero(np.ptp(q, axis=0) > 0.0).tolist()
    first = np.zeros(len(q), dtype=np.bool_)
    first[0] = True
    if not moving:
        return first
    off = departures(q[:, moving], [units[k] for k in moving])
    for most in (MOST, LEAST):
        # Rows are copies that differ in no joint by more than this share of its standard deviation,
        # which two visits hardly do in all joints at once. At least what no encoder tells, at most
        # less than the most exact arm comes back by, where several postures make the deviations
        # large; rad or m.
        near = np.clip(0.05 * off.std(axis=0), LEAST, most)
        first[:] = False
        first[np.unique(together(off / near, 1.0), return_index=True)[1]] = True
        # So many must be copies for more than the least to be what parts them: of many exact visits
        # two may be as near.
        if np.mean(~first) >= 0.05:
            break
    # Share of the rows that read in a joint as another one does, from which on its encoder is
    # coarse.
    shared = 0.5
    coarse = np.all(resolutions(q[:, moving]) > 0.0) or all(
        _shared(readings) > shared for readings in q[first][:, moving].T
    )
    return np.ones(len(q), dtype=np.bool_) if coarse and first.sum() > 1 else first


def _shared(readings: FloatArray) -> float:
    """Share of readings (n,) that occur more than once."""
    _, count = np.unique(readings, return_counts=True)
    return float(np.sum(count[count > 1])) / len(readings)


def misread(arm: ArmModel, samples: Samples, position: FloatArray) -> str | None:
    """What would have to be so of the joints' columns for visits at (n, 3), m, to be of one point.

    None where the joints undo each other as they are, or in no reading.
    """
    # A reading with so many times less scatter, in either measure, is what the columns are.
    far_better = 3.0
    # Scatter, m, below which the joints did not move.
    still = 1e-9
    if len(samples) < ENOUGH:
        return None
    ways = _ways(arm, samples.q)
    as_read = _scatter(position), float(np.linalg.norm(ways))
    # Scatter of the tip, in units of that of unrelated joints, below which they undo each other.
    if len(ways) < WAYS or as_read[1] < still or as_read[0] <= 0.25 * as_read[1]:
        return None
    explanations = list[tuple[float, str]]()
    for sentence, change in _readings(arm):
        q = change(samples).q
        tip, moved = _scatter(arm.forward(q)[1]), _ways(arm, q)
        unrelated = max(float(np.linalg.norm(moved)), still)
        # How much shorter levers are in other postures does not matter.
        undone = tip / unrelated * far_better < as_read[0] / as_read[1]
        if undone and tip * far_better < moved[WAYS - 1]:
            explanations.append((tip, sentence))
    tip, sentence = min(explanations, default=(np.inf, ""))
    if tip * far_better > as_read[0]:
        return None
    return (
        f"If {sentence}, the visits scatter by {mm(tip):.3f} mm (RMS) instead of "
        f"{mm(as_read[0]):.3f} mm. As they are, the readings do not fit one point of this arm."
    )


def _readings(arm: ArmModel) -> Iterator[tuple[str, Callable[[Samples], Samples]]]:
    """Other readings of the columns, each with what would have to be so."""
    joints = [h for h in known_hypotheses().values() if isinstance(h, MisreadJoints)]
    for hypothesis in sorted(joints, key=lambda h: h.precedence):
        yield from hypothesis.of_joints(arm, arm.own_joints)
    for k, (name, unit) in enumerate(arm.units.items()):
        for other, factor in UNITS.get(unit, {}).items():
            yield f"the readings of {name} are in {other}, not {unit}", partial(_times, k, factor)
        yield f"the readings of {name} are one row late", partial(_slid, k, -1)
        yield f"the readings of {name} are one row early", partial(_slid, k, 1)


def _times(column: int, factor: float, samples: Samples) -> Samples:
    """The samples with one joint's readings in another unit."""
    q = samples.q.copy()
    q[:, column] *= factor
    return replace(samples, q=q)


def _slid(column: int, rows: int, samples: Samples) -> Samples:
    """The samples with one joint's readings some rows later, without those that have none."""
    q = samples.q.copy()
    q[:, column] = np.roll(q[:, column], rows)
    rows_used = np.arange(1, len(q)) if rows > 0 else np.arange(len(q) - 1)
    return replace(samples, q=q).take(rows_used)


def _scatter(position: FloatArray) -> float:
    return rms_length(position - position.mean(axis=0))


def _ways(arm: ArmModel, q: FloatArray) -> FloatArray:
    """By what the joints move the tip, each for itself, RMS, m: along its principal axes."""
    off = departures(q, arm.units.values())
    off -= off.mean(axis=0)
    return np.asarray(np.linalg.svd(off * tip_levers(arm, q), compute_uv=False) / np.sqrt(len(q)))


@dataclass(frozen=True)
class Stuck:
    """A joint whose readings lack what it did."""

    joint: str  # its name
    readings: int  # how many different ones there are
    few: bool  # whether those are few beside the other joints'
    along: float  # what is missing moves the tip by so much, RMS, m
    scatter: float  # of the tip as it is read, RMS in space, m
    without: float  # the same with this joint where it would have to be, m

    @property
    def sentence(self) -> str:
        """What is odd, and what it does."""
        same = "the same value"
        if self.readings > 1:
            same = f"only {self.readings} values" if self.few else "nearly the same"
        return (
            f"{self.joint} reads {same} at all visits, but {mm(self.along):.3f} mm (RMS) of the "
            "tip's scatter are exactly in the direction in which it moves the tip. If it had "
            "moved as the other joints indicate, the visits would scatter by "
            f"{mm(self.without):.3f} mm, not by {mm(self.scatter):.3f} mm. Check its encoder."
        )


def stuck(arm: ArmModel, q: FloatArray, group: IntArray) -> tuple[Stuck, ...]:
    """Joints whose readings (n, joints) stand still, or nearly, though the joint must have moved.

    ``group`` (n,) is the number of the point that each visit was to.
    """
    # Part of what is missing, and of what most joints move by, that one which stands still may
    # read.
    still = 0.1
    if len(q) < ENOUGH:
        return ()
    levels = [len(np.unique(readings)) for readings in q.T]
    fine = float(np.median(levels)) > len(q) / 2
    # Readings that are few where most joints never repeat one.
    few = [fine and count <= max(2.0, 0.2 * len(q)) for count in levels]
    spread = departures(q, arm.units.values()).std(axis=0)
    moved = spread * tip_levers(arm, q)
    stuck_joints = list[Stuck]()
    # A joint that moves like the others reads what it does.
    for k in np.flatnonzero(few | (spread < still * np.median(spread))).tolist():
        freed = _freed(arm, q, group, k)
        if freed is None:
            continue
        missing, lever, left = freed
        if few[k] or spread[k] < still * float(missing.std()):
            along = lever * missing
            size = float(np.sqrt(np.mean(along**2)))
            typical = float(np.median(np.delete(moved, k)))
            # The least part of what the other joints move the tip by: a joint moves with them.
            if size > 0.15 * typical and _far(along, left, group):
                tip = about_mean(arm.forward(q)[1], group, np.bincount(group))
                stuck_joints.append(
                    Stuck(arm.joints[k], levels[k], few[k], size, rms_length(tip), rms_length(left))
                )
    return tuple(stuck_joints)


def _freed(
    arm: ArmModel, q: FloatArray, group: IntArray, k: int
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """What joint k lacks (n,), its levers (n,), and what is left of the tip's scatter (n, 3).

    The joint is put where the tip is nearest to the others of its group; None where it hardly moves
    the tip.
    """
    step, moved, count = 1e-6, np.zeros(len(q)), np.bincount(group)
    one = step * np.eye(q.shape[1])[k]
    for _ in range(8):
        at = q.copy()
        at[:, k] += moved
        _, both = arm.forward(np.vstack([at, at + one]))
        tip = both[: len(q)]
        slope = (both[len(q) :] - tip) / step
        lever = np.linalg.norm(slope, axis=1)
        # Least lever of a joint that moves the tip, m per rad or m.
        if lever.min() < 1e-3:
            return None
        left = about_mean(tip, group, count)
        moved = moved - np.sum(left * slope, axis=1) / lever**2
    return about_mean(moved[:, None], group, count)[:, 0], lever, left


def _far(along: FloatArray, left: FloatArray, group: IntArray) -> bool:
    """Whether the tip is farther off along (n,) than what is left (n, 3) tells of either axis."""
    # Times as far along as across, per axis, and how rare that is by chance.
    far = 1.5
    rare = 1e-3
    freedom = len(along) - len(np.unique(group))
    one, other = float(along @ along) / freedom, float(np.sum(left**2)) / (2 * freedom)
    ratio = one / max(other, 1e-30)
    return ratio > far**2 and float(fdtrc(freedom, 2 * freedom, ratio)) < rare
