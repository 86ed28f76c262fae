"""Rotations and rigid transforms in NumPy; conventions as in `suta_calib.geometry`.

SciPy is imported where it is needed: who has no rotations need not wait for it.
"""

from __future__ import annotations

import warnings
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray

_Form = Literal["rotvec", "matrix", "quat"]
_SHAPE: Final[dict[_Form, tuple[int, ...]]] = {"rotvec": (3,), "matrix": (3, 3), "quat": (4,)}


def skew(v: ArrayLike) -> FloatArray:
    """Cross-product matrices of vectors: (..., 3) → (..., 3, 3), ``skew(a) @ b = a x b``."""
    v = np.asarray(v, dtype=float)
    matrix = np.zeros((*v.shape[:-1], 3, 3))
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return matrix - np.swapaxes(matrix, -1, -2)


def rotation_from_vector(vector: ArrayLike) -> FloatArray:
    """Rotation matrices of rotation vectors, rad: (..., 3) → (..., 3, 3)."""
    return _converted(vector, "rotvec", "matrix")


def vector_from_rotation(rotation: ArrayLike) -> FloatArray:
    """Rotation vectors of rotation matrices, rad, length at most π: (..., 3, 3) → (..., 3)."""
    return _converted(rotation, "matrix", "rotvec")


def rotation_from_quaternion(quaternion: ArrayLike) -> FloatArray:
    """Rotation matrices of quaternions x y z w, which need not be normalised: (..., 4)."""
    return _converted(quaternion, "quat", "matrix")


def quaternion_from_rotation(rotation: ArrayLike) -> FloatArray:
    """Quaternions x y z w of rotation matrices, w ≥ 0: (..., 3, 3) → (..., 4)."""
    return _converted(rotation, "matrix", "quat", canonical=True)


def _converted(values: ArrayLike, form: _Form, into: _Form, **options: bool) -> FloatArray:
    """SciPy's conversions between forms of a rotation, for any number of leading dimensions."""
    from scipy.spatial.transform import Rotation

    # A copy: SciPy 1.11 takes no array that is read-only.
    array, one = np.array(values, dtype=float), _SHAPE[form]
    rotation = getattr(Rotation, f"from_{form}")(array.reshape(-1, *one))
    found = getattr(rotation, f"as_{into}")(**options)
    many = array.shape[: array.ndim - len(one)]
    return np.asarray(found.reshape(*many, *_SHAPE[into]), dtype=float)


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
    return float(np.sqrt(np.mean(np.sum(np.asarray(vectors, dtype=float) ** 2, axis=-1))))


def extent(points: ArrayLike) -> float:
    """Root mean square distance of points (n, 3) from their middle, in their unit."""
    points = np.asarray(points, dtype=float)
    return rms_length(points - points.mean(axis=0))


def register_points(source: ArrayLike, target: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Least-squares rigid transform between corresponding points.

    Arun, Huang, Blostein (1987), doi:10.1109/TPAMI.1987.4767965, through SciPy's solution of
    Wahba's problem, which never answers with a reflection.

    Args:
        source: (n, 3) points in frame b, m.
        target: (n, 3) the same points in frame a, m.

    Returns:
        ``R`` (3x3) and ``p`` (3,) of ``T_a_b``: ``target ≈ source @ R.T + p``. Where the points
        leave a rotation undetermined (fewer than three, or all on a line) it is one of the
        equally good ones.
    """
    from scipy.spatial.transform import Rotation

    a, b = np.asarray(target, dtype=float), np.asarray(source, dtype=float)
    centre_a, centre_b = a.mean(axis=0), b.mean(axis=0)
    if len(a) == 1:
        return np.eye(3), centre_a - centre_b  # SciPy takes one vector for one to be met exactly
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Optimal rotation is not uniquely")
        rotation = Rotation.align_vectors(a - centre_a, b - centre_b)[0].as_matrix()
    return rotation, centre_a - rotation @ centre_b


def tangent_of_vector(vector: FloatArray) -> FloatArray:
    """Right Jacobian J of SO(3): ``exp(v + dv) = exp(v) exp(J dv)``.

    Args:
        vector: (3,) rotation vector, rad.

    Returns:
        (3, 3). Chirikjian (2012), Stochastic Models, Information Theory, and Lie Groups 2, eq.
        10.86.
    """
    angle = float(np.linalg.norm(vector))
    k = skew(vector)
    if angle < 1e-6:
        return np.asarray(np.eye(3) - k / 2)
    first = (1.0 - np.cos(angle)) / angle**2
    second = (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) - first * k + second * k @ k)
