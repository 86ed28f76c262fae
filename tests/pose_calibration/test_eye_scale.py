"""A target of another size moves X by what its stated scale says."""

from __future__ import annotations

import numpy as np

from suta_calib.pose_calibration import calibrate_hand_eye
from suta_calib.pose_calibration.eye_scale import with_scale
from suta_calib.pose_calibration.hand_eye import HandEyeCalibration
from suta_calib.terms.hand_eye import HandEye
from suta_calib.terms.synthetic import PoseNoise


def found_with(factor: float) -> HandEyeCalibration:
    made = HandEye.simulate(25, eye=PoseNoise(2e-4, 1e-3), seed=1)
    term = made.term
    hand, samples = term.poses.at({}), term.poses.samples
    assert samples.rotation is not None
    assert samples.position is not None
    return calibrate_hand_eye(hand, (samples.rotation, factor * samples.position))


def test_the_covariance_holds_what_one_factor_on_all_that_is_seen_does() -> None:
    exact, longer = found_with(1.0), found_with(1.0 + 1e-4)
    added = with_scale(exact, 100.0).covariance - exact.covariance
    moved = longer.X[:3, 3] - exact.X[:3, 3]
    assert np.linalg.norm(moved) > 1e-6
    np.testing.assert_allclose(np.sqrt(np.diag(added)[:3]), np.abs(moved), atol=3e-6)
    np.testing.assert_array_equal(with_scale(exact, 0.0).covariance, exact.covariance)
