"""Hand-eye calibration: closed form, every set-up, whose noise it is, what is refused, accuracy."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from suta_calib.errors import SamplesError
from suta_calib.geometry import FloatArray, rotation_from_vector, vector_from_rotation
from suta_calib.navigation.hand_eye import HandEyeCalibration, calibrate_hand_eye
from suta_calib.navigation.hand_share import estimate_hand_share
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import HandEye, MeasuredPoses, Noise
from suta_calib.terms.hand_eye_start import (
    Poses,
    close_the_loop,
    inverse,
    loops,
    quaternion_hand_eye,
)
from suta_calib.terms.synthetic import EXACT, Gross, Simulated, Spread

NOISE = Spread(3e-4, float(np.radians(0.1)))
NATURES = ("wrong", "slipped", "swapped")
SKEW_AXIS = np.array([1.0, 2.0, -2.0]) / 3.0


def simulate(count: int, **more: Any) -> Simulated[HandEye]:
    return HandEye.simulate(count, **more)


def noisy(count: int, **more: Any) -> Simulated[HandEye]:
    """Noise of a good robot and of a good camera."""
    return simulate(count, hand=NOISE, eye=NOISE, **more)


def calibrate(data: Simulated[HandEye], **more: Any) -> HandEyeCalibration:
    return calibrate_hand_eye(data.poses, data.seen, **more)


def angle(first: FloatArray, second: FloatArray) -> float:
    """Angle between two rotations, rad."""
    return float(np.linalg.norm(vector_from_rotation(first.T @ second)))


def errors(found: HandEyeCalibration, data: Simulated[HandEye]) -> FloatArray:
    """Of X: angle (rad) and distance (m)."""
    R, p = data.true_pose("hand_eye")
    return np.array([angle(found.X[:3, :3], R), np.linalg.norm(found.X[:3, 3] - p)])


def rows_of(poses: Poses, rows: FloatArray) -> Poses:
    return poses[0][rows], poses[1][rows]


def assert_pose(matrix: FloatArray, pose: Poses, tolerance: float = 1e-8) -> None:
    np.testing.assert_allclose(matrix[:3, :3], pose[0], atol=tolerance)
    np.testing.assert_allclose(matrix[:3, 3], pose[1], atol=tolerance)
    np.testing.assert_array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0])


# ── The closed form ──────────────────────────────────────────────────────────────────────────
def motions_of(turns: FloatArray, data: Simulated[HandEye]) -> tuple[Poses, Poses]:
    """Poses of hand and eye where each turn (n, 3), rad, follows the one before."""
    X, Z = data.true_pose("hand_eye"), data.true_pose("target")
    R = [np.eye(3)]
    for turn in rotation_from_vector(turns):
        R.append(R[-1] @ turn)
    hand = np.array(R), np.random.default_rng(0).uniform(-0.3, 0.3, (len(R), 3))
    eye = hand[0] @ X[0], hand[0] @ X[1] + hand[1]
    back = inverse(eye)
    return hand, (back[0] @ Z[0], back[0] @ Z[1] + back[1])


HALF_TURN = np.pi * np.array([[1.0, 0, 0], [0, 1.0, 0], [0.6, 0, 0.8], [0, 0, 1.0]])
TURNS = {
    "ordinary": np.random.default_rng(1).uniform(-1.0, 1.0, (6, 3)),
    "half a turn": HALF_TURN,
    "nearly half a turn": HALF_TURN * (1.0 - 1e-9 * np.array([[1.0], [-1.0], [1.0], [-1.0]])),
    "a little more or less": HALF_TURN * (1.0 + 1e-3 * np.array([[1.0], [-1.0], [1.0], [1.0]])),
    "half a turn among others": np.vstack([HALF_TURN[:1], [[0.3, 0.4, -0.2], [0.1, -0.8, 0.3]]]),
    "two motions only": np.array([[0.5, 0.0, 0.0], [0.0, 0.0, -0.4]]),
    "quarter turns": HALF_TURN / 2.0,
    "small turns": np.random.default_rng(2).uniform(-0.03, 0.03, (6, 3)),
}


@pytest.mark.parametrize("which", TURNS)
def test_the_closed_form_is_exact_on_exact_data(which: str) -> None:
    data = simulate(3)
    hand, seen = motions_of(TURNS[which], data)
    X = quaternion_hand_eye(hand, seen)
    for found, true in zip(X, data.true_pose("hand_eye"), strict=True):
        np.testing.assert_allclose(found, true, atol=1e-9)
    Z = close_the_loop(hand, X, seen)
    for found, true in zip(Z, data.true_pose("target"), strict=True):
        np.testing.assert_allclose(found, true, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_half_turns_with_noise_do_not_confuse_the_quaternions_signs(seed: int) -> None:
    """Noise decides on which side of half a turn a motion lies, for hand and eye separately.

    The other motions tell the sign, though they be the fewer.
    """
    data, random = simulate(3), np.random.default_rng(seed)
    about = random.standard_normal((12, 3))
    turns = about / np.linalg.norm(about, axis=1, keepdims=True)
    turns[:8] *= np.pi
    hand, seen = motions_of(random.permutation(turns), data)
    X = quaternion_hand_eye(NOISE.scattered(random, hand), NOISE.scattered(random, seen))
    assert angle(X[0], data.true_pose("hand_eye")[0]) < np.radians(0.5)
    assert np.linalg.norm(X[1] - data.true_pose("hand_eye")[1]) < 3e-3


def test_many_sets_at_once_are_solved_like_each_alone() -> None:
    sets = [noisy(6, seed=seed) for seed in range(5)]
    hand, seen = (
        tuple(np.stack(part) for part in zip(*poses, strict=True))
        for poses in ([d.poses for d in sets], [d.seen for d in sets])
    )
    R, p = quaternion_hand_eye(hand, seen)  # type: ignore[arg-type]
    for k, data in enumerate(sets):
        alone = quaternion_hand_eye(data.poses, data.seen)
        np.testing.assert_allclose(R[k], alone[0], atol=1e-12)
        np.testing.assert_allclose(p[k], alone[1], atol=1e-12)


# ── Every set-up ─────────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("robust", [True, False])
@pytest.mark.parametrize("model", ["AX=XB", "AX=ZB"])
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_exact_poses_give_back_x_and_z(setup: Any, model: Any, robust: bool) -> None:
    """With the hand's poses the other way round, the same loop is an eye beside the robot."""
    data = simulate(12, turn=1.2)
    hand = data.poses if setup == "eye-in-hand" else inverse(data.poses)
    found = calibrate_hand_eye(hand, data.seen, setup=setup, model=model, robust=robust)
    assert (found.setup, found.model) == (setup, model)
    assert_pose(found.X, data.true_pose("hand_eye"))
    assert_pose(found.Z, data.true_pose("target"))
    assert found.outliers == ()
    assert found.rms < 1e-8
    assert found.rms_angle < 1e-7
    assert found.verdict.level == "good"


@pytest.mark.parametrize("vector", [(0.0, 0.0, 0.0), (np.pi, 0.0, 0.0), (0.0, 2.2, -2.2)])
def test_the_eye_may_look_anywhere(vector: tuple[float, ...]) -> None:
    X = rotation_from_vector(vector), np.array([0.5, -0.2, 0.1])
    Z = rotation_from_vector([0.0, np.pi, 0.0]), np.array([-0.4, 0.9, 3.0])
    found = calibrate(simulate(12, X=X, Z=Z))
    assert_pose(found.X, X)
    assert_pose(found.Z, Z)


def test_an_eye_beside_the_robot_with_noise_is_as_well_found() -> None:
    data = noisy(100)
    found = calibrate_hand_eye(inverse(data.poses), data.seen, setup="eye-to-hand")
    expected = calibrate(data)
    np.testing.assert_allclose(found.X, expected.X, atol=1e-7)
    np.testing.assert_allclose(found.std["X"], expected.std["X"], rtol=1e-3)


def test_the_residuals_are_those_of_the_loop() -> None:
    data = noisy(40)
    found = calibrate(data)
    R, p = loops(data.poses, (found.X[:3, :3], found.X[:3, 3]), data.seen)
    np.testing.assert_allclose(found.position_residuals, p - found.Z[:3, 3], atol=1e-12)
    turned = vector_from_rotation(found.Z[:3, :3].T @ R)
    np.testing.assert_allclose(found.rotation_residuals, turned, atol=1e-12)
    assert found.rms == pytest.approx(
        np.sqrt(np.mean(np.sum((p - found.Z[:3, 3])[found.inliers] ** 2, axis=1)))
    )


@pytest.mark.parametrize("scale", [1e-3, 1e3])
@pytest.mark.parametrize("share", [0.0, 0.2])
def test_the_unit_of_length_does_not_count(share: float, scale: float) -> None:
    """Metres, millimetres or kilometres: X changes by less than a millionth."""
    data = noisy(40, gross=Gross(share))
    (RA, pA), (RB, pB) = data.poses, data.seen
    found, scaled = calibrate(data), calibrate_hand_eye((RA, scale * pA), (RB, scale * pB))
    assert scaled.outliers == found.outliers
    np.testing.assert_allclose(scaled.X[:3, :3], found.X[:3, :3], atol=1e-6)
    np.testing.assert_allclose(scaled.X[:3, 3] / scale, found.X[:3, 3], atol=1e-6)
    assert scaled.hand_share == pytest.approx(found.hand_share, abs=1e-3)
    unit = np.repeat([scale, 1.0], 3)
    np.testing.assert_allclose(scaled.std["X"] / unit, found.std["X"], rtol=1e-2)


def test_the_base_does_not_count() -> None:
    """A robot that stands elsewhere has its target elsewhere, and its eye where it was."""
    data = noisy(40, seed=1, gross=Gross(0.2, "slipped"))
    Q, q = rotation_from_vector([0.4, 2.0, -1.0]), np.array([5.0, -3.0, 2.0])
    (R, p), found = data.poses, calibrate(data)
    moved = calibrate_hand_eye((Q @ R, p @ Q.T + q), data.seen)
    np.testing.assert_allclose(moved.X, found.X, atol=5e-5)
    np.testing.assert_allclose(moved.Z[:3, 3], Q @ found.Z[:3, 3] + q, atol=5e-5)
    assert moved.outliers == found.outliers


def test_the_order_of_the_pairs_does_not_count() -> None:
    data = noisy(40, seed=1, gross=Gross(0.2, "slipped"))
    order = np.random.default_rng(0).permutation(40)
    found = calibrate(data)
    again = calibrate_hand_eye(rows_of(data.poses, order), rows_of(data.seen, order))
    assert sorted(order[list(again.outliers)].tolist()) == list(found.outliers)
    np.testing.assert_allclose(again.X, found.X, atol=5e-5)


# ── Whose noise it is ────────────────────────────────────────────────────────────────────────
WHOSE: dict[str, tuple[Callable[..., Simulated[HandEye]], float, float]] = {
    "hand": (lambda n, **k: simulate(n, hand=NOISE, **k), 0.9, 1.0),
    "eye": (lambda n, **k: simulate(n, eye=NOISE, **k), 0.0, 0.1),
    "both": (noisy, 0.35, 0.65),
}


@pytest.mark.parametrize("whose", WHOSE)
@pytest.mark.parametrize("seed", range(3))
def test_the_residuals_tell_whose_noise_it_is(whose: str, seed: int) -> None:
    make, least, most = WHOSE[whose]
    assert least <= calibrate(make(100, seed=seed)).hand_share <= most


def with_hand_share(data: Simulated[HandEye], share: float) -> FloatArray:
    """Error of X (m) and of its orientation (rad) for a share that is decreed."""
    samples = data.term.poses.samples
    noises = [Noise(NOISE.position), Noise(NOISE.rotation)]
    values = solve(
        Problem([HandEye(MeasuredPoses(*data.poses, samples), *noises, hand_share=share)])
    ).values
    vector = np.array([values[f"hand_eye.{key}"] for key in ("x", "y", "z", "rx", "ry", "rz")])
    R, p = data.true_pose("hand_eye")
    return np.array([np.linalg.norm(vector[:3] - p), angle(rotation_from_vector(vector[3:]), R)])


@pytest.mark.parametrize(("whose", "gain"), [("hand", 0.5), ("both", 0.85)])
def test_knowing_whose_noise_it_is_makes_x_better(whose: str, gain: float) -> None:
    """Against all noise taken for the eye's: root mean square errors over eight sets."""
    make, ours, plain = WHOSE[whose][0], [], []
    for seed in range(8):
        data = make(100, seed=seed)
        ours.append(errors(calibrate(data), data)[::-1])
        plain.append(with_hand_share(data, 0.0))
    ratio = np.sqrt(np.mean(np.square(ours), axis=0) / np.mean(np.square(plain), axis=0))
    assert (ratio < gain).all(), ratio


def test_the_share_is_a_regression() -> None:
    """Displacements that are a known part of what the turns swept, and nothing else."""
    swept = np.random.default_rng(0).standard_normal((200, 3))
    for share in (0.0, 0.3, 1.0):
        assert estimate_hand_share(share * swept, swept) == pytest.approx(share, abs=1e-12)
    assert estimate_hand_share(-swept, swept) == pytest.approx(0.0)
    assert estimate_hand_share(2.0 * swept, swept) == pytest.approx(1.0)
    assert estimate_hand_share(swept, np.zeros((200, 3))) == 0.5
    drowned = 1e3 * np.random.default_rng(1).standard_normal((200, 3))
    assert estimate_hand_share(drowned, swept) == pytest.approx(0.5, abs=0.05)


# ── What is refused ──────────────────────────────────────────────────────────────────────────
def slides(problem: SamplesError) -> FloatArray:
    """The directions (k, 3) along which the message says that X may slide."""
    found = re.findall(r"slide along \(([^)]*)\)", str(problem))
    return np.array([[float(v) for v in numbers.split(",")] for numbers in found])


@pytest.mark.parametrize("share", [0.0, 0.3])
@pytest.mark.parametrize("spread", [EXACT, NOISE], ids=["exact", "noisy"])
@pytest.mark.parametrize("axis", [np.eye(3)[2], SKEW_AXIS], ids=["z", "skew"])
@pytest.mark.parametrize("turn", [np.pi / 4, np.pi / 2])
def test_parallel_axes_are_refused_and_the_axis_is_named_in_the_hand(
    turn: float, axis: FloatArray, spread: Spread, share: float
) -> None:
    more: dict[str, Any] = {"turn": turn, "axes": axis, "gross": Gross(share)}
    with pytest.raises(SamplesError, match="do not determine X") as problem:
        calibrate(simulate(30, hand=spread, eye=spread, **more))
    named = slides(problem.value)
    assert len(named) == 1
    assert abs(named[0] @ axis) == pytest.approx(1.0, abs=0.01)
    assert "turn about" not in str(problem.value)
    assert "two axes that are not parallel" in str(problem.value)


@pytest.mark.parametrize("spread", [EXACT, NOISE], ids=["exact", "noisy"])
@pytest.mark.parametrize("share", [0.0, 0.2])
def test_pure_translation_is_refused_in_every_direction(spread: Spread, share: float) -> None:
    with pytest.raises(SamplesError, match="do not determine X") as problem:
        calibrate(simulate(30, hand=spread, eye=spread, turn=0.0, gross=Gross(share)))
    assert np.linalg.matrix_rank(slides(problem.value)) == 3


def test_a_hand_that_did_not_move_is_refused() -> None:
    still = np.tile(np.eye(3), (10, 1, 1)), np.zeros((10, 3))
    with pytest.raises(SamplesError, match=r"turn about.*slide along"):
        calibrate_hand_eye(still, still)


@pytest.mark.parametrize("seed", range(3))
def test_nearly_parallel_axes_are_refused_or_honestly_uncertain(seed: int) -> None:
    """Axes some degrees apart: what is answered lies within what is claimed."""
    side = np.array([2.0, 1.0, 2.0]) / 3.0
    for degrees in (1.0, 6.0, 12.0):
        other = rotation_from_vector(np.radians(degrees) * side) @ SKEW_AXIS
        data = noisy(30, seed=seed, axes=np.array([SKEW_AXIS, other]))
        if degrees < 2.0:
            with pytest.raises(SamplesError, match="slide along") as problem:
                calibrate(data)
            assert abs(slides(problem.value)[0] @ SKEW_AXIS) > 0.98
            continue
        found = calibrate(data)
        claimed = float(np.linalg.norm(found.std["X"][:3]))
        assert errors(found, data)[1] < 4.0 * claimed
        assert claimed < 2e-3 or found.verdict.level == "caution"


def test_too_few_pairs_are_refused() -> None:
    data = simulate(5)
    for count in (0, 1, 2):
        rows = np.arange(count)
        with pytest.raises(SamplesError, match=f"{count} pairs of poses; expected at least 3"):
            calibrate_hand_eye(rows_of(data.poses, rows), rows_of(data.seen, rows))
    with pytest.raises(SamplesError, match="5 poses of the hand and 4 of the target"):
        calibrate_hand_eye(data.poses, rows_of(data.seen, np.arange(4)))


# ── Uncertainty ──────────────────────────────────────────────────────────────────────────────
def spread_over_prediction(whose: str, count: int, trials: int) -> FloatArray:
    """Monte-Carlo over predicted standard deviation: places and turns of X, then of Z, (4,)."""
    found_errors, predicted = [], []
    for seed in range(trials):
        data = WHOSE[whose][0](count, seed=seed)
        found = calibrate(data)
        error = []
        for T, name in ((found.X, "hand_eye"), (found.Z, "target")):
            R, p = data.true_pose(name)
            error += [T[:3, 3] - p, vector_from_rotation(R.T @ T[:3, :3])]
        found_errors.append(np.concatenate(error) ** 2)
        predicted.append(np.diag(found.covariance))
    ratio = np.mean(found_errors, axis=0) / np.mean(predicted, axis=0)
    return np.asarray(np.sqrt(ratio.reshape(4, 3).mean(axis=1)))


def test_the_monte_carlo_spread_is_the_predicted_one() -> None:
    """40 trials: a standard deviation scatters by 11 %, three together by 7 %."""
    ratio = spread_over_prediction("both", 30, 40)
    assert ((ratio > 0.8) & (ratio < 1.25)).all(), ratio


@pytest.mark.slow
@pytest.mark.parametrize("whose", WHOSE)
@pytest.mark.parametrize("count", [20, 100])
def test_the_monte_carlo_spread_is_the_predicted_one_closely(count: int, whose: str) -> None:
    ratio = spread_over_prediction(whose, count, 250)
    assert ((ratio > 0.8) & (ratio < 1.25)).all(), ratio


# ── Accuracy and outliers ────────────────────────────────────────────────────────────────────
def median_errors(count: int, share: float, trials: int) -> FloatArray:
    """Median error of X: angle (deg) and distance (mm)."""
    sets = (noisy(count, seed=seed, gross=Gross(share)) for seed in range(trials))
    found = np.array([errors(calibrate(data), data) for data in sets])
    return np.asarray(np.median(found, axis=0) * [180.0 / np.pi, 1e3])


def test_100_poses_of_good_instruments_and_20_percent_outliers_among_them() -> None:
    """0.1° and 0.3 mm per axis, on hand and eye: 0.046° and 0.41 mm over 320 sets."""
    clean, spoiled = median_errors(100, 0.0, 9), median_errors(100, 0.2, 9)
    limit = np.array([0.06, 0.53])
    assert (clean < limit).all(), clean
    assert (spoiled < 1.2 * np.minimum(limit, 1.05 * clean)).all(), spoiled


@pytest.mark.parametrize("nature", NATURES)
def test_outliers_are_listed_and_cost_next_to_nothing(nature: Any) -> None:
    robust, alone = [], []
    for seed in range(4):
        data = noisy(60, seed=seed, gross=Gross(0.3, nature))
        found = calibrate(data)
        assert found.outliers == data.outliers, seed
        rows = data.inliers
        clean = calibrate_hand_eye(
            rows_of(data.poses, rows), rows_of(data.seen, rows), robust=False
        )
        robust.append(errors(found, data))
        alone.append(errors(clean, data))
    rms = [np.sqrt(np.mean(np.square(e), axis=0)) for e in (robust, alone)]
    assert (rms[0] < 1.3 * rms[1]).all()


def assert_no_failures(trials: int) -> None:
    """30 poses, 30 % outliers: nothing beyond 1° or 5 mm."""
    for seed in range(trials):
        data = noisy(30, seed=seed, gross=Gross(0.3, NATURES[seed % 3]))  # type: ignore[arg-type]
        turned, displaced = errors(calibrate(data), data)
        assert turned < np.radians(1.0), seed
        assert displaced < 5e-3, seed


def test_30_percent_outliers_never_win() -> None:
    assert_no_failures(15)


@pytest.mark.slow
def test_30_percent_outliers_never_win_in_a_hundred_trials() -> None:
    assert_no_failures(100)


def test_pairs_of_which_half_disagree_must_not_be_used() -> None:
    verdict = calibrate(noisy(60, gross=Gross(0.45))).verdict
    assert not verdict.usable
    assert "45% of the pairs do not agree" in verdict.notes[0]


def test_few_poses_are_said_to_be_few() -> None:
    verdict = calibrate(noisy(8, turn=0.3)).verdict
    assert verdict.level == "caution"
    assert any("X is known to" in note for note in verdict.notes)


def test_pairs_that_do_not_belong_together_are_called_so() -> None:
    rng = np.random.default_rng(0)
    A, B = (
        (rotation_from_vector(rng.uniform(-2, 2, (20, 3))), rng.uniform(-0.3, 0.3, (20, 3)))
        for _ in range(2)
    )
    with pytest.raises(SamplesError, match="pair by pair"):
        calibrate_hand_eye(A, B)


def test_few_pairs_with_exact_turns_are_as_sure_as_they_scatter() -> None:
    """Turns are weighed by no less than a tenth of a degree, and scatter by what they scatter."""
    found, predicted = [], []
    for seed in range(40):
        s = HandEye.simulate(25, hand=Spread(0.0, 0.0), eye=Spread(0.5e-3, 0.0), seed=seed)
        seen = s.seen
        assert seen is not None
        result = calibrate_hand_eye(s.poses, seen)
        true = s.true_pose("hand_eye")
        found.append(vector_from_rotation(true[0].T @ result.X[:3, :3]))
        predicted.append(result.std["X"][3:] ** 2)
    assert 0.75 < np.sqrt(np.mean(np.square(found)) / np.mean(predicted)) < 1.3


@pytest.mark.parametrize("count", [3, 4, 6])
def test_a_handful_of_pairs_is_never_called_sure(count: int) -> None:
    """Three pairs can be fitted exactly in position, which says nothing of how sure they are."""
    ratios = []
    for seed in range(25):
        s = HandEye.simulate(count, hand=EXACT, eye=Spread(0.3e-3, np.radians(0.1)), seed=seed)
        assert s.seen is not None
        try:
            found = calibrate_hand_eye(s.poses, s.seen)
        except SamplesError:
            continue
        assert found.verdict.level != "good"
        error = found.X[:3, 3] - s.true_pose("hand_eye")[1]
        ratios.append(np.sum(error**2) / np.sum(found.std["X"][:3] ** 2))
    assert len(ratios) > 5
    assert np.sqrt(np.median(ratios)) < 3.0
