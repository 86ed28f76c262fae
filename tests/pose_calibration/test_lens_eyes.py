"""Hand-eye from pictures that were taken through any lens."""

from __future__ import annotations

import numpy as np
import pytest
from camera_scenes import errors
from lens_scenes import camera, each_camera, on_a_hand

from suta_calib.arrays import FloatArray
from suta_calib.pose_calibration import hand_eye_from_pictures
from suta_calib.pose_calibration.pictures import Intrinsics


def ratios(name: str, seeds: range, intrinsics: Intrinsics) -> FloatArray:
    """Errors of X over their standard deviations (seeds, 6)."""
    found = []
    for seed in seeds:
        hand, view = on_a_hand(camera(name), seed)
        answer = hand_eye_from_pictures(hand, [view], intrinsics=intrinsics)
        assert answer.assessment.usable
        (seen,) = answer.cameras
        found.append(errors(seen)[:6] / seen.std["X"])
    return np.array(found)


@each_camera
def test_x_is_found_through_every_lens(name: str) -> None:
    assert np.abs(ratios(name, range(1), "free")).max() < 4.0


@pytest.mark.slow
@pytest.mark.parametrize("intrinsics", ["free", "fixed"])
@each_camera
def test_the_standard_deviation_of_x_is_true(name: str, intrinsics: Intrinsics) -> None:
    """Forty trials of six figures: a root mean square scatters by 5 % alone, 8 % as it is."""
    spread = np.sqrt(np.mean(ratios(name, range(40), intrinsics) ** 2))
    assert 0.76 < spread < 1.24
