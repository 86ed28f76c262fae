"""Which pictures of a board that looks the same after half a turn are numbered from its other end.

A hand and the eye on it, or the board on it, turn by the same angle between two pictures, whatever
X and Z are. So every pair of pictures says whether both are numbered from the same end, the louder
the more the two angles differ; the signs that most of what is said agrees with are those of the
leading eigenvector (Singer 2011, doi:10.1016/j.acha.2010.02.001, for two elements).

Which end that is the pictures of one camera leave open. Other pictures of the same board follow the
first ones: where these have it in the base, or on the hand, it is turned by half a turn or not.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.geometry.numbers import quaternion_from_rotation
from suta_calib.terms.hand_eye_start import (
    FEWEST,
    HALF_TURN,
    Poses,
    agreeing_hand_eye,
    loop_closures,
)

# Pictures that are held against each other; the rest are held against these.
COMPARED: Final = 300


def half_turned(hand: FloatArray, target: FloatArray, otherwise: FloatArray) -> BoolArray:
    """(n,) which boards agree with most of the others once they are turned by half a turn.

    None where hand and pictures do not move alike even so: something else is wrong. Rotations are
    of the hand in the base, or of the base in it, of the board in the eye, and of the board
    numbered from its other end (n, 3, 3).
    """
    n = len(hand)
    if n < 2:
        return np.zeros(n, dtype=np.bool_)
    chosen = np.unique(np.linspace(0, n - 1, min(n, COMPARED)).astype(np.intp))
    moved = _angles(hand, hand[chosen])
    same = np.abs(_angles(target, target[chosen]) - moved)
    other = np.abs(_angles(otherwise, target[chosen]) - moved)
    evidence = other - same
    # A picture says nothing of itself.
    evidence[chosen, np.arange(len(chosen))] = 0.0
    vector = np.linalg.eigh(evidence[chosen])[1][:, -1]
    signs = np.where(vector < 0.0, -1.0, 1.0)
    sign = np.where(evidence @ signs < 0.0, -1.0, 1.0)
    left = np.where(sign[:, None] * signs > 0.0, same, other)
    # From such a middle difference of the angles on hand and pictures belong to other motions.
    if np.median(left) > np.radians(10.0):
        return np.zeros(n, dtype=np.bool_)
    turned = sign < 0.0
    return turned if 2 * turned.sum() <= n else ~turned


def from_other_end(
    hand: Poses, target: Poses, first: tuple[Poses, Poses], *, same_eye: bool
) -> BoolArray:
    """(n,) which boards are numbered from the other end than in the ``first`` pictures.

    None where these or the others tell no X, or agree neither way: something else is wrong. The
    hand is ``T_base_hand`` of an eye on it, ``T_hand_base`` of one beside it, the target
    ``T_eye_board``. Where one camera took both (``same_eye``), its X is that of the first ones, and
    every other picture is judged by itself.
    """
    n = len(hand[1])
    if len(first[0][1]) < FEWEST or (n < FEWEST and not same_eye):
        return np.zeros(n, dtype=np.bool_)
    X, there = agreeing_hand_eye(*first)
    board: FloatArray
    if same_eye:
        board = loop_closures(hand, X, target)[0]
    else:
        board = agreeing_hand_eye(hand, target)[1][0][None]
    off = np.stack([_angles(side, there[0][None])[:, 0] for side in (board, board @ HALF_TURN)])
    # Turned by so much between one row of a job and another, it is another board.
    if np.median(off.min(axis=0)) > np.radians(45.0):
        return np.zeros(n, dtype=np.bool_)
    return np.broadcast_to(off[1] < off[0], n)


def _angles(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles (n, m) of the turns between rotations (n, 3, 3) and (m, 3, 3), rad."""
    cosine = np.abs(quaternion_from_rotation(a) @ quaternion_from_rotation(b).T)
    return np.asarray(2.0 * np.arccos(np.minimum(cosine, 1.0)))
