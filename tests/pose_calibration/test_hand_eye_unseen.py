"""Hand-eye: what leaves hardly any residual, and pairs that few others cannot prove wrong."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hand_eye_scenes import bent_hand, calibrate, errors, noisy, simulate
from studies import first_of, of_size

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import vector_from_rotation
from suta_calib.pose_calibration.hand_eye import HandEyeCalibration, calibrate_hand_eye
from suta_calib.terms import HandEye
from suta_calib.terms.hand_eye_start import EyeSetup, inverse_poses
from suta_calib.terms.synthetic import OutlierModel, PoseNoise, Simulated


# ── Inverted poses ───────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_both_poses_inverted_exchange_x_and_z_and_it_is_said(setup: EyeSetup) -> None:
    """The eye in the hand is 0.1 m off, the target in the base 0.64 m."""
    data = noisy(30)
    hand, seen = data.poses, data.seen
    if setup == "eye-to-hand":
        # The same loops: X is then in the base, Z on the hand.
        hand = inverse_poses(hand)
    right = calibrate_hand_eye(hand, seen, setup=setup)
    wrong = calibrate_hand_eye(inverse_poses(hand), inverse_poses(seen), setup=setup)
    np.testing.assert_allclose(wrong.Z, right.X, atol=5e-4)
    assert {right.inverted, wrong.inverted} == {"good", "care"}
    told = [
        f for f in (right, wrong) if any("both poses inverted" in n for n in f.assessment.notes)
    ]
    assert len(told) == 1


def test_an_eye_that_no_hand_could_hold_must_not_be_used() -> None:
    data = simulate(30, hand=PoseNoise(3e-4, 1e-3), Z=(np.eye(3), np.array([1.5, 0.2, 0.1])))
    wrong = calibrate_hand_eye(inverse_poses(data.poses), inverse_poses(data.seen))
    assert wrong.inverted == wrong.assessment.level == "bad"


def test_another_unit_in_both_poses_is_no_answer() -> None:
    """Of one alone it may be true: a stage moves by millimetres."""
    found, note = calibrate(noisy(30)), "looks like metres"
    levels = [replace(found, notes=(note,) * k).assessment.level for k in range(3)]
    assert levels == ["good", "care", "bad"]


# ── Few pairs ────────────────────────────────────────────────────────────────────────────────
@cache
def of_a_bent_robot(count: int, seed: int) -> tuple[Simulated[HandEye], HandEyeCalibration]:
    """Some 4 mm and 0.4°, alike where the hand is alike: a geometry that errs, no wrong pair."""
    data = simulate(count, seed=seed)
    return data, calibrate_hand_eye(bent_hand(data, seed), data.seen)


@pytest.mark.parametrize("seed", first_of(range(6)))
def test_of_few_pairs_with_correlated_errors_none_is_thrown_out(seed: int) -> None:
    _, found = of_a_bent_robot(15, seed)
    assert found.outliers == ()


@pytest.mark.parametrize("seed", first_of([1, 44]))
def test_of_many_pairs_with_correlated_errors_none_is_thrown_out(seed: int) -> None:
    """Half of them agree better among themselves; nor do alike errors hide whose turns they are."""
    _, found = of_a_bent_robot(60, seed)
    assert found.outliers == ()
    assert found.robot_noise_fraction > 0.5


def normalised(trials: int, count: int) -> FloatArray:
    """Errors of X, (6 trials,), in standard deviations, of robots that err alike in like poses."""
    found = []
    for seed in range(trials):
        data, answer = of_a_bent_robot(count, seed)
        R, p = data.true_pose("hand_eye")
        turn = vector_from_rotation(R.T @ answer.X[:3, :3])
        found.append(np.concatenate([answer.X[:3, 3] - p, turn]) / answer.std["X"])
    return np.concatenate(found)


@pytest.mark.parametrize("count", [15, 60])
def test_errors_that_neighbours_share_are_within_what_is_stated(count: int) -> None:
    """As if every pair erred for itself they would be 2.0 (15 pairs) and 3.6 times too large."""
    off = normalised(4, count)
    assert np.sqrt(np.mean(off**2)) < 1.6
    assert np.mean(np.abs(off) < 2.0) > 0.8


@pytest.mark.slow
@pytest.mark.parametrize("count", [8, 15, 30, 60])
def test_errors_that_neighbours_share_are_within_what_is_stated_closely(count: int) -> None:
    off = normalised(60, count)
    assert 0.8 < np.sqrt(np.mean(off**2)) < 1.4
    assert np.mean(np.abs(off) < 2.0) > 0.86


@pytest.mark.parametrize("count", [12, 15, 20])
def test_of_few_pairs_one_that_the_others_prove_wrong_is_thrown_out(count: int) -> None:
    for seed in range(2):
        data = noisy(count, seed=seed, gross=OutlierModel(2.5 / count))
        found = calibrate(data)
        assert found.outliers == data.outliers
        assert not found.suspects.any()


def test_pairs_that_stand_out_unproven_are_kept_told_and_widen() -> None:
    data = noisy(12, seed=3)
    assert data.seen is not None
    R, p = data.seen
    p = p.copy()
    p[4, 2] += 6e-3
    clean, found = calibrate(data), calibrate_hand_eye(data.poses, (R, p))
    assert found.inliers.all()
    assert np.flatnonzero(found.suspects).tolist() == [4]
    assert any(
        "pairs, 4 (rows from 0) are far from the others" in note for note in found.assessment.notes
    )
    assert (found.std["X"] > clean.std["X"]).all()


# ── A camera whose focal length errs ─────────────────────────────────────────────────────────
def with_focal_error(error: float, count: int, seed: int) -> tuple[float, HandEyeCalibration]:
    """What X is off by in its standard deviations; and the answer."""
    fine = PoseNoise(0.2e-3, np.radians(0.05))
    data = simulate(count, hand=fine, eye=fine, seed=seed)
    assert data.seen is not None
    R, p = data.seen
    found = calibrate_hand_eye(data.poses, (R, p * [1.0, 1.0, 1.0 + error]))
    return float(errors(found, data)[1] / np.linalg.norm(found.std["X"][:3])), found


@pytest.mark.parametrize("count", [25, 60])
def test_a_focal_length_that_errs_is_said_and_is_within_what_is_stated(count: int) -> None:
    """One per cent: X is off by 5 mm, of which the scatter alone tells 0.4 to 0.6 mm."""
    for seed in range(4):
        off, found = with_focal_error(0.01, count, seed)
        assert found.far_sight is not None
        share, std = found.trend
        assert share == pytest.approx(0.01, abs=4.0 * std)
        assert any("too far" in note for note in found.assessment.notes)
        assert off < 2.0


def test_a_part_of_the_pairs_may_not_show_why_plus_minus_is_wide() -> None:
    """113 pairs of a camera that sees 3 % too far: ± holds what X follows, and says so."""
    data = noisy(113, seed=2)
    (RA, pA), (RB, pB) = data.poses, data.seen
    whole = calibrate_hand_eye((RA, pA), (RB, [1.0, 1.0, 1.03] * pB))
    assert whole.far_sight is not None
    wide = float(np.linalg.norm(whole.std["X"][:3]))
    off = float(errors(whole, data)[1])
    assert off < 3.0 * wide
    (note,) = (n for n in whole.assessment.notes if "focal length of the camera is wrong" in n)
    narrow = re.search(r"Without it, ± would be ([\d.]+) mm", note)
    assert 1e-3 * float(narrow[1]) < 0.5 * wide


@pytest.mark.parametrize("seeds", of_size(4, 10))
def test_a_good_camera_is_not_doubted(seeds: int) -> None:
    doubted = [with_focal_error(0.0, 20, seed)[1].far_sight for seed in range(seeds)]
    assert not any(doubted)
