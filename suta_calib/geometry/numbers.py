"""Rotations and rigid transforms in NumPy; conventions as in `suta_calib.geometry`.

In NumPy alone: to import SciPy's rotations takes longer than most that is done with them. Formulas
are SciPy's, and the tests hold these to it.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import BoolArray, FloatArray

# Angle, rad, up to which a series is exact to rounding, and a quotient of rounded numbers is not.
_SMALL: Final = 1e-3


def skew(v: ArrayLike) -> FloatArray:
    """Cross-product matrices of vectors: (..., 3) → (..., 3, 3), ``skew(a) @ b = a x b``."""
    v = np.asarray(v, dtype=float)
    matrix = np.zeros((*v.shape[:-1], 3, 3))
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return matrix - np.swapaxes(matrix, -1, -2)


def rotation_from_vector(vector: ArrayLike) -> FloatArray:
    """Rotation matrices of rotation vectors, rad: (..., 3) → (..., 3, 3)."""
    vector = np.asarray(vector, dtype=float)
    angle = _length(vector)
    half = angle / 2.0
    factor = np.sin(half) / np.maximum(angle, _SMALL)
    if (small := angle <= _SMALL).any():
        square = angle**2
        factor = np.where(small, 0.5 - square / 48.0 + square**2 / 3840.0, factor)
    return _from_unit(factor[..., None] * vector, np.cos(half))


def vector_from_rotation(rotation: ArrayLike) -> FloatArray:
    """Rotation vectors of rotation matrices, rad, length at most π: (..., 3, 3) → (..., 3)."""
    quaternion = quaternion_from_rotation(rotation)
    axis, w = quaternion[..., :3], quaternion[..., 3]
    angle = 2.0 * np.arctan2(_length(axis), w)
    safe_angle = np.maximum(angle, _SMALL)
    factor = safe_angle / np.sin(safe_angle / 2.0)
    if (small := angle <= _SMALL).any():
        square = angle**2
        factor = np.where(small, 2.0 + square / 12.0 + 7.0 * square**2 / 2880.0, factor)
    return np.asarray(factor[..., None] * axis)


def rotation_from_quaternion(quaternion: ArrayLike) -> FloatArray:
    """Rotation matrices of quaternions x y z w, which need not be normalised: (..., 4).

    Raises:
        ValueError: a quaternion of norm zero.
    """
    quaternion = np.asarray(quaternion, dtype=float)
    norm = _length(quaternion)
    if not norm.all():
        raise ValueError("found a quaternion of norm zero; expected a rotation")
    unit = quaternion / norm[..., None]
    return _from_unit(unit[..., :3], unit[..., 3])


def quaternion_from_rotation(rotation: ArrayLike) -> FloatArray:
    """Quaternions x y z w of rotation matrices, w ≥ 0: (..., 3, 3) → (..., 4).

    Markley (2008), doi:10.2514/1.31730. A matrix that is a rotation but nearly stands for the
    nearest one.

    Raises:
        ValueError: a matrix that reflects, or is singular.
    """
    rotation = np.asarray(rotation, dtype=float)
    r = _by_number(rotation.reshape(-1, 3, 3))
    if not (_handed(r) > 0.0).all():
        raise ValueError("found a matrix of no positive determinant; expected a rotation")
    products = np.einsum("ijn,kjn->ikn", r, r)
    # How far from orthogonal the rows of a matrix may be that is taken for a rotation as it is.
    off = np.abs(products - _UNIT) > 1e-12
    if off.any():
        skewed = off.any(axis=(0, 1))
        left, _, right = np.linalg.svd(r[:, :, skewed].transpose(2, 0, 1))
        r[:, :, skewed] = (left @ right).transpose(1, 2, 0)
    # Four multiples of the quaternion, one by each of its numbers; the largest is rounded least.
    four = (_MULTIPLES @ r.reshape(9, -1) + _MULTIPLES_OF_NONE).reshape(4, 4, -1)
    largest = np.argmax(four.reshape(16, -1)[::5], axis=0)
    quaternion = four[largest, :, np.arange(len(largest))]
    quaternion /= _length(quaternion)[:, None]
    quaternion *= _canonical_sign(quaternion)[:, None]
    return np.asarray(quaternion.reshape(*rotation.shape[:-2], 4))


def _multiples() -> tuple[FloatArray, FloatArray]:
    """What makes ``4 q qᵀ`` (16,) of a rotation (9,) row by row: a matrix, and what is added."""
    of, none = np.zeros((4, 4, 3, 3)), np.eye(4)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        of[i, i] = np.diag(2.0 * (np.arange(3) == i) - 1.0)
        of[i, j, j, i] = of[i, j, i, j] = 1.0
        of[i, 3, k, j], of[i, 3, j, k] = 1.0, -1.0
        of[j, i], of[3, i] = of[i, j], of[i, 3]
    of[3, 3] = np.eye(3)
    return of.reshape(16, 9), none.reshape(16, 1)


_MULTIPLES, _MULTIPLES_OF_NONE = _multiples()
_UNIT: Final = np.eye(3)[:, :, None]
_NEXT, _AFTER = [1, 2, 0], [2, 0, 1]


def _by_number(matrices: FloatArray) -> FloatArray:
    """Matrices (n, 3, 3) as (3, 3, n), one number of all after the other.

    NumPy multiplies small matrices one by one, which takes ten times as long.
    """
    return np.array(matrices.transpose(1, 2, 0), order="C")


def _handed(rows: FloatArray) -> FloatArray:
    """Determinants (n,) of `_by_number`."""
    first, second, third = rows
    normal = second[_NEXT] * third[_AFTER] - second[_AFTER] * third[_NEXT]
    return np.asarray(np.add.reduce(first * normal))


def are_rotations(matrices: FloatArray) -> BoolArray:
    """Which of matrices of finite numbers, (n, 3, 3), are orthonormal and right-handed, (n,)."""
    rows = _by_number(matrices)
    off = np.abs(np.einsum("ijn,kjn->ikn", rows, rows) - _UNIT).max(axis=(0, 1))
    # By how much the product of two rows may be off in a matrix that somebody calls a rotation.
    return np.asarray((off <= 1e-6) & (_handed(rows) > 0.0))


def right_singular(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Singular values, descending, and all right singular vectors (n, n), rows, of rows (m, n).

    The left ones of many rows, (m, m), take more than all else: they are not made.
    """
    _, singular, vectors = np.linalg.svd(rows, full_matrices=len(rows) < rows.shape[1])
    return singular, vectors


def _length(vectors: FloatArray) -> FloatArray:
    """Length of vectors (..., n)."""
    # One number of all vectors after the other: NumPy adds few numbers of each row slowly.
    return np.asarray(np.sqrt(np.add.reduce((vectors * vectors).T)).T)


def _canonical_sign(quaternion: FloatArray) -> FloatArray:
    """1 or -1 for each (n, 4): of a rotation's two quaternions the one with w > 0 is meant.

    Of half a turn, where w is zero, the one whose first number of x, y, z is positive.
    """
    x, y, z, w = quaternion.T
    if w.all():
        return np.asarray(np.sign(w))
    first = np.where(x != 0.0, x, np.where(y != 0.0, y, z))
    return np.where(np.where(w != 0.0, w, first) < 0.0, -1.0, 1.0)


def _from_unit(axis: FloatArray, w: FloatArray) -> FloatArray:
    """Rotation matrices of unit quaternions, their x y z (..., 3) and w (...)."""
    x, y, z = axis[..., 0], axis[..., 1], axis[..., 2]
    xx, yy, zz, ww = x * x, y * y, z * z, w * w
    xy, zw, xz, yw, yz, xw = x * y, z * w, x * z, y * w, y * z, x * w
    matrix = np.empty((*w.shape, 3, 3))
    matrix[..., 0, 0] = xx - yy - zz + ww
    matrix[..., 1, 1] = -xx + yy - zz + ww
    matrix[..., 2, 2] = -xx - yy + zz + ww
    for i, j, product, turn in ((0, 1, xy, zw), (2, 0, xz, yw), (1, 2, yz, xw)):
        matrix[..., i, j], matrix[..., j, i] = 2.0 * (product - turn), 2.0 * (product + turn)
    return matrix


def random_rotations(random: np.random.Generator, count: int) -> FloatArray:
    """Rotation matrices, (count, 3, 3), evenly spread over all rotations."""
    # Shoemake (1992): a quaternion of normal numbers points anywhere.
    return rotation_from_quaternion(random.normal(size=(count, 4)))


def vector_turning_z_to(axis: ArrayLike) -> FloatArray:
    """Shortest rotation vectors, rad, that turn z to unit vectors (..., 3); π about x to -z."""
    axis = np.asarray(axis, dtype=float)
    x, y, z = np.moveaxis(axis, -1, 0)
    sine = np.hypot(x, y)
    factor = np.where(sine > 0, np.arctan2(sine, z) / np.maximum(sine, 1e-300), 1.0)
    vector = np.stack([-y * factor, x * factor, 0 * sine], axis=-1)
    vector[(sine == 0) & (z < 0)] = [np.pi, 0.0, 0.0]
    return vector


def rotation_from_rpy(rpy: ArrayLike) -> FloatArray:
    """URDF's fixed-axis roll, pitch, yaw in rad: ``R = Rz(yaw) Ry(pitch) Rx(roll)``."""
    rpy = np.asarray(rpy, dtype=float)
    cosine, sine = np.cos(rpy), np.sin(rpy)
    (cr, cp, cy), (sr, sp, sy) = cosine, sine
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rpy_from_rotation(rotation: ArrayLike) -> FloatArray:
    """Roll, pitch, yaw (rad) that give back ``rotation`` to rounding, at any pitch.

    Roll is read after the yaw has been taken out, so that the three angles stay consistent with
    each other even where roll and yaw are no longer determined one by one (pitch = ±90°).
    """
    r = np.asarray(rotation, dtype=float)
    yaw = np.arctan2(r[1, 0], r[0, 0])
    unyawed = rotation_from_rpy([0.0, 0.0, yaw]).T @ r
    pitch = np.arctan2(-unyawed[2, 0], unyawed[0, 0])
    roll = np.arctan2(-unyawed[1, 2], unyawed[1, 1])
    return np.array([roll, pitch, yaw])


def wrap(angle: ArrayLike) -> FloatArray:
    """Angles wrapped to (-π, π], rad; one that is there already keeps every bit."""
    angle = np.asarray(angle, dtype=float)
    return np.asarray(angle - 2 * np.pi * np.ceil((angle - np.pi) / (2 * np.pi)), dtype=float)


def homogeneous(rotation: ArrayLike, position: ArrayLike) -> FloatArray:
    """Stack a rotation (3x3) and a position (3,) into a 4x4 matrix."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = np.asarray(position, dtype=float)
    return matrix


def rms_length(vectors: ArrayLike) -> float:
    """Root mean square length of vectors (..., 3), in their unit."""
    vectors = np.asarray(vectors, dtype=float)
    # Without room for the squares, which of many vectors takes longer than to add them up.
    squares = float(np.vdot(vectors, vectors))
    return float(np.sqrt(squares * vectors.shape[-1] / vectors.size)) if vectors.size else np.nan


def extent(points: ArrayLike) -> float:
    """Root mean square distance of points (n, 3) from their middle, in their unit."""
    points = np.asarray(points, dtype=float)
    return rms_length(points - points.mean(axis=0))


def register_points(source: ArrayLike, target: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Least-squares rigid transforms between corresponding points, of one set or of many.

    Arun, Huang, Blostein (1987), doi:10.1109/TPAMI.1987.4767965, with Umeyama's sign (1991),
    doi:10.1109/34.88573: never a reflection.

    Args:
        source: (..., n, 3) points in frame b, m.
        target: (..., n, 3) the same points in frame a, m.

    Returns:
        ``R`` (..., 3, 3) and ``p`` (..., 3) of ``T_a_b``: ``target ≈ source @ R.T + p``. Where the
        points leave a rotation undetermined (fewer than three, or all on a line) it is one of the
        equally good ones.
    """
    a, b = np.asarray(target, dtype=float), np.asarray(source, dtype=float)
    centre_a, centre_b = a.mean(axis=-2, keepdims=True), b.mean(axis=-2, keepdims=True)
    rotation = nearest_rotation(np.swapaxes(a - centre_a, -1, -2) @ (b - centre_b))
    position = centre_a[..., 0, :] - (rotation @ centre_b[..., 0, :, None])[..., 0]
    return rotation, position


def nearest_rotation(matrix: FloatArray) -> FloatArray:
    """Rotations (..., 3, 3) with the least sum of squared differences to matrices (..., 3, 3).

    Of the sums over points of target times source, each from its middle, they are those that turn
    the points onto the others best; of sums of rotations, their chordal mean.
    """
    left, _, right = np.linalg.svd(matrix)
    left[..., -1] *= np.sign(np.linalg.det(left @ right))[..., None]
    return np.asarray(left @ right)


def tangent_of_vector(vector: FloatArray) -> FloatArray:
    """Right Jacobian J (3, 3) of SO(3) at v (3,), rad: ``exp(v + dv) = exp(v) exp(J dv)``.

    Chirikjian (2012), Stochastic Models, Information Theory, and Lie Groups 2, eq. 10.86.
    """
    angle = float(np.linalg.norm(vector))
    k = skew(vector)
    if angle < 1e-6:
        return np.asarray(np.eye(3) - k / 2)
    first = (1.0 - np.cos(angle)) / angle**2
    second = (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) - first * k + second * k @ k)


def tangent_of_poses(x: FloatArray, length: float = 1.0) -> FloatArray:
    """Derivative (6k, 6k) of displacements and small turns, in the poses' own axes, by poses x.

    Args:
        x: (6k,) position and rotation vector of each, rad.
        length: m per unit of the positions.
    """
    matrix = np.diag(np.tile(np.repeat([length, 1.0], 3), len(x) // 6))
    for first in range(3, len(x), 6):
        turn = slice(first, first + 3)
        matrix[turn, turn] = tangent_of_vector(x[turn])
    return matrix
