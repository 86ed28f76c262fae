"""Where an eye is that sees points on planes, and where these are: the solver's start.

    n_k · (R_i (R z + t) + p_i) = d_k    for every point z of plane k that was seen at pose i

For a rotation R of the eye and planes that are known, t and all d are linear; for an eye that is
known each plane is that of least squares through its points. Many rotations all about begin so, in
turn, and the best of them go on by Gauss and Newton. An eye is near its carrier, as far as heights
that are left say nothing else: what the poses leave undetermined stays small.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.geometry.numbers import (
    random_rotations,
    right_singular,
    rotation_from_vector,
)
from suta_calib.terms.hand_eye_start import Poses

# Singular value, of the largest, that is rounding.
_ROUNDING: Final = 1e-9
# How far an eye is from the origin of its carrier, m, where nothing else is known.
_NEAR: Final = 0.3


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

    @cached_property
    def across(self) -> FloatArray:
        """(k, 2, 3) two directions in each plane."""
        return np.array([right_singular(normal[None])[1][1:] for normal in self.normal])


def eye_and_planes(carrier: Poses, points: FloatArray, plane: IntArray) -> EyeAndPlanes:
    """The eye and the planes that fit best.

    Args:
        carrier: poses (n, 3, 3) and (n, 3), m, of what carries the eye.
        points: (n, 3) in the eye, m.
        plane: (n,) which plane each is on, from 0.
    """
    # Rows that choose the rotation, of many.
    few = np.unique(np.linspace(0, len(points) - 1, min(len(points), 200)).astype(np.intp))
    # Some 25° apart.
    turns = random_rotations(np.random.default_rng(0), 250)
    subset = (carrier[0][few], carrier[1][few]), points[few], plane[few]
    # Where every plane is numbered, also one of which no row was taken.
    count = int(plane.max(initial=0)) + 1
    misfit, position, normal, distance = _by_turns(*subset, turns, count)
    # So many rotations go on.
    order = np.argsort(misfit, kind="stable")[:4].tolist()
    begun = (EyeAndPlanes(turns[k], position[k], normal[k], distance[k]) for k in order)
    # So many steps tell which of them ends well; the best one then goes on.
    few_steps, steps = 12, 40
    ended = [_descended(*subset, first, few_steps) for first in begun]
    best = min(ended, key=lambda end: end[0])[1]
    return _descended(carrier, points, plane, best, steps)[1]


def _planes(points: FloatArray, plane: IntArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Normals (m, k, 3) and distances (m, k) of the planes through points (m, n, 3)."""
    normals, distances = np.zeros((len(points), count, 3)), np.zeros((len(points), count))
    normals[:, :, 2] = 1.0
    for k in np.unique(plane):
        mine = points[:, plane == k]
        middle = mine.mean(axis=1)
        about = mine - middle[:, None]
        normals[:, k] = np.linalg.eigh(np.swapaxes(about, 1, 2) @ about)[1][:, :, 0]
        distances[:, k] = np.einsum("mi,mi->m", normals[:, k], middle)
    return normals, distances


def _by_turns(
    carrier: Poses, points: FloatArray, plane: IntArray, turns: FloatArray, count: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """For each rotation (m, 3, 3) of the eye its place and the planes, one after the other in turn.

    Returns:
        What is left (m,), m²; places (m, 3); and normals (m, k, 3) and distances (m, k).
    """
    rotation, position = carrier
    lever = np.einsum("mij,nj->mni", turns, points)
    turned = np.einsum("nij,mnj->mni", rotation, lever) + position
    t = np.zeros((len(turns), 3))
    for _ in range(3):
        at = turned + np.einsum("nij,mj->mni", rotation, t)
        normal, distance = _planes(at, plane, count)
        of_row = normal[:, plane]
        columns = _without_means(np.einsum("nij,mni->mnj", rotation, of_row), plane)
        height = _without_means(np.einsum("mni,mni->mn", of_row, turned)[..., None], plane)
        off = np.einsum("mni,mni->mn", of_row, at) - distance[:, plane]
        prior = np.mean(off**2, axis=1) / _NEAR**2 + 1e-12
        square = np.swapaxes(columns, 1, 2) @ columns + prior[:, None, None] * np.eye(3)
        t = -np.linalg.solve(square, np.swapaxes(columns, 1, 2) @ height)[..., 0]
    at = turned + np.einsum("nij,mj->mni", rotation, t)
    normal, distance = _planes(at, plane, count)
    left = np.einsum("mni,mni->mn", normal[:, plane], at) - distance[:, plane]
    return np.sum(left**2, axis=1), t, normal, distance


def _without_means(columns: FloatArray, plane: IntArray) -> FloatArray:
    """Columns (m, n, c) without their means over the rows of each plane."""
    centred = columns.copy()
    for k in np.unique(plane):
        rows = plane == k
        centred[:, rows] -= columns[:, rows].mean(axis=1, keepdims=True)
    return centred


def _descended(
    carrier: Poses, points: FloatArray, plane: IntArray, first: EyeAndPlanes, steps: int
) -> tuple[float, EyeAndPlanes]:
    """Sum of squared heights, m², and the end of a descent by Levenberg and Marquardt."""
    eye, damping = first, 1e-2
    left, columns = _linearised(carrier, points, plane, eye)
    for _ in range(steps):
        scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-6)
        # What is left weighs the prior of the place of the eye.
        root = float(np.sqrt(left @ left / len(left))) / _NEAR
        prior = np.eye(3, columns.shape[1]) * root
        basis, size, vectors = np.linalg.svd(np.vstack([columns, prior]) / scale, False)
        inverse = np.where(size > _ROUNDING * size[0], size / (size**2 + damping), 0.0)
        every = np.concatenate([left, root * eye.position])
        step = -(vectors.T @ (inverse * (basis.T @ every))) / scale
        of_planes = step[6:].reshape(-1, 3)
        moved = eye.normal + np.einsum("kj,kji->ki", of_planes[:, :2], eye.across)
        other = EyeAndPlanes(
            rotation_from_vector(step[3:6]) @ eye.rotation,
            eye.position + step[:3],
            moved / np.linalg.norm(moved, axis=1, keepdims=True),
            eye.distance + of_planes[:, 2],
        )
        after = _linearised(carrier, points, plane, other)
        before = float(every @ every)
        gained = (
            before - float(after[0] @ after[0]) - root**2 * float(other.position @ other.position)
        )
        if gained > 0:
            eye, (left, columns), damping = other, after, max(damping / 5.0, 1e-12)
        else:
            damping *= 10.0
        # A step that takes no more of the squared heights is the last.
        if (0 <= gained < 1e-9 * before) or damping > 1e6:
            break
    return float(left @ left), eye


def _linearised(
    carrier: Poses, points: FloatArray, plane: IntArray, eye: EyeAndPlanes
) -> tuple[FloatArray, FloatArray]:
    """Heights (n,), m, and their derivatives (n, 6 + 3k): by the eye, place first, and planes."""
    rotation, position = carrier
    lever = points @ eye.rotation.T
    at = np.einsum("nij,nj->ni", rotation, lever + eye.position) + position
    of_row = eye.normal[plane]
    normal = np.einsum("nij,ni->nj", rotation, of_row)
    columns = np.zeros((len(points), 6 + 3 * len(eye.distance)))
    columns[:, :3], columns[:, 3:6] = normal, np.cross(lever, normal)
    rows, begin = np.arange(len(points)), 6 + 3 * plane
    for k in range(2):
        columns[rows, begin + k] = np.einsum("ni,ni->n", eye.across[plane, k], at)
    columns[rows, begin + 2] = -1.0
    return np.einsum("ni,ni->n", of_row, at) - eye.distance[plane], columns


def open_motions(
    carrier: Poses, points: FloatArray, plane: IntArray, eye: EyeAndPlanes
) -> FloatArray:
    """Motions of the eye that the planes do not see, whatever the planes do then.

    Returns:
        (k, 6) orthonormal: displacements in the axes of the carrier, and turns about these, of
        which a radian counts as `_LEVER`.
    """
    left, columns = _linearised(carrier, points, plane, eye)
    # What an angle is worth beside a length, m per rad: how far the eye looks.
    of_eye = columns[:, :6] / np.repeat([1.0, 0.5], 3)
    # Planes follow: only what they cannot take up is seen of the eye. Each by itself, about its
    # middle, so that lengths are alike.
    followed = of_eye.copy()
    for k in range(len(eye.distance)):
        rows = np.flatnonzero(plane == k)
        mine = columns[rows][:, 6 + 3 * k : 9 + 3 * k]
        mine = np.column_stack([mine[:, :2] - mine[:, :2].mean(axis=0), mine[:, 2]])
        basis, size, _ = np.linalg.svd(mine, full_matrices=False)
        basis = basis[:, size > _ROUNDING * size[0]]
        followed[rows] -= basis @ (basis.T @ followed[rows])
    _, size, vectors = np.linalg.svd(followed)
    freedom = max(len(left) - columns.shape[1], 1)
    # No depth camera and no arm errs by less than a tenth of a millimetre.
    scatter = max(float(np.sqrt(left @ left / freedom)), 1e-4)
    # Standard deviation from which on a motion of the eye is not determined, m.
    return np.asarray(vectors[scatter > 0.02 * size])
