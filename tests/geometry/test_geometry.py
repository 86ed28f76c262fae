"""Rotations and transforms against identities and against finite differences."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm, polar
from scipy.spatial.transform import Rotation

from suta_calib.geometry.numbers import (
    are_rotations,
    extent,
    homogeneous,
    quaternion_from_rotation,
    random_rotations,
    register_points,
    right_singular,
    rms_length,
    rotation_from_quaternion,
    rotation_from_rpy,
    rotation_from_vector,
    rpy_from_rotation,
    skew,
    vector_from_rotation,
)
from suta_calib.geometry.symbols import symbolic_chordal_log, symbolic_rotation, symbolic_skew

ANGLE = st.floats(-math.pi, math.pi)
PITCH = st.one_of(ANGLE, st.sampled_from([math.pi / 2, -math.pi / 2, 1.5707963, -1.57079632]))
VECTOR = st.tuples(ANGLE, ANGLE, ANGLE).map(np.array)
POSITION = st.tuples(*[st.floats(-10, 10)] * 3).map(np.array)
# Below, at and above the angle (1e-2 rad) at which the series gives way to the sine.
NEAR_THE_SWITCH = [0.0, 1e-12, 1e-6, 0.0099, 0.01 - 1e-9, 0.01 + 1e-9, 0.0101, 0.3, 3.0]

_v = ca.SX.sym("v", 3)
_R = ca.vec(symbolic_rotation(_v))
_J = ca.jacobian(_R, _v)
rotation_function = ca.Function("R", [_v], [_R, _J, ca.jacobian(ca.vec(_J), _v)])


@given(VECTOR)
def test_the_exponential_is_the_matrix_exponential(vector: np.ndarray) -> None:
    np.testing.assert_allclose(rotation_from_vector(vector), expm(skew(vector)), atol=1e-13)


@given(ANGLE, PITCH, ANGLE)
def test_roll_pitch_yaw_give_back_the_rotation(roll: float, pitch: float, yaw: float) -> None:
    R = rotation_from_rpy([roll, pitch, yaw])
    expected = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
    np.testing.assert_allclose(R, expected, atol=1e-14)
    np.testing.assert_allclose(rotation_from_rpy(rpy_from_rotation(R)), R, atol=1e-13)


@given(ANGLE, st.floats(-1.5, 1.5), ANGLE)
def test_roll_pitch_yaw_are_unique_away_from_the_poles(
    roll: float, pitch: float, yaw: float
) -> None:
    found = rpy_from_rotation(rotation_from_rpy([roll, pitch, yaw]))
    difference = np.remainder(found - [roll, pitch, yaw] + math.pi, 2 * math.pi) - math.pi
    np.testing.assert_allclose(difference, 0.0, atol=1e-13)


@given(VECTOR, POSITION)
def test_the_cross_product_matrix_in_both_worlds(a: np.ndarray, b: np.ndarray) -> None:
    np.testing.assert_allclose(skew(a) @ b, np.cross(a, b), atol=1e-13)
    np.testing.assert_array_equal(np.array(symbolic_skew(ca.DM(a))), skew(a))


def test_stacks_keep_their_shape() -> None:
    vectors = np.random.default_rng(0).normal(size=(2, 5, 3))
    R = rotation_from_vector(vectors)
    assert R.shape == (2, 5, 3, 3)
    np.testing.assert_array_equal(R[1, 3], rotation_from_vector(vectors[1, 3]))
    np.testing.assert_allclose(vector_from_rotation(R)[0, 4], vectors[0, 4], atol=1e-12)
    assert skew(vectors).shape == (2, 5, 3, 3)
    assert rotation_from_quaternion(np.ones((2, 5, 4))).shape == (2, 5, 3, 3)


@given(VECTOR, POSITION, POSITION)
def test_homogeneous_matrices_map_points(
    vector: np.ndarray, position: np.ndarray, point: np.ndarray
) -> None:
    R = rotation_from_vector(vector)
    mapped = homogeneous(R, position) @ [*point, 1.0]
    np.testing.assert_allclose(mapped, [*(R @ point + position), 1.0], atol=1e-12)


@given(VECTOR)
def test_the_symbolic_rotation_equals_the_numeric_one(vector: np.ndarray) -> None:
    found = np.array(rotation_function(vector)[0]).reshape(3, 3, order="F")
    np.testing.assert_allclose(found, rotation_from_vector(vector), atol=1e-14)


@pytest.mark.parametrize("angle", NEAR_THE_SWITCH)
@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 0, 1), (0.6, -0.48, 0.64)])
def test_derivatives_of_the_symbolic_rotation(angle: float, axis: tuple[float, ...]) -> None:
    """First and second derivatives, by central differences of something else's values."""
    v = angle * np.array(axis)
    value, first, second = (np.array(o) for o in rotation_function(v))
    np.testing.assert_allclose(value, _flat_rotation(v), atol=1e-15)
    np.testing.assert_allclose(first, _central(_flat_rotation, v, 1e-5), atol=1e-9)
    other_first = _central(lambda u: _central(_flat_rotation, u, 1e-3).reshape(-1, 1), v, 1e-3)
    by_columns = other_first.reshape(9, 3, 3).transpose(1, 0, 2).reshape(27, 3)
    np.testing.assert_allclose(second, by_columns, atol=2e-6)


def _flat_rotation(vector: np.ndarray) -> np.ndarray:
    return expm(skew(vector)).reshape(-1, 1, order="F")


def _central(function, at: np.ndarray, step: float) -> np.ndarray:
    columns = [function(at + h) - function(at - h) for h in step * np.eye(len(at))]
    return np.hstack(columns) / (2 * step)


def test_the_symbolic_rotation_at_zero_is_the_generator() -> None:
    """d(exp v)/dv_k = [e_k]x, and d²/dv_j dv_k = the symmetric part of [e_j]x [e_k]x."""
    _, first, second = (np.array(o) for o in rotation_function(np.zeros(3)))
    second = second.reshape(9, 3, 3, order="F")
    K = [skew(e) for e in np.eye(3)]
    for k in range(3):
        np.testing.assert_array_equal(first[:, k], K[k].reshape(-1, order="F"))
        for j in range(3):
            both = (K[j] @ K[k] + K[k] @ K[j]) / 2
            np.testing.assert_allclose(second[:, k, j], both.reshape(-1, order="F"), atol=1e-15)


@given(VECTOR.filter(lambda v: 1e-3 < np.linalg.norm(v) < 3.1))
def test_the_rotation_error_is_twice_the_sine_of_half_the_angle(vector: np.ndarray) -> None:
    error = np.array(symbolic_chordal_log(ca.DM(rotation_from_vector(vector)))).reshape(-1)
    angle = np.linalg.norm(vector)
    np.testing.assert_allclose(error, vector / angle * 2 * math.sin(angle / 2), atol=1e-9)


def test_the_rotation_error_is_smooth_at_zero() -> None:
    v = ca.SX.sym("v", 3)
    error = symbolic_chordal_log(symbolic_rotation(v))
    first = ca.jacobian(error, v)
    evaluate = ca.Function("e", [v], [error, first, ca.jacobian(first, v)])
    value, jacobian, curvature = (np.array(o) for o in evaluate(np.zeros(3)))
    np.testing.assert_array_equal(value, 0.0)
    np.testing.assert_allclose(jacobian, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(curvature, 0.0, atol=1e-15)


@given(VECTOR, POSITION, st.integers(3, 12), st.integers(0, 1000))
def test_registration_recovers_a_transform(
    vector: np.ndarray, position: np.ndarray, count: int, seed: int
) -> None:
    source = np.random.default_rng(seed).normal(size=(count, 3))
    R = rotation_from_vector(vector)
    found_R, found_p = register_points(source, source @ R.T + position)
    np.testing.assert_allclose(found_R, R, atol=1e-9)
    np.testing.assert_allclose(found_p, position, atol=1e-9)


@given(st.integers(0, 1000), st.sampled_from([1, 2, 3, 8]))
def test_registration_never_mirrors(seed: int, count: int) -> None:
    """Not even onto a mirror image, onto noise, or where the points tell nothing."""
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(count, 3))
    for target in (source * [1.0, 1.0, -1.0], rng.normal(size=(count, 3)), np.zeros((count, 3))):
        R, p = register_points(source, target)
        assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-9)
        assert np.isfinite(p).all()


def test_many_sets_are_registered_as_each_by_itself() -> None:
    rng = np.random.default_rng(1)
    source, target = rng.normal(size=(2, 5, 4, 3))
    R, p = register_points(source, target)
    for k in range(5):
        alone = register_points(source[k], target[k])
        np.testing.assert_allclose(R[k], alone[0], atol=1e-12)
        np.testing.assert_allclose(p[k], alone[1], atol=1e-12)


def test_registration_of_noisy_points_is_the_least_squares_one() -> None:
    rng = np.random.default_rng(0)
    source = rng.normal(size=(10, 3))
    target = source @ rotation_from_vector([0.5, -1, 2]).T + 0.1 * rng.normal(size=(10, 3))
    R, p = register_points(source, target)

    def cost(turn: np.ndarray, shift: np.ndarray) -> float:
        return float(
            np.sum((target - source @ (R @ rotation_from_vector(turn)).T - p - shift) ** 2)
        )

    best = cost(np.zeros(3), np.zeros(3))
    for step in 1e-4 * np.vstack([np.eye(6), -np.eye(6)]):
        assert cost(step[:3], step[3:]) > best


def test_lengths_and_extents() -> None:
    assert rms_length([[3.0, 0.0, 4.0], [0.0, 0.0, 0.0]]) == pytest.approx(math.sqrt(12.5))
    points = np.random.default_rng(0).normal(size=(4, 5, 3))
    assert rms_length(points) == pytest.approx(rms_length(points.reshape(-1, 3)))
    assert extent(points[0] + 7.0) == pytest.approx(math.sqrt(points[0].var(axis=0).sum()))
    assert extent(np.ones((5, 3))) == 0.0


@given(VECTOR)
def test_quaternions_give_back_their_rotation_and_have_one_sign(vector: np.ndarray) -> None:
    R = rotation_from_vector(vector)
    quaternion = quaternion_from_rotation(R)
    assert quaternion.shape == (4,)
    assert quaternion[3] >= 0
    np.testing.assert_allclose(rotation_from_quaternion(quaternion), R, atol=1e-12)
    assert quaternion_from_rotation(np.tile(R, (2, 3, 1, 1))).shape == (2, 3, 4)


HALF_TURNS = np.pi * np.array(
    [[1, 0, 0], [0, -1, 0], [0, 0, 1], [0.6, 0.8, 0], [-0.6, 0, 0.8], [0, -0.8, 0.6]]
)


def test_conversions_are_scipys_at_every_angle() -> None:
    random = np.random.default_rng(0)
    sizes = random.choice([1e-12, 1e-5, 9.99e-4, 1.01e-3, 0.1, 3.0, 100.0], size=(400, 1))
    vectors = np.vstack([np.zeros((1, 3)), HALF_TURNS, sizes * random.standard_normal((400, 3))])
    oracle = Rotation.from_rotvec(vectors)
    matrices = oracle.as_matrix()
    close = {"rtol": 0, "atol": 4e-15}
    np.testing.assert_allclose(rotation_from_vector(vectors), matrices, **close)
    np.testing.assert_allclose(vector_from_rotation(matrices), oracle.as_rotvec(), **close)
    found = quaternion_from_rotation(matrices)
    np.testing.assert_allclose(found, Rotation.from_matrix(matrices).as_quat(canonical=True))
    np.testing.assert_allclose(rotation_from_quaternion(7.0 * found), matrices, **close)


def test_a_matrix_that_is_nearly_a_rotation_stands_for_the_nearest() -> None:
    random = np.random.default_rng(1)
    off = random_rotations(random, 50) + 1e-3 * random.standard_normal((50, 3, 3))
    nearest = rotation_from_quaternion(quaternion_from_rotation(off))
    # The `Rotation` of SciPy 1.11 takes another one.
    np.testing.assert_allclose(nearest, [polar(each)[0] for each in off], atol=1e-14)
    # The residual of the nearest rotation is symmetric where it has been turned back.
    left = np.swapaxes(nearest, 1, 2) @ off
    np.testing.assert_allclose(left, np.swapaxes(left, 1, 2), atol=1e-14)


@pytest.mark.parametrize("matrix", [np.diag([1.0, 1.0, -1.0]), np.zeros((3, 3)), -np.eye(3)])
def test_what_is_no_rotation_is_refused(matrix: np.ndarray) -> None:
    with pytest.raises(ValueError, match="no positive determinant"):
        vector_from_rotation(matrix)


def test_no_rotation_has_a_quaternion_of_norm_zero() -> None:
    with pytest.raises(ValueError, match="norm zero"):
        rotation_from_quaternion(np.zeros((2, 4)))


def test_random_rotations_point_anywhere() -> None:
    found = random_rotations(np.random.default_rng(2), 4000)
    np.testing.assert_allclose(np.linalg.det(found), 1.0)
    # Every element is evenly spread from -1 to 1: mean 0, variance 1/3.
    np.testing.assert_allclose(found.mean(axis=0), 0.0, atol=5 / math.sqrt(3 * 4000))
    np.testing.assert_allclose(found.var(axis=0), 1 / 3, atol=5 * math.sqrt(4 / 45 / 4000))


@pytest.mark.parametrize("shape", [(8, 9), (9, 9), (50, 3), (2, 3)])
def test_right_singular_vectors_are_all_there_and_the_left_ones_are_not_missed(
    shape: tuple[int, int],
) -> None:
    rows = np.random.default_rng(0).normal(size=shape)
    singular, vectors = right_singular(rows)
    assert vectors.shape == (shape[1], shape[1])
    np.testing.assert_allclose(vectors @ vectors.T, np.eye(shape[1]), atol=1e-12)
    np.testing.assert_allclose(
        np.linalg.norm(rows @ vectors.T, axis=0)[: len(singular)], singular, rtol=1e-10
    )


def test_many_rows_have_no_left_singular_vectors_made_of_them() -> None:
    # (100,000, 100,000) of them would take 80 GB.
    singular, _ = right_singular(np.eye(3)[np.arange(100_000) % 3])
    np.testing.assert_allclose(singular**2, [33334, 33333, 33333])


def test_rotations_are_told_from_other_matrices() -> None:
    rotations = random_rotations(np.random.default_rng(0), 20)
    assert are_rotations(rotations).all()
    mirrored, stretched, turned, slightly, unlike = rotations[:5].copy()
    matrices = np.stack(
        [
            mirrored * [1.0, 1.0, -1.0],
            stretched * (1.0 + 1e-5),
            # Columns of unit length that are not orthogonal.
            turned @ [[1.0, math.sin(1e-5), 0.0], [0.0, math.cos(1e-5), 0.0], [0.0, 0.0, 1.0]],
            slightly * (1.0 + 1e-8),
            np.zeros((3, 3)) * unlike,
        ]
    )
    assert are_rotations(matrices).tolist() == [False, False, False, True, False]
    assert are_rotations(np.zeros((0, 3, 3))).shape == (0,)
