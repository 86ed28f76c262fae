"""Files of two cameras that were exchanged are named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camera_scenes import BOARD, LENS, SECOND, Pictures, X, pictures, solved
from studies import first_of

from suta_calib.errors import SamplesError
from suta_calib.measurements import Camera
from suta_calib.pose_calibration.exchanged_files import refuse_exchanged_files
from suta_calib.pose_calibration.pictures import View
from suta_calib.pose_calibration.rig import rig_from_pictures
from suta_calib.terms.board_pictures import BoardPictures


def two_cameras(change: float) -> tuple[Pictures, list[View]]:
    """Of one hand; the second has other intrinsics."""
    other = LENS + np.array([change, change, 8.0, -6.0, 0, 0, 0, 0, 0])
    lenses = LENS, other
    scenes = [
        pictures(16, pixel=0.1, eyes=(X, SECOND), lens=lens, given=Camera(1280, 960, lens))
        for lens in lenses
    ]
    views = [
        replace(scene.views[k], label=name)
        for k, (scene, name) in enumerate(zip(scenes, "ab", strict=True))
    ]
    return scenes[0], views


@pytest.mark.parametrize("change", [4.0, 60.0])
def test_exchanged_files_are_named(change: float) -> None:
    """Cameras of one make, whose focal lengths differ by 0.4 %, or of two."""
    scene, views = two_cameras(change)
    wrong = [
        replace(view, camera=other.camera) for view, other in zip(views, views[::-1], strict=True)
    ]
    with pytest.raises(SamplesError, match="camera a that fit the file of camera b"):
        rig_from_pictures(wrong)
    with pytest.raises(SamplesError, match="exchange the files of the two cameras"):
        solved(replace(scene, views=tuple(wrong)))


@pytest.mark.parametrize("seed", first_of(range(4)))
def test_right_files_and_files_a_little_off_are_not(seed: int) -> None:
    _, views = two_cameras(4.0)
    off = np.random.default_rng(seed).normal(0.0, [2.0, 2.0, 2.0, 2.0, 0, 0, 0, 0, 0], (2, 9))
    given = []
    for view, error in zip(views, off, strict=True):
        assert view.camera is not None
        camera = replace(view.camera, intrinsics=view.camera.intrinsics + error)
        given.append(BoardPictures(BOARD, camera, view.corners.table(BOARD.points)))
    refuse_exchanged_files(["a", "b"], given)


@pytest.mark.parametrize("since", [8, 11])
def test_labels_exchanged_from_a_picture_on_are_named_though_the_cameras_differ(since: int) -> None:
    """Corners are read with the camera that would have seen them: of the other's they are off."""
    scene, (a, b) = two_cameras(12.0)
    late = scene.hand.image[since:]
    parts = [
        (one.corners.take(~np.isin(one.corners.image, late)), other.corners)
        for one, other in ((a, b), (b, a))
    ]
    views = []
    for view, (before, other) in zip((a, b), parts, strict=True):
        after = other.take(np.isin(other.image, late))
        joined = replace(
            before,
            image=np.concatenate([before.image, after.image]),
            point=np.concatenate([before.point, after.point]),
            pixel=np.concatenate([before.pixel, after.pixel]),
            lines=(),
        )
        views.append(replace(view, corners=joined))
    first = scene.hand.image[since]
    with pytest.raises(SamplesError, match=f"a and b are exchanged from picture {first} on"):
        solved(replace(scene, views=tuple(views)))
