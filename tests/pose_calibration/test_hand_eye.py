"""Hand-eye calibration: every set-up, what does not count, whose noise it is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hand_eye_scenes import (
    NOISE,
    WHOSE,
    angle,
    assert_pose,
    calibrate,
    errors,
    noisy,
    rows_of,
    simulate,
)
from studies import first_of

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import (
    random_rotations,
    rotation_from_vector,
    vector_from_rotation,
)
from suta_calib.pose_calibration.hand_eye import calibrate_hand_eye
from suta_calib.pose_calibration.loop_start import _loops
from suta_calib.pose_calibration.robot_noise import estimate_lever
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import HandEye, MeasuredPoses, Noise
from suta_calib.terms.hand_eye_start import (
    inverse_poses,
    loop_closures,
)
from suta_calib.terms.synthetic import OutlierModel, Simulated


# ── Every set-up ─────────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("robust", [True, False])
@pytest.mark.parametrize("model", ["AX=XB", "AX=ZB"])
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_exact_poses_give_back_x_and_z(setup: Any, model: Any, robust: bool) -> None:
    """With the hand's poses the other way round, the same loop is an eye beside the robot."""
    near = rotation_from_vector([0.1, 0.2, -1.5]), np.array([0.02, -0.05, 0.08])
    far = rotation_from_vector([2.0, 0.4, 0.3]), np.array([0.6, 0.2, -0.1])
    X, Z = (near, far) if setup == "eye-in-hand" else (far, near)
    data = simulate(12, turn=1.2, X=X, Z=Z)
    hand = data.poses if setup == "eye-in-hand" else inverse_poses(data.poses)
    found = calibrate_hand_eye(hand, data.seen, setup=setup, model=model, robust=robust)
    assert (found.setup, found.model) == (setup, model)
    assert_pose(found.X, data.true_pose("hand_eye"))
    assert_pose(found.Z, data.true_pose("target"))
    assert found.outliers == ()
    assert found.rms < 1e-8
    assert found.rms_angle < 1e-7
    assert found.assessment.level == "good"


@pytest.mark.parametrize("vector", [(0.0, 0.0, 0.0), (np.pi, 0.0, 0.0), (0.0, 2.2, -2.2)])
def test_the_eye_may_look_anywhere(vector: tuple[float, ...]) -> None:
    X = rotation_from_vector(vector), np.array([0.5, -0.2, 0.1])
    Z = rotation_from_vector([0.0, np.pi, 0.0]), np.array([-0.4, 0.9, 3.0])
    found = calibrate(simulate(12, X=X, Z=Z))
    assert_pose(found.X, X)
    assert_pose(found.Z, Z)


def test_the_residuals_are_those_of_the_loop() -> None:
    data = noisy(40)
    found = calibrate(data)
    R, p = loop_closures(data.poses, (found.X[:3, :3], found.X[:3, 3]), data.seen)
    np.testing.assert_allclose(found.residuals, p - found.Z[:3, 3], atol=1e-12)
    turned = vector_from_rotation(found.Z[:3, :3].T @ R)
    np.testing.assert_allclose(found.rotation_residuals, turned, atol=1e-12)
    assert found.rms == pytest.approx(
        np.sqrt(np.mean(np.sum((p - found.Z[:3, 3])[found.inliers] ** 2, axis=1)))
    )


@pytest.mark.parametrize("scale", [1e-3, 1e3])
@pytest.mark.parametrize("share", [0.0, 0.2])
def test_the_unit_of_length_does_not_count(share: float, scale: float) -> None:
    """Metres, millimetres or kilometres: X changes by less than a millionth."""
    data = noisy(40, gross=OutlierModel(share))
    (RA, pA), (RB, pB) = data.poses, data.seen
    found, scaled = calibrate(data), calibrate_hand_eye((RA, scale * pA), (RB, scale * pB))
    assert scaled.outliers == found.outliers
    np.testing.assert_allclose(scaled.X[:3, :3], found.X[:3, :3], atol=1e-6)
    np.testing.assert_allclose(scaled.X[:3, 3] / scale, found.X[:3, 3], atol=1e-6)
    assert scaled.robot_noise_fraction == pytest.approx(found.robot_noise_fraction, abs=1e-3)
    unit = np.repeat([scale, 1.0], 3)
    np.testing.assert_allclose(scaled.std["X"] / unit, found.std["X"], rtol=1e-2)


def test_the_order_of_the_pairs_does_not_count() -> None:
    data = noisy(40, seed=1, gross=OutlierModel(0.2, "slipped"))
    order = np.random.default_rng(0).permutation(40)
    found = calibrate(data)
    again = calibrate_hand_eye(rows_of(data.poses, order), rows_of(data.seen, order))
    assert sorted(order[list(again.outliers)].tolist()) == list(found.outliers)
    np.testing.assert_allclose(again.X, found.X, atol=5e-5)


@pytest.mark.parametrize("whose", WHOSE)
@pytest.mark.parametrize("seed", first_of(range(3)))
def test_the_residuals_tell_whose_noise_it_is(whose: str, seed: int) -> None:
    make, least, most = WHOSE[whose]
    assert least <= calibrate(make(100, seed=seed)).robot_noise_fraction <= most


def with_robot_noise_fraction(data: Simulated[HandEye], share: float) -> FloatArray:
    """Error of X (m) and of its orientation (rad) for a share that is decreed."""
    samples = data.term.poses.samples
    noises = [Noise(NOISE.position), Noise(NOISE.rotation)]
    term = HandEye(MeasuredPoses(*data.poses, samples), *noises, robot_noise_fraction=share)
    values = solve(Problem([term]), SolverOptions(weights=None)).values
    vector = np.array([values[f"hand_eye.{key}"] for key in ("x", "y", "z", "rx", "ry", "rz")])
    R, p = data.true_pose("hand_eye")
    return np.array([np.linalg.norm(vector[:3] - p), angle(rotation_from_vector(vector[3:]), R)])


@pytest.mark.parametrize(("whose", "gain"), [("hand", 0.5), ("both", 0.85)])
def test_knowing_whose_noise_it_is_makes_x_better(whose: str, gain: float) -> None:
    """Against all noise taken for the eye's: root mean square errors over five sets."""
    make, ours, plain = WHOSE[whose][0], [], []
    for seed in range(5):
        data = make(100, seed=seed)
        ours.append(errors(calibrate(data), data)[::-1])
        plain.append(with_robot_noise_fraction(data, 0.0))
    ratio = np.sqrt(np.mean(np.square(ours), axis=0) / np.mean(np.square(plain), axis=0))
    assert (ratio < gain).all(), ratio


def test_the_fraction_is_a_regression() -> None:
    """Displacements that are a known part of what the turns swept, and nothing else."""
    random = np.random.default_rng(0)
    turn, lever = random.standard_normal((2, 200, 3))
    seen = random_rotations(random, 200)
    swept = np.cross(turn, lever)

    def fraction(position: FloatArray) -> float:
        return estimate_lever(position, turn, lever, seen).fraction

    for share in (0.0, 0.3, 1.0):
        assert fraction(share * swept) == pytest.approx(share, abs=1e-6)
    assert fraction(-swept) == pytest.approx(0.0)
    assert fraction(2.0 * swept) == pytest.approx(1.0)
    assert estimate_lever(swept, np.zeros((200, 3)), lever, seen).fraction == 0.5
    swamped = 1e3 * np.random.default_rng(1).standard_normal((200, 3))
    assert fraction(swamped) == pytest.approx(0.5, abs=0.05)


def test_the_points_at_which_noise_is_independent_are_found() -> None:
    """A frame on the target 0.3 off the point whose place is noisy, and one 0.2 off on the hand."""
    random = np.random.default_rng(3)
    turn, lever = 0.02 * random.standard_normal((60, 3)), random.uniform(-0.5, 0.5, (60, 3))
    seen, noise = random_rotations(random, 60), 1e-3 * random.standard_normal((60, 3))
    in_eye, in_target = np.array([0.2, 0.0, -0.1]), np.array([0.0, 0.3, 0.0])
    position = np.cross(turn, 0.3 * lever + in_eye + seen @ in_target) + noise
    model = estimate_lever(position, turn, lever, seen)
    assert model.fraction == pytest.approx(0.3, abs=3.0 * model.std)
    np.testing.assert_allclose(model.in_eye, in_eye, atol=0.03)
    np.testing.assert_allclose(model.in_target, in_target, atol=0.03)
    # Where the frames are at those points nothing is added.
    model = estimate_lever(np.cross(turn, 0.3 * lever) + noise, turn, lever, seen)
    assert model.in_eye == model.in_target == (0.0, 0.0, 0.0)


def test_loops_of_many_answers_are_those_of_each() -> None:
    data, random = HandEye.simulate(20, seed=0), np.random.default_rng(0)
    X = random_rotations(random, 5), random.normal(size=(5, 3))
    R, p = _loops(data.poses, data.seen, X)
    for k in range(5):
        one = X[0][k], X[1][k]
        rotation, position = loop_closures(data.poses, one, data.seen)
        np.testing.assert_allclose(R[k].T.reshape(-1, 3, 3), rotation, atol=1e-14)
        np.testing.assert_allclose(p[k].T, position, atol=1e-14)
        alone = _loops(data.poses, data.seen, (X[0][[k]], X[1][[k]]))
        np.testing.assert_allclose(alone[0][0], R[k], atol=1e-14)
        np.testing.assert_allclose(alone[1][0], p[k], atol=1e-14)


@pytest.mark.parametrize("jitter", [0.0, 1e-7])
def test_pairs_that_were_written_again_are_no_pairs(jitter: float) -> None:
    data, random = noisy(8, seed=1), np.random.default_rng(0)
    rows = np.tile(np.arange(8), 3)
    hand, seen = (
        (R[rows], p[rows] + jitter * random.standard_normal((24, 3)))
        for R, p in (data.poses, data.seen)
    )
    found = calibrate_hand_eye(hand, seen)
    assert found.copies == 16
    notes = found.assessment.notes
    assert any("16 pairs repeat another" in note for note in notes)
    assert any("Only 8 pairs" in note for note in notes)
    assert calibrate_hand_eye(data.poses, data.seen).copies == 0
    many = noisy(40, seed=2)
    assert calibrate_hand_eye(many.poses, many.seen).copies == 0
