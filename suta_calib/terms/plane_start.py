"""Where an eye is that sees points on planes, and where these are: the solver's start.

    n_k · (R_i (R z + t) + p_i) = d_k    for every point z of plane k that was seen at pose i

For a rotation R of the eye and planes that are known, t and all d are linear; for an eye that is
known each plane is that of least squares through its points. Many rotations all about begin so, in
turn, and the best of them go on by Gauss and Newton. What the poses leave undetermined stays small.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.geometry.numbers import (
    random_rotations,
    right_singular,
    rotation_from_vector,
)
from suta_calib.terms.hand_eye_start import Poses

# Rotations that are tried, some 20° apart, and those of them that go on.
_ROTATIONS: Final = 500
_BEST: Final = 6
# Rows that choose the rotation, of many.
_ROWS: Final = 400
# Relative singular value below which a direction is not determined at all.
_ROUNDING: Final = 1e-9


@dataclass(frozen=True, eq=False)
class EyeAndPlanes:
    """An eye and what it sees.

    Attributes:
        rotation: (3, 3) of the eye in its carrier.
        position: (3,) of the eye in its carrier, m.
        normal: (k, 3) of the planes, in what does not carry the eye.
        distance: (k,) of the planes from its origin, along the normals, m.
    """

    rotation: FloatArray
    position: FloatArray
    normal: FloatArray
    distance: FloatArray


def eye_and_planes(carrier: Poses, points: FloatArray, plane: IntArray) -> EyeAndPlanes:
    """The eye and the planes that fit best.

    Args:
        carrier: poses (n, 3, 3) and (n, 3), m, of what carries the eye.
        points: (n, 3) in the eye, m.
        plane: (n,) which plane each is on, from 0.
    """
    few = np.unique(np.linspace(0, len(points) - 1, min(len(points), _ROWS)).astype(np.intp))
    turns = np.concatenate(
        [np.eye(3)[None], random_rotations(np.random.default_rng(0), _ROTATIONS)]
    )
    some = (carrier[0][few], carrier[1][few]), points[few], plane[few]
    begun = [_by_turns(*some, turn) for turn in turns]
    order = np.argsort([misfit for misfit, _ in begun], kind="stable")[:_BEST]
    ended = [_descended(*some, begun[k][1]) for k in order.tolist()]
    best = min(ended, key=lambda end: end[0])[1]
    return _descended(carrier, points, plane, best)[1]


def _planes(points: FloatArray, plane: IntArray) -> tuple[FloatArray, FloatArray]:
    """Normals (k, 3) and distances (k,) of the planes of least squares through points (n, 3)."""
    count = int(plane.max(initial=0)) + 1
    normals, distances = np.tile([0.0, 0.0, 1.0], (count, 1)), np.zeros(count)
    for k in range(count):
        mine = points[plane == k]
        if len(mine):
            middle = mine.mean(axis=0)
            normals[k] = right_singular(mine - middle)[1][2]
            distances[k] = normals[k] @ middle
    return normals, distances


def _by_turns(
    carrier: Poses, points: FloatArray, plane: IntArray, R: FloatArray
) -> tuple[float, EyeAndPlanes]:
    """Planes for a place of the eye, and its place for planes, in turn; and what is left, m²."""
    rotation, position = carrier
    turned = np.einsum("nij,nj->ni", rotation, points @ R.T) + position
    t = np.zeros(3)
    for _ in range(3):
        normal, _ = _planes(turned + rotation @ t, plane)
        of_row = normal[plane]
        columns = np.einsum("nij,ni->nj", rotation, of_row)
        height = np.einsum("ni,ni->n", of_row, turned)
        t = -_solved(_without_means(columns, plane), _without_means(height[:, None], plane)[:, 0])
    at = turned + rotation @ t
    normal, distance = _planes(at, plane)
    left = np.einsum("ni,ni->n", normal[plane], at) - distance[plane]
    return float(left @ left), EyeAndPlanes(R, t, normal, distance)


def _without_means(columns: FloatArray, plane: IntArray) -> FloatArray:
    """Columns (n, m) without their means over the rows of each plane."""
    count = np.maximum(np.bincount(plane), 1)
    sums = np.zeros((len(count), columns.shape[1]))
    np.add.at(sums, plane, columns)
    return np.asarray(columns - (sums / count[:, None])[plane])


def _descended(
    carrier: Poses, points: FloatArray, plane: IntArray, first: EyeAndPlanes
) -> tuple[float, EyeAndPlanes]:
    """Sum of squared heights, m², and the end of a descent by Levenberg and Marquardt."""
    rotation, position = carrier
    count = len(first.distance)

    def heights(eye: EyeAndPlanes) -> tuple[FloatArray, FloatArray, FloatArray]:
        lever = points @ eye.rotation.T
        at = np.einsum("nij,nj->ni", rotation, lever + eye.position) + position
        left = np.einsum("ni,ni->n", eye.normal[plane], at) - eye.distance[plane]
        return left, at, lever

    eye, damping = first, 1e-3
    left, at, lever = heights(eye)
    for _ in range(40):
        seen = np.einsum("nij,ni->nj", rotation, eye.normal[plane])
        across = np.array([right_singular(n[None])[1][1:] for n in eye.normal])
        columns = np.zeros((len(left), 6 + 3 * count))
        columns[:, :3], columns[:, 3:6] = np.cross(lever, seen), seen
        rows, begin = np.arange(len(left)), 6 + 3 * plane
        for k in range(2):
            columns[rows, begin + k] = np.einsum("ni,ni->n", across[plane, k], at)
        columns[rows, begin + 2] = -1.0
        square, pull = columns.T @ columns, columns.T @ left
        scale = np.maximum(np.diag(square), 1e-12)
        step = -np.linalg.solve(square + damping * np.diag(scale), pull)
        moved = eye.normal + np.einsum("kj,kji->ki", step[6:].reshape(-1, 3)[:, :2], across)
        other = EyeAndPlanes(
            rotation_from_vector(step[:3]) @ eye.rotation,
            eye.position + step[3:6],
            moved / np.linalg.norm(moved, axis=1, keepdims=True),
            eye.distance + step[8::3],
        )
        after = heights(other)
        before = float(left @ left)
        gained = before - float(after[0] @ after[0])
        if gained > 0:
            eye, (left, at, lever), damping = other, after, max(damping / 5.0, 1e-12)
        else:
            damping *= 10.0
        # A step that takes no more of the squared heights is the last.
        if (0 <= gained < 1e-9 * before) or damping > 1e6:
            break
    return float(left @ left), eye


def _solved(columns: FloatArray, right: FloatArray) -> FloatArray:
    """Smallest solution (m,) of equations (n, m)."""
    return np.asarray(np.linalg.lstsq(columns, right, rcond=_ROUNDING)[0])
