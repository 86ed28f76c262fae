"""Rigid motions as screws: twists, and what of a motion no change of frames alters."""

from __future__ import annotations

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector, skew, vector_from_rotation


def twist_from_motion(rotation: FloatArray, position: FloatArray) -> FloatArray:
    """Logarithms (n, 6) of motions (n, 3, 3), (n, 3): rotation vector, rad, and velocity, m."""
    turn = vector_from_rotation(rotation)
    along = np.linalg.solve(_mean_rotation(turn), position[..., None])[..., 0]
    return np.concatenate([turn, along], axis=-1)


def motion_from_twist(twist: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The motions (n, 3, 3), (n, 3) of `twist_from_motion`."""
    turn = twist[..., :3]
    position = (_mean_rotation(turn) @ twist[..., 3:, None])[..., 0]
    return rotation_from_vector(turn), position


def screw_invariants(rotation: FloatArray, position: FloatArray) -> FloatArray:
    """(n, 2) of motions (n, 3, 3), (n, 3): the angle, rad, and angle times travel along the axis.

    Both stay as they are where the motion is seen from another frame, is of another frame on the
    same body, or is the inverse one. The second, rad·m, is smooth where the angle is zero, and the
    travel by itself is not.
    """
    turn = vector_from_rotation(rotation)
    return np.stack([np.linalg.norm(turn, axis=-1), (turn * position).sum(axis=-1)], axis=-1)


def _mean_rotation(turn: FloatArray) -> FloatArray:
    """(n, 3, 3) the mean of the rotations on the way to rotation vectors (n, 3)."""
    angle = np.linalg.norm(turn, axis=-1)[..., None, None]
    cross = skew(turn)
    near = angle < 1e-3  # there the next terms of the series are below rounding
    safe = np.where(near, 1.0, angle)
    first = np.where(near, 0.5 - angle**2 / 24.0, 2.0 * (np.sin(safe / 2.0) / safe) ** 2)
    second = np.where(near, 1.0 / 6.0 - angle**2 / 120.0, (safe - np.sin(safe)) / safe**3)
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)
