"""A joint that reads the same, or hardly anything else, at visits to which it must have moved.

An arm whose joint is locked comes back to a point with the others alone, and what they do to the
tip they undo among themselves: it scatters like any. Where the joint moved and its encoder did not,
what it did is missing. The tip then scatters the way this joint moves it, and far less across; and
by no little part of what the other joints move it by, each for itself, however far that is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import fdtrc

from suta_calib.analysis.repeatability.scatter import deviations, tip_levers
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.geometry.numbers import rms_length
from suta_calib.model.arm import ArmModel
from suta_calib.units import mm

# Visits of which that can be told.
ENOUGH: Final = 8
# Different readings, at most so many of all rows, that are few where most joints never repeat one.
FEW: Final = 0.2
# The least part of what the other joints move the tip by: a joint moves with them.
PART: Final = 0.15
_STEP: Final = 1e-6
_ROUNDS: Final = 8


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
        same = "the same"
        if self.readings > 1:
            same = f"only {self.readings} values" if self.few else "nearly the same"
        return (
            f"{self.joint} reads {same} at all visits, and {mm(self.along):.3f} mm (RMS) of the "
            f"tip's scatter are just the way it moves the tip: had it moved as the others tell, "
            f"the visits would scatter by {mm(self.without):.3f} mm, not by "
            f"{mm(self.scatter):.3f} mm. "
            "Is its encoder alive?"
        )


def stuck(arm: ArmModel, q: FloatArray, group: IntArray) -> tuple[Stuck, ...]:
    """Joints whose readings stand still, or nearly, though the joint must have moved.

    Args:
        arm: whose readings these are.
        q: (n, joints) readings.
        group: (n,) number of the point that each visit was to.
    """
    # Part of what is missing, and of what most joints move by, that one which stands still may
    # read.
    still = 0.1
    if len(q) < ENOUGH:
        return ()
    levels = [len(np.unique(readings)) for readings in q.T]
    fine = float(np.median(levels)) > len(q) / 2
    few = [fine and count <= max(2.0, FEW * len(q)) for count in levels]
    off = np.stack([deviations(r, u)[1] for r, u in zip(q.T, arm.units.values(), strict=True)], 1)
    spread = off.std(axis=0)
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
            if size > PART * typical and _far(along, left, group):
                tip = _within(arm.forward(q)[1], group)
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
    one, moved = _STEP * np.eye(q.shape[1])[k], np.zeros(len(q))
    for _ in range(_ROUNDS):
        at = q.copy()
        at[:, k] += moved
        _, both = arm.forward(np.vstack([at, at + one]))
        tip = both[: len(q)]
        slope = (both[len(q) :] - tip) / _STEP
        lever = np.linalg.norm(slope, axis=1)
        # Least lever of a joint that moves the tip, m per rad or m.
        if lever.min() < 1e-3:
            return None
        left = _within(tip, group)
        moved = moved - np.sum(left * slope, axis=1) / lever**2
    return _within(moved[:, None], group)[:, 0], lever, left


def _within(rows: FloatArray, group: IntArray) -> FloatArray:
    """Rows (n, d) from the mean of their group."""
    off = rows.copy()
    for number in np.unique(group):
        off[group == number] -= rows[group == number].mean(axis=0)
    return off


def _far(along: FloatArray, left: FloatArray, group: IntArray) -> bool:
    """Whether the tip is farther off along (n,) than what is left (n, 3) tells of either axis."""
    # Times as far along as across, per axis, and how rare that is by chance.
    far = 1.5
    rare = 1e-3
    freedom = len(along) - len(np.unique(group))
    one, other = float(along @ along) / freedom, float(np.sum(left**2)) / (2 * freedom)
    ratio = one / max(other, 1e-30)
    return ratio > far**2 and float(fdtrc(freedom, 2 * freedom, ratio)) < rare
