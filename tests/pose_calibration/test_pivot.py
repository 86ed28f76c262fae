"""Pivot calibration: the algebraic answer, its covariance, what is refused, outliers."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hand_eye_scenes import NATURES, NOISE, SKEW_AXIS, slides
from spread import is_as_predicted
from studies import of_size

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.pose_calibration.pivot import PivotCalibration, calibrate_pivot
from suta_calib.terms import FixedPoint
from suta_calib.terms.hand_eye_start import inverse_poses
from suta_calib.terms.synthetic import EXACT, OutlierModel, PoseNoise, Simulated
from suta_calib.trust.hypotheses.bent_tip import TO_ONE_SIDE, bending

POSTS = np.array([[0.1, 0.2, -1.0], [0.3, 0.0, -0.9], [0.0, -0.1, -1.1]])


def simulate(count: int, **more: Any) -> Simulated[FixedPoint]:
    return FixedPoint.simulate(count, **more)


def calibrate(data: Simulated[FixedPoint], **more: Any) -> PivotCalibration:
    return calibrate_pivot(*data.poses, data.term.poses.samples.labels["point"], **more)


def tip_error(found: PivotCalibration, data: Simulated[FixedPoint]) -> float:
    return float(np.linalg.norm(found.tip - data.true_point("tip")))


def algebraic(data: Simulated[FixedPoint]) -> FloatArray:
    """Tip and posts of ``R_i t - c_k = -p_i``, Yaniv's algebraic one step."""
    R, p = data.poses
    labels = data.term.poses.samples.labels["point"]
    which = (labels[:, None] == np.unique(labels)).astype(float)
    columns = np.hstack([R.reshape(-1, 3), -np.kron(which, np.eye(3))])
    return np.asarray(np.linalg.lstsq(columns, -p.reshape(-1), rcond=None)[0])


# ── The answer ───────────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("posts", [POSTS[:1], POSTS], ids=["one post", "three posts"])
def test_least_squares_is_the_algebraic_answer(posts: FloatArray) -> None:
    data = simulate(40, spread=NOISE, posts=posts)
    found = calibrate(data, robust=False)
    expected = algebraic(data)
    np.testing.assert_allclose(found.tip, expected[:3], atol=1e-8)
    np.testing.assert_allclose(np.ravel(list(found.posts.values())), expected[3:], atol=1e-8)
    R, p = data.poses
    error = R @ found.tip + p - np.repeat(expected[3:].reshape(-1, 3), 40, axis=0)
    assert found.rms == pytest.approx(np.sqrt(np.mean(np.sum(error**2, axis=1))), rel=1e-6)


@pytest.mark.parametrize("robust", [True, False])
@pytest.mark.parametrize("posts", [POSTS[:1], POSTS], ids=["one post", "three posts"])
def test_exact_poses_give_back_the_tip_and_every_post(posts: FloatArray, robust: bool) -> None:
    data = simulate(10, posts=posts)
    found = calibrate(data, robust=robust)
    assert tip_error(found, data) < 1e-10
    assert list(found.posts) == [f"post_{k + 1}" for k in range(len(posts))]
    np.testing.assert_allclose(list(found.posts.values()), posts, atol=1e-10)
    np.testing.assert_array_equal(found.post, found.posts["post_1"])
    assert found.outliers == ()
    assert found.assessment.level == "good"


def test_posts_are_known_by_their_labels_in_any_order() -> None:
    data = simulate(15, spread=NOISE, posts=POSTS)
    labels = data.term.poses.samples.labels["point"]
    order = np.random.default_rng(0).permutation(len(labels))
    R, p = data.poses
    found, shuffled = calibrate(data), calibrate_pivot(R[order], p[order], labels[order])
    assert set(shuffled.posts) == set(found.posts)
    for label, post in found.posts.items():
        np.testing.assert_allclose(shuffled.posts[label], post, atol=1e-6)
        np.testing.assert_allclose(shuffled.post_std(label), found.post_std(label), rtol=1e-2)
    np.testing.assert_allclose(shuffled.tip, found.tip, atol=1e-6)


def test_several_posts_tell_the_tip_better_than_any_alone() -> None:
    """Three times the poses, one tip: its variance is a third."""
    data = simulate(40, spread=NOISE, posts=POSTS)
    R, p = data.poses
    alone = [calibrate_pivot(R[k : k + 40], p[k : k + 40]) for k in (0, 40, 80)]
    single = np.mean([np.sum(f.tip_std**2) for f in alone])
    assert np.sum(calibrate(data).tip_std ** 2) == pytest.approx(single / 3.0, rel=0.25)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_the_unit_of_length_does_not_count(scale: float) -> None:
    R, p = simulate(60, spread=NOISE, gross=OutlierModel(0.2, "slipped")).poses
    found, scaled = calibrate_pivot(R, p), calibrate_pivot(R, scale * p)
    assert scaled.outliers == found.outliers
    np.testing.assert_allclose(scaled.tip / scale, found.tip, atol=1e-9)
    np.testing.assert_allclose(scaled.post / scale, found.post, atol=1e-9)
    np.testing.assert_allclose(scaled.tip_std / scale, found.tip_std, rtol=1e-5)


def test_the_frames_do_not_count() -> None:
    """A tracker that stands elsewhere moves the post; a body frame set otherwise moves the tip."""
    R, p = simulate(60, spread=NOISE, gross=OutlierModel(0.2, "slipped")).poses
    Q, B = rotation_from_vector([[0.4, 2.0, -1.0], [-2.5, 0.3, 0.9]])
    q, b = np.array([5.0, -3.0, 2.0]), np.array([0.02, 0.05, -0.03])
    found = calibrate_pivot(R, p)
    moved = calibrate_pivot(Q @ R @ B, (p + R @ b) @ Q.T + q)
    assert moved.outliers == found.outliers
    np.testing.assert_allclose(moved.tip, B.T @ (found.tip - b), atol=1e-7)
    np.testing.assert_allclose(moved.post, Q @ found.post + q, atol=1e-7)


# ── Uncertainty ──────────────────────────────────────────────────────────────────────────────
def spread_over_prediction(trials: int, posts: FloatArray, count: int) -> FloatArray:
    """Monte-Carlo over predicted standard deviation of the tip and of the posts, (2,)."""
    errors, predicted = [], []
    for seed in range(trials):
        data = simulate(count, spread=NOISE, seed=seed, posts=posts)
        found = calibrate(data)
        estimate = np.concatenate([found.tip, *found.posts.values()])
        errors.append((estimate - list(data.truth.values())) ** 2)
        predicted.append(np.diag(found.covariance))
        np.testing.assert_allclose(found.tip_std**2, predicted[-1][:3])
    mean_error, mean_predicted = np.mean(errors, axis=0), np.mean(predicted, axis=0)
    parts = (slice(0, 3), slice(3, None))
    return np.array([np.sqrt(mean_error[k].sum() / mean_predicted[k].sum()) for k in parts])


@pytest.mark.parametrize(("count", "posts"), [(60, POSTS[:1]), (12, POSTS)])
def test_the_monte_carlo_spread_is_the_predicted_one(count: int, posts: FloatArray) -> None:
    tip, post = spread_over_prediction(20, posts, count)
    assert is_as_predicted(tip, 3 * 20)
    assert is_as_predicted(post, 3 * 20)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "posts"), [(60, POSTS[:1]), (12, POSTS), (200, POSTS[:1])])
def test_the_monte_carlo_spread_is_the_predicted_one_closely(count: int, posts: FloatArray) -> None:
    ratio = spread_over_prediction(400, posts, count)
    assert ((ratio > 0.88) & (ratio < 1.14)).all(), ratio


def test_reading_again_without_moving_makes_nothing_surer() -> None:
    """In any order; as if every reading were one more pose ± would be three times too small."""
    count, times = 12, 10
    ratios, alone = [], []
    for seed in range(6):
        data, random = simulate(count, spread=NOISE, seed=seed), np.random.default_rng(seed)
        rows = random.permutation(np.repeat(np.arange(count), times))
        R, p = (part[rows] for part in data.poses)
        jitter = 1e-6 * random.standard_normal((2, len(rows), 3))
        found = calibrate_pivot(R @ rotation_from_vector(jitter[0]), p + jitter[1])
        ratios.append((found.tip - data.true_point("tip")) / found.tip_std)
        alone.append(found.tip_std / calibrate(data).tip_std)
    assert is_as_predicted(float(np.sqrt(np.mean(np.square(ratios)))), 3 * 6)
    assert np.median(alone) == pytest.approx(1.0, abs=0.3)


def test_poses_in_another_unit_than_their_columns_are_no_answer() -> None:
    found = calibrate(simulate(40, spread=NOISE))
    assert found.assessment.usable
    assert not replace(found, notes=("looks like metres",)).assessment.usable


# ── Inverted poses ───────────────────────────────────────────────────────────────────────────
def test_inverted_poses_are_said_to_be_and_what_they_give_the_right_way_round() -> None:
    """They leave no residual: the tip is 1.4 m from the tool, and the post where the tip is."""
    data = simulate(30, spread=NOISE, posts=np.array([[0.3, -0.2, -1.35]]))
    right, wrong = calibrate(data), calibrate_pivot(*inverse_poses(data.poses))
    assert right.assessment.level == "good"
    assert wrong.rms == pytest.approx(right.rms, rel=0.01)
    assert wrong.inverted == wrong.assessment.level == "bad"
    told = next(note for note in wrong.assessment.notes if "T_tool_tracker" in note)
    shown = re.search(r"they give the tip \(([^)]*)\) mm and the post \(([^)]*)\) mm", told)
    for numbers, place in zip(shown.groups(), (right.tip, right.post), strict=True):
        np.testing.assert_allclose([float(v) for v in numbers.split(",")], 1e3 * place, atol=0.15)


def test_a_post_nearer_than_the_tip_is_worth_a_word_and_no_more() -> None:
    """A divot beside a reference body: the longer of two lengths may well be the stylus."""
    data = simulate(30, spread=NOISE, posts=np.array([[0.01, 0.02, 0.03]]))
    found = calibrate(data)
    assert found.inverted == "care"
    assert found.assessment.level == "good"
    assert any("T_tool_tracker" in note for note in found.assessment.notes)


# ── What is refused ──────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("share", [0.0, 0.3])
@pytest.mark.parametrize("spread", [EXACT, NOISE], ids=["exact", "noisy"])
@pytest.mark.parametrize("axis", [np.eye(3)[2], SKEW_AXIS], ids=["z", "skew"])
def test_turns_about_one_axis_are_refused_and_the_axis_is_named(
    axis: FloatArray, spread: PoseNoise, share: float
) -> None:
    """In the tool's frame, which is turned against the tracker's."""
    data = simulate(100, spread=spread, axes=axis, gross=OutlierModel(share, "slipped"))
    with pytest.raises(SamplesError, match="do not determine the tip in the tool") as problem:
        calibrate(data)
    named = slides(problem.value)
    assert len(named) == 1
    assert abs(named[0] @ axis) == pytest.approx(1.0, abs=0.01)
    assert "turn the tool more" in str(problem.value)


@pytest.mark.parametrize("spread", [EXACT, NOISE], ids=["exact", "noisy"])
def test_a_tool_that_is_not_turned_is_refused_in_every_direction(spread: PoseNoise) -> None:
    with pytest.raises(SamplesError, match="do not determine the tip") as problem:
        calibrate(simulate(50, spread=spread, turn=0.0))
    assert np.linalg.matrix_rank(slides(problem.value)) == 3


@pytest.mark.parametrize("degrees", [0.1, 1.0, 2.0])
def test_turns_that_noise_could_feign_are_refused(degrees: float) -> None:
    with pytest.raises(SamplesError, match="do not determine the tip"):
        calibrate(simulate(200, spread=NOISE, turn=np.radians(degrees)))


def test_small_turns_are_said_to_be_small() -> None:
    data = simulate(200, spread=NOISE, turn=np.radians(10.0))
    assessment = calibrate(data).assessment
    assert assessment.level == "care"
    assert "turned too little" in assessment.notes[0]
    assert calibrate(simulate(200, spread=NOISE)).assessment.level == "good"


def test_too_few_poses_are_refused() -> None:
    R, p = simulate(4).poses
    for count in (0, 1, 2):
        with pytest.raises(SamplesError, match=f"{count} poses; expected at least 3"):
            calibrate_pivot(R[:count], p[:count])
    with pytest.raises(SamplesError, match="one pose for point B"):
        calibrate_pivot(R, p, ["A", "A", "A", "B"])


def test_a_post_whose_poses_all_slipped_is_named() -> None:
    """The others tell the tip; of that post nothing agrees."""
    data = simulate(10, spread=NOISE, posts=POSTS)
    R, p = (part.copy() for part in data.poses)
    p[20:] += np.random.default_rng(0).uniform(-0.1, 0.1, (10, 3))
    with pytest.raises(SamplesError, match=r"point post_3 that do not agree.*slip off"):
        calibrate_pivot(R, p, data.term.poses.samples.labels["point"])


# ── Outliers ─────────────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("seeds", of_size(2, 6))
@pytest.mark.parametrize("posts", [POSTS[:1], POSTS], ids=["one post", "three posts"])
@pytest.mark.parametrize("nature", NATURES)
def test_outliers_are_listed_and_cost_next_to_nothing(
    nature: Any, posts: FloatArray, seeds: int
) -> None:
    """30 % of 60 poses: the error is that of the others alone."""
    robust, alone, more = [], [], []
    for seed in range(seeds):
        data = simulate(
            60 // len(posts), spread=NOISE, seed=seed, posts=posts, gross=OutlierModel(0.3, nature)
        )
        found = calibrate(data)
        assert set(found.outliers) >= set(data.outliers)
        more.append(len(found.outliers) - len(data.outliers))
        robust.append(tip_error(found, data))
        rows = data.inliers
        labels = data.term.poses.samples.labels["point"][rows]
        R, p = data.poses
        alone.append(tip_error(calibrate_pivot(R[rows], p[rows], labels, robust=False), data))
    # Noise of the orientation is longer across the tip than along it: at most one false alarm.
    assert sum(more) <= seeds // 6
    assert np.sqrt(np.mean(np.square(robust))) < 1.3 * np.sqrt(np.mean(np.square(alone)))


# ── Accuracy ─────────────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("seeds", of_size(6, 15))
@pytest.mark.parametrize("share", [0.0, 0.3])
def test_200_poses_of_a_good_tracker_tell_the_tip_to_a_sixth_of_a_millimetre(
    share: float, seeds: int
) -> None:
    """0.3 mm and 0.1° per axis, turns up to 45°, a tip 152 mm away.

    Least squares over the inliers alone, which nobody knows, err by 0.13 mm RMS without outliers
    and 0.16 mm with.
    """
    errors = [
        tip_error(calibrate(data), data)
        for data in (
            simulate(200, spread=NOISE, seed=s, gross=OutlierModel(share)) for s in range(seeds)
        )
    ]
    assert np.median(errors) < (0.15e-3 if share == 0.0 else 0.18e-3)
    assert np.max(errors) < 0.4e-3


def test_a_tool_whose_tip_is_its_own_origin() -> None:
    rng = np.random.default_rng(0)
    R = rotation_from_vector(rng.uniform(-0.5, 0.5, (60, 3)))
    found = calibrate_pivot(R, [0.3, -0.2, 1.5] + 0.3e-3 * rng.standard_normal((60, 3)))
    assert np.linalg.norm(found.tip) < 1e-3


def test_poses_without_a_common_point_are_called_so() -> None:
    rng = np.random.default_rng(0)
    R = rotation_from_vector(rng.uniform(-2.0, 2.0, (20, 3)))
    with pytest.raises(SamplesError, match="whose tips scatter by"):
        calibrate_pivot(R, rng.uniform(-0.3, 0.3, (20, 3)))


@pytest.mark.parametrize(("R", "message"), [(np.ones((4, 3, 3)), "not a rotation"), (3, "shape")])
def test_what_are_no_poses_is_refused(R: object, message: str) -> None:
    with pytest.raises(SamplesError, match=message):
        calibrate_pivot(R, np.zeros((4, 3)))  # type: ignore[arg-type]


# ── A tool that is no rigid body ─────────────────────────────────────────────────────────────
def tilted(count: int, seed: int, bend: float) -> PivotCalibration:
    """Tilts of up to 45° to all sides; the tip is off towards them by ``bend`` times their sine."""
    random = np.random.default_rng(seed)
    tilt, side = random.uniform(0.0, np.pi / 4, count), random.uniform(-np.pi, np.pi, count)
    axis = np.column_stack([-np.sin(side), np.cos(side), np.zeros(count)])
    spin = random.uniform(-1.0, 1.0, count)[:, None] * [0.0, 0.0, 1.0]
    R = rotation_from_vector(tilt[:, None] * axis) @ rotation_from_vector(spin)
    off = bend * np.sin(tilt)[:, None] * np.column_stack([np.cos(side), np.sin(side), 0.0 * tilt])
    p = np.array([0.1, 0.2, -1.0]) + off - R @ [0.0, 0.0, 0.15]
    return calibrate_pivot(R, p + 1.5e-4 * random.standard_normal((count, 3)))


def test_a_tool_that_bends_the_farther_it_tilts_is_told() -> None:
    """The tip takes up what is in proportion to the tilt, and ± allows for it."""
    for seed in range(4):
        found = tilted(120, seed, 1.4e-3)
        off = np.linalg.norm(found.tip - [0.0, 0.0, 0.15])
        assert off > 1e-3
        assert off < 3 * np.linalg.norm(found.tip_std)
        assert found.bent.evidence.effect.about == pytest.approx(np.pi / 4, abs=0.03)
        assert found.assessment.level == "care"
        assert any("± includes it" in note for note in found.assessment.notes)


def one_sided(count: int, seed: int, bend: float) -> PivotCalibration:
    """A blade: it bends by ``bend`` m per rad of tilt across its flat, and not along it."""
    term = FixedPoint.simulate(count, spread=PoseNoise(1e-4, 2e-4), seed=seed).term
    R, p = term.poses.at({})
    tip = np.array([0.02, -0.01, 0.15])
    _, to_sides, _ = bending(R, tip)
    off = np.einsum("nij,njk,k->ni", R, to_sides, [bend, 0.0, 0.0, 0.0])
    return calibrate_pivot(R, p - off)


@pytest.mark.parametrize("count", [30, 100])
def test_a_tool_that_bends_to_one_side_is_told(count: int) -> None:
    for seed in range(4):
        found = one_sided(count, seed, 1e-3)
        assert found.bent.evidence.effect.name == TO_ONE_SIDE
        assert found.assessment.level == "care"
        assert np.linalg.norm(found.tip - [0.02, -0.01, 0.15]) < 3.5 * np.linalg.norm(found.tip_std)


@pytest.mark.parametrize("count", [30, 100])
def test_what_hardly_bends_is_within_plus_minus_or_said_to_be_unseen(count: int) -> None:
    """1 mm per rad, evenly: where it is not named, ± holds it or the answer says so much."""
    for seed in range(6):
        found = tilted(count, seed, 1e-3)
        off = np.linalg.norm(found.tip - [0.0, 0.0, 0.15])
        if off > 3.0 * np.linalg.norm(found.tip_std):
            assert found.unseen is not None
            by, tilt = found.unseen
            assert off < 1.2 * by / tilt
            assert "bends equally to all sides by less than" in found.relied_on


def test_an_answer_says_that_no_residual_shows_the_scale() -> None:
    data = simulate(40, spread=NOISE)
    (R, p), found = data.poses, calibrate(data)
    longer = calibrate_pivot(R, 1.01 * p)
    assert np.linalg.norm(longer.tip) == pytest.approx(1.01 * np.linalg.norm(found.tip), rel=1e-4)
    assert longer.assessment.level == found.assessment.level == "good"
    assert "an error of 1 % makes the tip" in " ".join(longer.assessment.notes)


@pytest.mark.parametrize("seeds", of_size(5, 15))
@pytest.mark.parametrize("count", [8, 30, 120])
def test_a_rigid_tool_does_not_bend(count: int, seeds: int) -> None:
    assert not any(tilted(count, seed, 0.0).bent for seed in range(seeds))
