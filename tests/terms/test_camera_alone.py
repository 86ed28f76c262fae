"""A camera from its pictures of a board alone, whatever its lens does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camera_scenes import BOARD, LENS, X, pictures

from suta_calib.geometry.lens import PLUMB_BOB
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.pose_calibration.pictures import hand_eye_from_pictures
from suta_calib.terms.camera_alone import CameraState, PicturesSeen
from suta_calib.terms.lens_choice import camera_alone

# Of a wide lens: straight lines become curves of many pixels.
WIDE = np.array([640.0, 642.0, 635.0, 482.0, -0.31, 0.11, 5e-4, -4e-4, -0.015])


def test_slopes_are_differences() -> None:
    random, n, k = np.random.default_rng(0), 3, 5
    points = np.column_stack([random.uniform(-0.1, 0.1, (k, 2)), np.zeros(k)])
    place = np.column_stack([random.uniform(-0.05, 0.05, (n, 2)), random.uniform(0.4, 0.6, n)])
    at = CameraState(WIDE, rotation_from_vector(random.uniform(-0.4, 0.4, (n, 3))), place)
    there = np.ones((n, k), dtype=np.bool_)
    seen = PicturesSeen(points, np.zeros((n, k, 2)), there, PLUMB_BOB)
    by_camera, by_pose = seen.slopes(at)

    def slope(camera: np.ndarray, poses: np.ndarray) -> np.ndarray:
        ahead, behind = (seen.errors(at.moved(s * camera, s * poses)) for s in (1.0, -1.0))
        assert ahead is not None
        assert behind is not None
        return (ahead - behind) / 2.0

    for i, unit in enumerate(np.eye(9)):
        step = 1e-6 * max(1.0, abs(WIDE[i]))
        assert np.allclose(
            slope(step * unit, np.zeros((n, 6))) / step, by_camera[..., i], atol=1e-4
        )
    for i, unit in enumerate(np.eye(6)):
        step = np.tile(1e-6 * unit, (n, 1))
        assert np.allclose(slope(np.zeros(9), step) / 1e-6, by_pose[..., i], atol=1e-3)


@pytest.mark.parametrize("lens", [LENS, WIDE], ids=["usual", "wide"])
def test_without_noise_the_camera_is_found(lens: np.ndarray) -> None:
    (view,) = pictures(12, given=None, lens=lens).views
    found = camera_alone(view.corners, BOARD)[0].intrinsics
    assert found[:4] == pytest.approx(lens[:4], abs=0.02)
    assert found[4:] == pytest.approx(lens[4:], abs=2e-3)


def test_a_wrong_corner_pulls_no_harder_than_others() -> None:
    (view,) = pictures(12, given=None, pixel=0.05).views
    pixel = view.corners.pixel.copy()
    pixel[100] += 60.0
    found = camera_alone(replace(view.corners, pixel=pixel), BOARD)[0].intrinsics
    assert found[:4] == pytest.approx(LENS[:4], abs=1.5)


def test_hand_eye_needs_no_file_of_a_wide_lens() -> None:
    scene = pictures(14, given=None, pixel=0.05, robot=(1e-4, 1e-4), lens=WIDE)
    found = hand_eye_from_pictures(scene.hand, scene.views, model="AX=ZB")
    (seen,) = found.cameras
    assert found.assessment.level == "good"
    assert np.linalg.norm(seen.X[:3, 3] - X[1]) < 5.0 * np.linalg.norm(seen.std["X"][:3])
    assert seen.camera.stds is not None
    assert np.all(np.abs(seen.camera.intrinsics - WIDE)[:4] < 5.0 * seen.camera.stds[:4])
