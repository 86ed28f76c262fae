"""Closed-form hand-eye calibration: where the solver of `hand_eye` starts.

    A_i X B_i = Z for all i   ⇒   A X = X B   with A = A_{i+1}⁻¹ A_i and B = B_{i+1} B_i⁻¹

Every function works on one set of poses, or on many at once by leading dimensions.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.numbers import (
    nearest_rotation,
    quaternion_from_rotation,
    rotation_from_quaternion,
    skew,
)

Poses = tuple[FloatArray, FloatArray]  # rotations (..., n, 3, 3) and positions (..., n, 3), m
# Where the eye is; what it sees is on the other.
EyeSetup = Literal["eye-in-hand", "eye-to-hand"]
EYE_IN_HAND: Final[EyeSetup] = "eye-in-hand"
EYE_TO_HAND: Final[EyeSetup] = "eye-to-hand"
# Pairs of poses that determine where the eye is, and what it sees.
FEWEST: Final = 3
# About the normal of a board, and the axis of a camera.
HALF_TURN: Final = np.diag([-1.0, -1.0, 1.0])
# Loops that are this many times as far off as the middle one start nothing.
_STRANGE: Final = 4.0


def quaternion_hand_eye(hand: Poses, target: Poses) -> Poses:
    """X of AX = XB from consecutive motions: rotation by quaternions, then translation.

    The rotation's quaternion is the right singular vector of the stacked rows

        [ sA - sB    -(vA - vB)ᵀ                        ]
        [ vA - vB    (sA - sB) I + skew(vA + vB)        ]

    with the smallest singular value, which is ``qA qX = qX qB`` written as a matrix; the
    translation is the least-squares solution of ``(R_A - I) t_X = R_X t_B - t_A``.

    Args:
        hand: ``T_base_hand``, rotations (..., n, 3, 3) and positions (..., n, 3).
        target: ``T_eye_target``, the same shapes.

    Returns:
        Rotation (..., 3, 3) and position (..., 3) of ``T_hand_eye``. What the motions leave
        undetermined is chosen arbitrarily (rotation) or as small as possible (translation).
    """
    A = after(inverse_poses(_rows(hand, slice(1, None))), _rows(hand, slice(-1)))
    B = after(_rows(target, slice(1, None)), inverse_poses(_rows(target, slice(-1))))
    R = _rotation_between(A, B)
    left = A[0] - np.eye(3)
    right = np.einsum("...ij,...nj->...ni", R, B[1]) - A[1]
    normal = np.einsum("...nij,...nik->...jk", left, left)
    moment = np.einsum("...nij,...ni->...j", left, right)
    # Relative singular value below which a translation is not determined at all.
    rounding = 1e-10
    solved = np.linalg.pinv(normal, rounding, hermitian=True)
    return R, np.einsum("...ij,...j->...i", solved, moment)


def motion_scale(hand: Poses, target: Poses) -> tuple[float, float]:
    """How much farther the hand moves than the eye sees, and how sure that is, as a share of it.

    With X found beside it: ``(R_A - I) t_X + t_A = s R_X t_B`` for motions between any two of n
    poses, by least squares. The share is a standard deviation by the scatter of these equations, of
    which as many are independent as there are poses.
    """
    turn, _ = quaternion_hand_eye(hand, target)
    (R, p), (Rb, pb) = hand, target
    # Motions of the hand A = A_j⁻¹ A_i and of the board in the eye B = B_j B_i⁻¹.
    i, j = np.triu_indices(len(p), k=1)
    A = np.swapaxes(R[j], 1, 2) @ R[i]
    a = np.einsum("nji,nj->ni", R[j], p[i] - p[j])
    b = pb[j] - np.einsum("nij,nj->ni", Rb[j] @ np.swapaxes(Rb[i], 1, 2), pb[i])
    rows = np.concatenate([A - np.eye(3), -(b @ turn.T)[:, :, None]], axis=2).reshape(-1, 4)
    unit = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    solved = np.linalg.lstsq(rows / unit, -a.ravel(), rcond=None)[0] / unit
    off = rows @ solved + a.ravel()
    normal = np.linalg.pinv((rows / unit).T @ (rows / unit), hermitian=True)
    few = len(p) / 2.0 / max(len(p) - 1, 1)
    variance = float(off @ off) / len(off) / few * float(normal[3, 3]) / unit[3] ** 2
    scale = float(solved[3])
    return scale, float(np.sqrt(variance)) / scale if scale > 0 else np.inf


def some_poses(poses: Poses, rows: BoolArray | IntArray) -> Poses:
    """Those of a set (n,) that are asked for: which, or their rows."""
    return poses[0][rows], poses[1][rows]


def agreeing_hand_eye(hand: Poses, target: Poses) -> tuple[Poses, Poses]:
    """X and Z of ``A_i X B_i = Z``: quaternions of motions, the mean of the loops.

    Pairs whose loops are far from the middle one, such as of a board that was taken to be turned,
    are left out of it.
    """
    nothing = np.eye(3), np.zeros(3)
    if len(hand[1]) < 2:
        return nothing, nothing
    X, Z, off = _trimmed(hand, target, np.ones(len(hand[1]), dtype=np.bool_))
    if off > 0.15 and len(hand[1]) > FEWEST:
        # A fifth of all boards half a turn off spoils the mean beyond what leaving out mends: do a
        # few pairs better?
        other = _trimmed(hand, target, _like_a_few(hand, target))
        if other[2] < off:
            X, Z, _ = other
    return X, Z


def _trimmed(hand: Poses, target: Poses, agreeing_rows: BoolArray) -> tuple[Poses, Poses, float]:
    """X and Z of some pairs, then of those that agree with these, until they are the same.

    And how far the middle one of all loops is turned from Z, rad.
    """
    for _ in range(3):
        A, B = some_poses(hand, agreeing_rows), some_poses(target, agreeing_rows)
        X = quaternion_hand_eye(A, B)
        Z = close_the_loop(A, X, B)
        distance, turned = _off(hand, target, X, Z[0])
        agreeing = np.ones_like(agreeing_rows)
        for off in (distance, turned):
            agreeing &= off <= _STRANGE * max(float(np.median(off)), 1e-9)
        if agreeing.sum() < FEWEST or np.array_equal(agreeing, agreeing_rows):
            break
        agreeing_rows = agreeing
    return X, Z, float(np.median(turned))


def _off(hand: Poses, target: Poses, X: Poses, R_Z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(..., n) how far loops end from the middle one, m, and how they are turned against Z, rad."""
    R, p = loop_closures(hand, X, target)
    distance = np.linalg.norm(p - np.median(p, axis=-2, keepdims=True), axis=-1)
    # Of small turns, √2 times their angle.
    turned = np.linalg.norm(R - R_Z[..., None, :, :], axis=(-2, -1)) / np.sqrt(2.0)
    return distance, turned


def _like_a_few(hand: Poses, target: Poses) -> BoolArray:
    """(n,) pairs whose loops close as those of the few that most of all agree with."""
    n = len(hand[1])
    random = np.random.default_rng(0)
    few = np.array([random.choice(n, FEWEST, replace=False) for _ in range(50)])
    A, B = (hand[0][few], hand[1][few]), (target[0][few], target[1][few])
    X = quaternion_hand_eye(A, B)
    _, turned = _off(hand, target, X, close_the_loop(A, X, B)[0])
    middle = np.median(turned, axis=1)
    best = int(np.argmin(middle))
    return np.asarray(turned[best] <= _STRANGE * max(float(middle[best]), 1e-9))


def close_the_loop(hand: Poses, X: Poses, target: Poses) -> Poses:
    """Z as the mean of ``A_i X B_i``: chordal mean of the rotations, mean of the positions."""
    R, p = loop_closures(hand, X, target)
    return chordal_mean(R), p.mean(axis=-2)


def chordal_mean(rotation: FloatArray) -> FloatArray:
    """Rotation (..., 3, 3) with the least sum of squared chords to (..., n, 3, 3)."""
    return nearest_rotation(rotation.sum(axis=-3))


def loop_closures(hand: Poses, X: Poses, target: Poses) -> Poses:
    """Every ``A_i X B_i``, which would all be Z without noise."""
    every = X[0][..., None, :, :], X[1][..., None, :]
    return after(after(hand, every), target)


def as_eye_in_hand(hand: Poses, setup: EyeSetup) -> Poses:
    """A of ``A X B = Z``: ``T_base_hand`` as it is, its inverse where the eye is beside the arm."""
    return inverse_poses(hand) if setup == EYE_TO_HAND else hand


def inverse_poses(poses: Poses) -> Poses:
    """``T_b_a`` of every ``T_a_b``."""
    R, p = poses
    back = np.swapaxes(R, -1, -2)
    return back, -np.einsum("...ij,...j->...i", back, p)


def after(outer: Poses, inner: Poses) -> Poses:
    """``T_a_c = T_a_b T_b_c``, row by row."""
    (R, p), (turn, shift) = outer, inner
    return R @ turn, np.einsum("...ij,...j->...i", R, shift) + p


def _rows(poses: Poses, rows: slice) -> Poses:
    return poses[0][..., rows, :, :], poses[1][..., rows, :]


def _rotation_between(A: Poses, B: Poses) -> FloatArray:
    """R_X of ``R_A R_X = R_X R_B``, from motions.

    A quaternion and its negative are one rotation, but qA and qB must agree in sign. With s ≥ 0
    they do, except near half a turn, where noise decides: such motions count little at first, and
    their signs follow from the first answer. Motions that do not turn say ``t_A = R_X t_B``, which
    is the same equation for quaternions 0, t; it decides only where nothing turns.
    """
    a, b = _quaternions(A[0]), _quaternions(B[0])
    # A turn so small (0.5°) that a motion is a translation, which has a hundredth to say.
    still = a[..., :1] > np.cos(np.radians(0.5) / 2)
    longest = np.linalg.norm(A[1], axis=-1).max(axis=-1, initial=0.0)[..., None, None]
    shift = 0.01 / np.where(longest > 0, longest, 1.0)
    a = np.where(still, _pure(shift * A[1]), a)
    b = np.where(still, _pure(shift * B[1]), b)
    sure = np.where(still, 1.0, (a + b)[..., :1])[..., None]
    first = _null_quaternion(_quaternion_rows(a, b) * sure)
    turned = _rotations(first)[..., None, :, :]
    moved = np.einsum("...ij,...j->...i", turned, b[..., 1:])
    agree = a[..., 0] * b[..., 0] + np.einsum("...i,...i->...", a[..., 1:], moved)
    b = np.where((agree < 0)[..., None] & ~still, -b, b)
    return _rotations(_null_quaternion(_quaternion_rows(a, b)))


def _pure(vector: FloatArray) -> FloatArray:
    """Quaternions 0, v."""
    return np.concatenate([np.zeros((*vector.shape[:-1], 1)), vector], axis=-1)


def _null_quaternion(rows: FloatArray) -> FloatArray:
    """Unit quaternion (..., 4) nearest to the null space of stacked blocks (..., n, 4, 4)."""
    stacked = rows.reshape(*rows.shape[:-3], -1, 4)
    return np.asarray(np.linalg.eigh(np.swapaxes(stacked, -1, -2) @ stacked)[1][..., :, 0])


def _quaternions(rotation: FloatArray) -> FloatArray:
    """Unit quaternions s, v with s ≥ 0."""
    return np.asarray(np.roll(quaternion_from_rotation(rotation), 1, axis=-1))


def _rotations(quaternion: FloatArray) -> FloatArray:
    return rotation_from_quaternion(np.roll(quaternion, -1, axis=-1))


def _quaternion_rows(a: FloatArray, b: FloatArray) -> FloatArray:
    """(..., n, 4, 4) blocks of the linear system in the quaternion s, v of X."""
    s, difference, total = a[..., 0] - b[..., 0], (a - b)[..., 1:], (a + b)[..., 1:]
    rows = np.zeros((*s.shape, 4, 4))
    rows[..., 0, 0] = s
    rows[..., 0, 1:], rows[..., 1:, 0] = -difference, difference
    rows[..., 1:, 1:] = s[..., None, None] * np.eye(3) + skew(total)
    return rows
