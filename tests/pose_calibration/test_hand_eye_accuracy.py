"""Hand-eye calibration: how far it is off, how far it says it may be, with outliers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hand_eye_scenes import NATURES, WHOSE, calibrate, errors, noisy, rows_of
from spread import is_as_predicted
from studies import of_size

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import vector_from_rotation
from suta_calib.pose_calibration.hand_eye import HandEyeCalibration, calibrate_hand_eye
from suta_calib.pose_calibration.loop_answer import with_scale
from suta_calib.terms import HandEye
from suta_calib.terms.synthetic import EXACT, OutlierModel, PoseNoise


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
    ratio = spread_over_prediction("both", 30, 8)
    assert all(is_as_predicted(each, 3 * 8) for each in ratio), ratio


@pytest.mark.slow
@pytest.mark.parametrize("whose", WHOSE)
@pytest.mark.parametrize("count", [20, 100])
def test_the_monte_carlo_spread_is_the_predicted_one_closely(count: int, whose: str) -> None:
    ratio = spread_over_prediction(whose, count, 250)
    assert ((ratio > 0.8) & (ratio < 1.25)).all(), ratio


# ── Accuracy and outliers ────────────────────────────────────────────────────────────────────
def median_errors(count: int, share: float, trials: int) -> FloatArray:
    """Median error of X: angle (deg) and distance (mm)."""
    sets = (noisy(count, seed=seed, gross=OutlierModel(share)) for seed in range(trials))
    found = np.array([errors(calibrate(data), data) for data in sets])
    return np.asarray(np.median(found, axis=0) * [180.0 / np.pi, 1e3])


def test_100_poses_of_good_instruments_and_20_percent_outliers_among_them() -> None:
    """0.1° and 0.3 mm per axis, on hand and eye: 0.046° and 0.41 mm over 320 sets."""
    clean, spoiled = median_errors(100, 0.0, 5), median_errors(100, 0.2, 5)
    limit = np.array([0.06, 0.53])
    assert (clean < limit).all(), clean
    assert (spoiled < 1.2 * np.minimum(limit, 1.05 * clean)).all(), spoiled


@pytest.mark.parametrize("nature", NATURES)
def test_outliers_are_listed_and_cost_next_to_nothing(nature: Any) -> None:
    robust, alone = [], []
    for seed in range(3):
        data = noisy(60, seed=seed, gross=OutlierModel(0.3, nature))
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
        data = noisy(30, seed=seed, gross=OutlierModel(0.3, NATURES[seed % 3]))  # type: ignore[arg-type]
        turned, displaced = errors(calibrate(data), data)
        assert turned < np.radians(1.0), seed
        assert displaced < 5e-3, seed


def test_30_percent_outliers_never_win() -> None:
    assert_no_failures(4)


@pytest.mark.slow
def test_30_percent_outliers_never_win_in_a_hundred_trials() -> None:
    assert_no_failures(100)


def test_pairs_of_which_half_disagree_must_not_be_used() -> None:
    assessment = calibrate(noisy(60, gross=OutlierModel(0.45))).assessment
    assert not assessment.usable
    assert "45% of the pairs do not agree" in assessment.notes[0]


def test_few_poses_are_said_to_be_few() -> None:
    assessment = calibrate(noisy(8, turn=0.3)).assessment
    assert assessment.level == "care"
    assert any("X is known to" in note for note in assessment.notes)


@pytest.mark.parametrize("seeds", of_size(5, 8))
def test_few_pairs_with_exact_turns_are_as_sure_as_they_scatter(seeds: int) -> None:
    """Turns are weighed by no less than a tenth of a degree, and scatter by what they scatter."""
    found, predicted = [], []
    for seed in range(seeds):
        s = HandEye.simulate(25, hand=PoseNoise(0.0, 0.0), eye=PoseNoise(0.5e-3, 0.0), seed=seed)
        seen = s.seen
        result = calibrate_hand_eye(s.poses, seen)
        true = s.true_pose("hand_eye")
        found.append(vector_from_rotation(true[0].T @ result.X[:3, :3]))
        predicted.append(result.std["X"][3:] ** 2)
    ratio = np.sqrt(np.mean(np.square(found)) / np.mean(predicted))
    assert is_as_predicted(ratio, np.size(found))


@pytest.mark.parametrize("seeds", of_size(4, 10))
@pytest.mark.parametrize("count", [3, 4, 6])
def test_a_handful_of_pairs_is_never_called_sure(count: int, seeds: int) -> None:
    """Three pairs can be fitted exactly in position, which says nothing of how sure they are."""
    ratios = []
    for seed in range(seeds):
        s = HandEye.simulate(count, hand=EXACT, eye=PoseNoise(0.3e-3, np.radians(0.1)), seed=seed)
        try:
            found = calibrate_hand_eye(s.poses, s.seen)
        except SamplesError:
            continue
        assert found.assessment.level != "good"
        error = found.X[:3, 3] - s.true_pose("hand_eye")[1]
        ratios.append(np.sum(error**2) / np.sum(found.std["X"][:3] ** 2))
    assert len(ratios) > 3
    assert np.sqrt(np.median(ratios)) < 3.0


# ── A target of another size ─────────────────────────────────────────────────────────────────
def found_with(factor: float) -> HandEyeCalibration:
    made = HandEye.simulate(25, eye=PoseNoise(2e-4, 1e-3), seed=1)
    term = made.term
    hand, samples = term.poses.at({}), term.poses.samples
    return calibrate_hand_eye(hand, (samples.rotation, factor * samples.position))


def test_the_covariance_holds_what_one_factor_on_all_that_is_seen_does() -> None:
    exact, longer = found_with(1.0), found_with(1.0 + 1e-4)
    added = with_scale(exact, 100.0).covariance - exact.covariance
    moved = longer.X[:3, 3] - exact.X[:3, 3]
    assert np.linalg.norm(moved) > 1e-6
    np.testing.assert_allclose(np.sqrt(np.diag(added)[:3]), np.abs(moved), atol=3e-6)
    np.testing.assert_array_equal(with_scale(exact, 0.0).covariance, exact.covariance)
