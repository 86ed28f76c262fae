"""Where an instrument stands and where its targets sit on the tip's link: the solver's start.

    z_i = R (R_i t_k + p_i) + b    for every sample i of every target k

Gauss–Newton on the turn, b and all t from two beginnings: the tip seen in place of its targets,
which is right where they are near it; and the inverse of R as any matrix W, which makes
``p_i = W z_i + w - R_i t_k`` linear. What the poses leave undetermined stays as it begins.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.geometry.numbers import (
    nearest_rotation,
    register_points,
    rotation_from_vector,
    skew,
)

if TYPE_CHECKING:
    from suta_calib.terms.hand_eye_start import Poses

# Relative singular value below which a direction is not determined at all.
_ROUNDING: Final = 1e-9
_STEPS: Final = 30
# A step that takes no more of the squared residuals is the last.
_GAIN: Final = 1e-9


def instrument_and_targets(
    arm: Poses, seen: FloatArray, target: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The instrument and its targets that fit best.

    Args:
        arm: ``T_base_tip``, rotations (n, 3, 3) and positions (n, 3), m.
        seen: (n, 3) the targets in the instrument, m.
        target: (n,) which target each row saw, from 0.

    Returns:
        ``T_instrument_base``, rotation (3, 3) and position (3,), and the targets in the tip (k, 3).
    """
    found = [_refined(arm, seen, target, first) for first in _beginnings(arm, seen, target)]
    return min(found, key=lambda each: each[0])[1]


Unknowns = tuple[FloatArray, FloatArray, FloatArray]


def _beginnings(arm: Poses, seen: FloatArray, target: IntArray) -> Iterator[Unknowns]:
    rotation, position = arm
    n, count = len(seen), int(target.max()) + 1
    yield *register_points(position, seen), np.zeros((count, 3))
    # Unknowns: W by rows, w, then the targets. About the middle, so that lengths are alike.
    middle = seen.mean(axis=0)
    columns = np.zeros((n, 3, 12 + 3 * count))
    for axis in range(3):
        columns[:, axis, 3 * axis : 3 * axis + 3] = seen - middle
        columns[:, axis, 9 + axis] = 1.0
    columns[:, :, 12:] = -_of_targets(rotation, target, count)
    solved = _least_squares(columns, position)
    back = nearest_rotation(solved[:9].reshape(3, 3))
    targets = solved[12:].reshape(count, 3)
    points = position + np.einsum("nij,nj->ni", rotation, targets[target])
    yield back.T, (seen - points @ back).mean(axis=0), targets


def _refined(
    arm: Poses, seen: FloatArray, target: IntArray, first: Unknowns
) -> tuple[float, Unknowns]:
    """Sum of squared residuals, and the unknowns, at the end of the descent."""
    rotation, position = arm
    (R, b, targets), count = first, len(first[2])
    sits = _of_targets(rotation, target, count)

    def left(R: FloatArray, b: FloatArray, targets: FloatArray) -> tuple[FloatArray, FloatArray]:
        lever = (position + sits @ targets.reshape(-1)) @ R.T
        return seen - lever - b, lever

    residual, lever = left(R, b, targets)
    for _ in range(_STEPS):
        shift = np.broadcast_to(np.eye(3), (len(seen), 3, 3))
        columns = np.concatenate([-skew(lever), shift, R @ sits], axis=2)
        step = _least_squares(columns, residual)
        moved = (
            rotation_from_vector(step[:3]) @ R,
            b + step[3:6],
            targets + step[6:].reshape(count, 3),
        )
        after, lever_after = left(*moved)
        before = float(np.sum(residual**2))
        if not np.sum(after**2) < (1.0 - _GAIN) * before:
            break
        (R, b, targets), residual, lever = moved, after, lever_after
    return float(np.sum(residual**2)), (R, b, targets)


def _of_targets(rotation: FloatArray, target: IntArray, count: int) -> FloatArray:
    """(n, 3, 3 count) derivatives of where each row's target is, in the base, by all targets."""
    columns = np.zeros((len(target), 3, count, 3))
    columns[np.arange(len(target)), :, target] = rotation
    return columns.reshape(len(target), 3, 3 * count)


def _least_squares(columns: FloatArray, right: FloatArray) -> FloatArray:
    """Smallest solution (m,) of stacked equations (n, 3, m), columns scaled to one size."""
    matrix = columns.reshape(-1, columns.shape[2])
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(matrix / size, right.reshape(-1), rcond=_ROUNDING)[0] / size)
