"""What is wrong with pictures of a board, or with their files, and is named."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from camera_scenes import BOARD, CAMERA, LENS, Pictures, X, Z, errors, pictures, solved
from studies import of_size

from suta_calib.errors import SamplesError, SutaCalibWarning
from suta_calib.measurements import Camera, Chessboard
from suta_calib.pose_calibration.picture_answer import CameraEstimate

EXCHANGED = Chessboard(BOARD.rows, BOARD.columns, BOARD.square)


def other(scene: Pictures, **changed: Any) -> Pictures:
    """The scene with other corners, and another board or camera if given."""
    view = scene.views[0]
    ours = {key: changed.pop(key) for key in ("board", "camera") if key in changed}
    return replace(scene, views=(replace(view, corners=replace(view.corners, **changed), **ours),))


def test_boards_turned_by_half_a_turn_and_wrong_poses_are_left_out() -> None:
    scene = pictures(20, pixel=0.1)
    corners = scene.views[0].corners
    turned = np.isin(corners.image, ["003.png", "011.png"])
    last = len(BOARD.points) - 1
    point = np.where(turned, last - corners.point, corners.point)
    scene = other(scene, point=point)
    scene.hand.pose[1][7] += 0.02
    found = solved(scene)
    (seen,) = found.cameras
    assert seen.strange == ["003.png", "007.png", "011.png"]
    assert seen.turned == {"board": ("003.png", "011.png"), "picture": (), "mirror": ()}
    assert found.outliers == (3, 7, 11)
    assert np.linalg.norm(errors(seen)[:3]) < 1e-3
    assert "In 003.png, 011.png the board is turned by half a turn" in found.assessment.notes[0]


@pytest.mark.parametrize(("by", "named"), [(0.0, False), (3e-3, True)])
def test_a_board_that_was_moved_is_named_with_its_picture(by: float, named: bool) -> None:
    """One picture less is good, so that its row among the fitted ones is another."""
    scene = pictures(20, pixel=0.1, robot=(1e-4, 2e-4), seed=1)
    R, p = scene.hand.pose
    # As seen from a board that stands still, the base moves the other way.
    moved = p - np.where(np.arange(20) < 12, 0.0, by)[:, None] * [0.6, 0.8, 0.0]
    moved[4] += 0.03
    (seen,) = solved(replace(scene, hand=replace(scene.hand, pose=(R, moved)))).cameras
    assert seen.strange == ["004.png"]
    assert bool(seen.moved) == named
    if named:
        since, size = seen.moved.split(" is at another place, by ")
        assert since == "From picture 012.png on the target (or the base)"
        length, std = map(float, size.split(" mm")[0].split(" ± "))
        assert abs(length - 3.0) < 3.0 * std < 0.6


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_a_board_that_looks_the_same_turned_is_numbered_as_the_poses_tell(setup: str) -> None:
    """However many pictures are numbered from the other end."""
    board = Chessboard(6, 4, 0.03)
    scene = pictures(20, setup=setup, pixel=0.1, robot=(1e-4, 2e-4), board=board)
    corners = scene.views[0].corners
    turned = np.isin(corners.image, [f"{k:03d}.png" for k in range(1, 20, 2)])
    point = np.where(turned, len(board.points) - 1 - corners.point, corners.point)
    with pytest.warns(SutaCalibWarning, match="looks the same after half a turn. In"):
        (seen,) = solved(other(scene, point=point), setup=setup).cameras
    (known,) = solved(scene, setup=setup).cameras
    assert seen.inliers.all()
    assert np.allclose(seen.X, known.X, rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_two_cameras_number_such_a_board_from_one_end(setup: str) -> None:
    """Each by most of its own pictures, which may be opposite ends; where the board is tells."""
    eye = X if setup == "eye-in-hand" else Z
    board, eyes = Chessboard(6, 4, 0.03), (eye, (eye[0], eye[1] + [0.04, 0.0, 0.02]))
    scene = pictures(12, setup=setup, pixel=0.05, board=board, eyes=eyes)
    first, second = scene.views
    turned = replace(second.corners, point=23 - second.corners.point)
    views = first, replace(second, corners=turned)
    with pytest.warns(
        SutaCalibWarning, match="from the other end than in the pictures of an earlier row"
    ):
        found = solved(replace(scene, views=views), setup=setup)
    alike = solved(scene, setup=setup)
    assert found.assessment.level == "good"
    for seen, known in zip(found.cameras, alike.cameras, strict=True):
        assert np.allclose(seen.X, known.X, atol=1e-9)
        assert np.allclose(seen.Z, known.Z, atol=1e-9)


def test_pictures_of_a_camera_that_was_upside_down_are_left_out_and_named() -> None:
    scene = pictures(20, pixel=0.1)
    corners = scene.views[0].corners
    turned = np.isin(corners.image, ["004.png", "012.png"])
    upside_down = [1279.0, 959.0] - corners.pixel
    pixel = np.where(turned[:, None], upside_down, corners.pixel)
    found = solved(other(scene, pixel=pixel))
    (seen,) = found.cameras
    assert seen.turned == {"board": (), "picture": ("004.png", "012.png"), "mirror": ()}
    assert "In 004.png, 012.png the picture is turned by half a turn" in found.assessment.notes[0]
    assert np.linalg.norm(errors(seen)[:3]) < 1e-3


@pytest.mark.parametrize("intrinsics", ["fixed", "free"])
def test_a_size_of_other_pictures_in_the_file_is_named(intrinsics: str) -> None:
    scene = pictures(16, pixel=0.1, given=replace(CAMERA, width=2560, height=1920))
    (note,) = solved(scene, intrinsics=intrinsics).assessment.notes
    assert "states 2560 x 1920 px" in note


def test_a_board_that_is_numbered_mirrored_is_named() -> None:
    scene = pictures(pixel=0.1)
    corners = scene.views[0].corners
    row, column = np.divmod(corners.point, BOARD.columns)
    mirrored = BOARD.columns * row + BOARD.columns - 1 - column
    found = solved(other(scene, point=mirrored))
    assert found.assessment.level == "good"
    assert "z of the board's frame points out of its face" in found.assessment.notes[0]
    assert np.linalg.norm(found.cameras[0].X[:3, 3] - X[1]) < 1e-3


def test_one_corner_far_off_costs_no_more_than_its_picture() -> None:
    scene = pictures(pixel=0.1)
    corners = scene.views[0].corners
    pixel = corners.pixel.copy()
    pixel[40] += [25.0, 10.0]
    (seen,) = solved(other(scene, pixel=pixel)).cameras
    assert np.linalg.norm(errors(seen)[:3]) < 1e-3


def test_pictures_that_agree_with_no_x_say_why() -> None:
    scene = pictures(10, pixel=0.1)
    pixel = scene.views[0].corners.pixel
    rotation, position = scene.hand.pose
    far = replace(scene, hand=replace(scene.hand, pose=(rotation, 1e3 * position)))
    for wrong, said in (
        (other(scene, pixel=pixel * 0.5 + [500.0, 0.0]), r"plumb_bob, fx (49|50)\d, "),
        (other(scene, pixel=(pixel + 0.5) / 2 - 0.5), "corners of pictures of about 640 x 480 px"),
        (other(scene, board=EXCHANGED), "if its columns and rows are exchanged"),
        (other(scene, pixel=[1279.0, 0.0] + pixel * [-1.0, 1.0]), "or the pictures are mirrored"),
        (other(scene, pixel=[0.0, 959.0] + pixel * [1.0, -1.0]), "if v counts upwards"),
        (far, "moves 100"),
        (other(scene, board=BOARD.scaled(0.1)), "moves 10 times"),
    ):
        with pytest.raises(SamplesError, match=said):
            solved(wrong)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize(("size", "level"), [(1.0, "good"), (1.02, "care"), (1.1, "bad")])
def test_a_board_that_was_printed_larger_or_smaller_is_named(
    setup: str, size: float, level: str
) -> None:
    """The robot's errors would explain what is left of it, and ± grow, but not as far as X."""
    scene = pictures(24, setup=setup, pixel=0.1, robot=(5e-4, 5e-4))
    found = solved(other(scene, board=BOARD.scaled(size)), setup=setup)
    (seen,) = found.cameras
    assert found.assessment.level == level
    assert seen.board_scale * size == pytest.approx(1.0, rel=0.01)
    told = any("as the pictures show with the size" in n for n in found.assessment.notes)
    assert told == (size != 1.0)


def sized(seed: int, size: float, **more: Any) -> CameraEstimate:
    """From a rough hand, by a board that its file has so many times as large as it is."""
    scene = pictures(20, pixel=0.05, robot=(2e-3, 3e-3), seed=seed)
    (found,) = solved(other(scene, board=BOARD.scaled(size)), **more).cameras
    return found


@pytest.mark.parametrize("seeds", of_size(3, 6))
def test_how_large_the_board_is_is_told_as_surely_as_a_rough_hand_tells_it(seeds: int) -> None:
    """Six of each: their root mean square scatters by a fifth or so."""
    off = []
    for seed in range(seeds):
        told = sized(seed, 0.97, intrinsics="fixed" if seed % 2 else "free").board_size
        off.append(np.log(told.value * 0.97) / told.log_std)
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.5


def silent_and_alarmed(trials: int) -> tuple[int, int]:
    """Boards 4 % too large that pass in silence, and right ones that do not."""
    seeds = range(trials)
    silent = sum(sized(seed, 1.04).board_scale == 1.0 for seed in seeds)
    return silent, sum(sized(seed, 1.0).board_scale != 1.0 for seed in seeds)


@pytest.mark.slow
def test_a_rough_hand_tells_a_large_board_and_blames_no_right_one() -> None:
    silent, alarmed = silent_and_alarmed(60)
    assert silent == 0
    assert alarmed <= 3


def test_a_focal_length_that_is_held_wrong_is_no_board_of_another_size() -> None:
    file = Camera(1280, 960, np.add(LENS, [20.0, 20.0, 0, 0, 0, 0, 0, 0, 0]))
    found = solved(pictures(24, pixel=0.1, robot=(5e-4, 5e-4), given=file), intrinsics="fixed")
    assert found.cameras[0].board_scale == 1.0
    assert any("the fixed intrinsics (fx" in note for note in found.assessment.notes)


def test_a_board_of_other_counts_is_named_by_its_columns() -> None:
    scene = pictures(pixel=0.1)
    wrong = Chessboard(BOARD.columns + 1, BOARD.rows + 1, BOARD.square)
    with pytest.raises(SamplesError, match=f"numbered along rows of {BOARD.columns}"):
        solved(other(scene, board=wrong))


def test_a_board_of_other_counts_is_named_without_a_camera_too() -> None:
    """A camera that is found from the corners must not be blamed for the board's file."""
    scene = pictures(pixel=0.1)
    corners = scene.views[0].corners
    some = replace(scene.views[0], corners=corners.take(corners.point < 25), camera=None)
    few = replace(scene, views=(replace(some, board=Chessboard(5, 5, 0.03)),))
    for wrong, said in (
        (other(scene, board=EXCHANGED, camera=None), "columns and rows are exchanged"),
        (few, "numbers of columns"),
    ):
        with pytest.raises(SamplesError, match=said):
            solved(wrong)


def test_names_that_do_not_match_are_refused() -> None:
    scene = pictures()
    corners = scene.views[0].corners
    renamed = other(scene, image=np.char.add("x", corners.image))
    with pytest.raises(SamplesError, match=r"000\.png.* in the samples and x000\.png"):
        solved(renamed)
    two = corners.take(np.isin(corners.image, ["000.png", "001.png"]))
    with (
        pytest.warns(UserWarning, match="no corners of 14 of 16 images"),
        pytest.raises(
            SamplesError, match="found 2 pictures from which the pose of the board follows"
        ),
    ):
        solved(replace(scene, views=(replace(scene.views[0], corners=two),)))


def test_many_pictures_that_are_left_out_are_named() -> None:
    """More than a third have poses of another time: nobody may take the rest without a look."""
    scene = pictures(17, pixel=0.1, robot=(1e-4, 1e-4))
    R, p = scene.hand.pose
    p = p.copy()
    p[11:] += np.random.default_rng(1).normal(0.0, 0.03, (6, 3))
    found = solved(replace(scene, hand=replace(scene.hand, pose=(R, p))))
    assert found.cameras[0].strange == [f"{k:03d}.png" for k in range(11, 17)]
    assert found.assessment.level == "care"
    said = " ".join(found.assessment.notes)
    assert "6 of 17 pictures do not agree with the others and are left out" in said
    assert "what 011.png, 012.png" in said
