"""A hand, or an eye, whose pose is the same in nearly all rows: a logger that repeats itself."""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rms_length, vector_from_rotation
from suta_calib.terms.hand_eye_start import Poses, chordal_mean
from suta_calib.terms.poses import WANDER, together
from suta_calib.units import deg, mm

# Part of its spread over all rows that the other side has in rows where this one stands still. A
# target that is only seen again there has its noise: 5 mm of 200 mm.
MOVES_ON: Final = 0.3
WHOSE: Final = ("a pose of the hand (a_)", "a pose that the eye saw (b_)")


def refuse_constant(hand: Poses, eye: Poses) -> None:
    """Refuse pairs of which one side stands still while the other moves, and name it.

    Args:
        hand: ``T_base_hand`` as it was given, rotations (n, 3, 3) and positions (n, 3), m.
        eye: ``T_eye_target``.

    Raises:
        SamplesError: the same pose in nearly all rows of one side, and in few of the other.
    """
    sides = hand, eye
    for whose, side, other, other_name in zip(WHOSE, sides, sides[::-1], WHOSE[::-1], strict=True):
        same = _largest_group(side)
        count, rows = len(same), int(same.sum())
        # Part of the rows that have one pose, from which on it is no point that was visited often;
        # and rows that are left then, of which no X can be found.
        if rows < max(0.8 * count, 3) or not _moves_on(other, same):
            continue
        slid, turned = (float(np.ptp(v, axis=0).max()) for v in _spread(other, same))
        which = f"all {count} rows" if rows == count else f"{rows} of {count} rows"
        raise SamplesError(
            f"{whose} that is the same in {which}, while {other_name} changes by "
            f"{mm(slid):.0f} mm and {deg(turned):.0f}° in them",
            "both poses of every row, as they were at that moment",
            hint="did the program that wrote them read this pose only once? Record again",
        )


def _largest_group(poses: Poses) -> BoolArray:
    """(n,) rows of the pose that most rows have, but for the last digits."""
    group = together(np.hstack([poses[1], poses[0].reshape(-1, 9)]), WANDER)
    return np.asarray(group == np.bincount(group).argmax())


def _spread(poses: Poses, rows: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Displacements (k, 3), m, and turns (k, 3), rad, of some rows from their mean."""
    R, p = poses[0][rows], poses[1][rows]
    return p - p.mean(axis=0), vector_from_rotation(chordal_mean(R).T @ R)


def _moves_on(other: Poses, same: BoolArray) -> bool:
    """Whether the other side moves as much in these rows as in all."""
    if _largest_group(other)[same].all():
        return False
    every = np.ones_like(same)
    parts = zip(_spread(other, same), _spread(other, every), strict=True)
    return any(rms_length(part) > MOVES_ON * rms_length(of_all) for part, of_all in parts)
