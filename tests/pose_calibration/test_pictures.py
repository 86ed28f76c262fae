"""Hand-eye from pictures of a board: recovery, spread, wrong cameras, and what is wrong by name."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from camera_scenes import BOARD, CAMERA, LENS, SECOND, Pictures, X, Z, pictures
from cli_job import Capture, answer, cli

from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import vector_from_rotation
from suta_calib.measurements import (
    Camera,
    Charuco,
    Chessboard,
    SutaCalibWarning,
    corners_of,
    read_camera,
    write_camera,
    write_corners,
)
from suta_calib.pose_calibration.picture_answer import PictureCalibration, SeenCamera
from suta_calib.pose_calibration.pictures import hand_eye_from_pictures

EXCHANGED = Chessboard(BOARD.rows, BOARD.columns, BOARD.square)
OPTIONS: dict[str, Any] = {"setup": "eye-in-hand", "model": "AX=ZB"}


def solved(scene: Pictures, **more: Any) -> PictureCalibration:
    return hand_eye_from_pictures(scene.hand, scene.views, **OPTIONS | more)


def errors(seen: SeenCamera, eye: Any = X, board: Any = Z) -> np.ndarray:
    """Displacement, m, and turn, rad, of X and of Z against the truth, (12,)."""
    found = []
    for T, (R, p) in ((seen.X, eye), (seen.Z, board)):
        found += [T[:3, 3] - p, vector_from_rotation(R.T @ T[:3, :3])]
    return np.concatenate(found)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("intrinsics", ["fixed", "free"])
def test_without_noise_everything_is_found(setup: str, intrinsics: str) -> None:
    found = solved(pictures(setup=setup), setup=setup, intrinsics=intrinsics)
    (seen,) = found.cameras
    truth = (X, Z) if setup == "eye-in-hand" else (Z, X)
    assert np.abs(errors(seen, *truth)).max() < 1e-7
    assert found.rms < 1e-5
    assert found.assessment.level == "good"
    assert not found.outliers


def test_noise_is_told_and_a_wrong_camera_corrected() -> None:
    """A principal point off by a pixel and a focal length by 2 %, which X would follow."""
    wrong = Camera(1280, 960, np.add(LENS, [20.0, 20.0, 1.0, 1.0, 0, 0, 0, 0, 0]))
    scene = pictures(24, pixel=0.1, given=wrong)
    fixed, free = (solved(scene, intrinsics=how).cameras[0] for how in ("fixed", "free"))
    std = np.concatenate([free.std["X"], free.std["Z"]])
    assert np.abs(errors(free) / std).max() < 4.0
    assert np.linalg.norm(errors(fixed)[:3]) > 5 * np.linalg.norm(errors(free)[:3])
    stds = free.camera.stds
    assert stds is not None
    assert np.abs((free.camera.intrinsics - LENS) / stds)[:4].max() < 4.0
    note = solved(scene).assessment.notes[-1]
    assert "contradict the camera's file (fx 1020.0 → " in note


def test_the_intrinsics_may_be_unknown() -> None:
    (seen,) = solved(pictures(24, pixel=0.1, given=None)).cameras
    std = np.concatenate([seen.std["X"], seen.std["Z"]])
    assert np.abs(errors(seen) / std).max() < 4.0
    assert np.abs(seen.camera.intrinsics - LENS)[:4].max() < 5.0
    assert abs(seen.camera.intrinsics[4] - LENS[4]) < 0.01


def test_corners_that_a_camera_was_calibrated_from_are_counted_once() -> None:
    """Its covariance is what these corners say, so that as a prior they would say it twice."""
    scene = pictures(16, pixel=0.1, given=None)
    (view,) = scene.views
    alone = solved(scene).cameras[0].camera
    told = replace(alone, width=1280, height=960)

    def stds(given: Camera) -> np.ndarray:
        (seen,) = solved(replace(scene, views=(replace(view, camera=given),))).cameras
        assert seen.camera.stds is not None
        return seen.camera.stds

    once, twice = stds(replace(told, corners=view.corners.digest)), stds(told)
    assert alone.stds is not None
    assert once == pytest.approx(alone.stds, rel=0.02)
    assert np.all(twice[:4] < 0.85 * once[:4])
    same = replace(told, corners=view.corners.digest)
    answer = solved(replace(scene, views=(replace(view, camera=same),)))
    assert answer.assessment.level == "good"
    assert "from these very corners: they are counted once" in answer.assessment.notes[-1]


def test_a_robots_errors_are_told_from_the_cameras() -> None:
    """Corners of a picture share where the hand was: a hundred of them are one witness."""
    scene = pictures(40, pixel=0.1, robot=(5e-4, 1e-3))
    (seen,) = solved(scene).cameras
    assert seen.rms > 5 * seen.alone
    assert seen.alone == pytest.approx(0.1 * np.sqrt(2), rel=0.1)
    std = np.concatenate([seen.std["X"], seen.std["Z"]])
    assert np.abs(errors(seen) / std).max() < 4.0
    assert np.linalg.norm(std[:3]) > 1e-4


def spread(trials: int) -> np.ndarray:
    """Root mean square error of X, in its standard deviations, (6,)."""
    ratios = []
    for seed in range(trials):
        scene = pictures(16, pixel=0.2, robot=(3e-4, 5e-4), seed=seed)
        (seen,) = solved(scene).cameras
        ratios.append(errors(seen)[:6] / seen.std["X"])
    return np.sqrt(np.mean(np.square(ratios), axis=0))


def test_the_spread_is_the_predicted_one() -> None:
    """Six trials of six figures: their root mean square scatters by a sixth or so."""
    assert 0.5 < np.sqrt(np.mean(spread(6) ** 2)) < 1.5


@pytest.mark.slow
def test_the_spread_is_the_predicted_one_closely() -> None:
    assert 0.8 < np.sqrt(np.mean(spread(100) ** 2)) < 1.2


def test_how_far_the_hand_is_off_is_told() -> None:
    """Displaced and turned hands are told from each other, and from corners that scatter."""
    found = solved(pictures(30, pixel=0.1, robot=(1e-3, 2e-3), seed=1)).noise
    assert found.corners["default"] == pytest.approx(0.1, rel=0.15)
    for learned, truth in ((found.position, 1e-3), (found.rotation, 2e-3)):
        assert abs(np.log(learned.value / truth)) < 3.0 * learned.log_std < 1.0


def test_a_principal_point_a_pixel_off_is_named_and_costs_nothing() -> None:
    """Pixels that are counted from another corner: within what files err by, and seen all the same.

    Also the other way round: the right file is not blamed.
    """
    away = Camera(1280, 960, np.add(LENS, [0.0, 0.0, 1.0, 1.0, 0, 0, 0, 0, 0]))
    right, wrong = (solved(pictures(20, pixel=0.03, given=file)) for file in (CAMERA, away))
    assert not right.assessment.notes
    assert wrong.assessment.level == "good"
    assert "put the principal point at (64" in wrong.assessment.notes[0]
    std = wrong.cameras[0].std["X"]
    assert np.abs(errors(wrong.cameras[0])[:6] / std).max() < 4.0


@pytest.mark.parametrize(
    ("shift", "contradicted"), [((0, 0, 0, 0), False), ((0, 0, 1, 1), True), ((5, 5, 0, 0), True)]
)
def test_wrong_intrinsics_that_are_held_do_not_pass_in_silence(
    shift: tuple[float, ...], contradicted: bool
) -> None:
    """Half a per cent of the focal length, or a pixel: X follows the file, and must say so."""
    file = Camera(1280, 960, np.add(LENS, [*shift, 0, 0, 0, 0, 0]))
    found = solved(pictures(24, pixel=0.1, given=file), intrinsics="fixed")
    (seen,) = found.cameras
    assert seen.held
    assert np.array_equal(seen.camera.intrinsics, file.intrinsics)
    assert [("were held (fx" in note) for note in found.assessment.notes] == [True] * contradicted
    assert (found.assessment.level == "care") == contradicted
    assert seen.told.stds is not None
    off = (seen.told.intrinsics - LENS)[:4] / seen.told.stds[:4]
    assert np.abs(off).max() < 4.0


def alarms(trials: int) -> int:
    """How often right intrinsics are contradicted, with a hand that is not where it says."""
    notes = (
        solved(pictures(16, pixel=0.1, robot=(3e-4, 5e-4), seed=seed), intrinsics="fixed")
        for seed in range(trials)
    )
    return sum(any("were held" in note for note in each.assessment.notes) for each in notes)


@pytest.mark.slow
def test_right_intrinsics_are_rarely_contradicted() -> None:
    """Two tests of one in a hundred: of two hundred calibrations, four; ten is far too many."""
    assert alarms(200) <= 10


def test_a_rectified_camera_has_no_distortion_to_hide_a_principal_point_in() -> None:
    """Coefficients that are zero in the file are no part of the camera: they stay out of the way.

    With as little as 1e-4 of play they took up a third of the principal point's error.
    """
    straight = np.concatenate([LENS[:4], np.zeros(5)])
    away = Camera(1280, 960, np.add(straight, [0.0, 0.0, 1.0, 1.0, 0, 0, 0, 0, 0]))
    off = []
    for seed in range(3):
        scene = pictures(16, pixel=0.05, seed=seed, given=away, lens=straight)
        (seen,) = solved(scene).cameras
        assert np.abs(seen.camera.intrinsics[4:]).max() < 1e-6
        off.append(seen.camera.intrinsics[2:4] - straight[2:4])
        std = seen.std["X"]
        assert np.abs(errors(seen)[:6] / std).max() < 4.0
    assert np.sqrt(np.mean(np.square(off))) < 0.2


WORKCELL = Path(__file__).parents[3] / "shared/data/images/workcell_camera1"


@pytest.mark.slow
@pytest.mark.skipif(not WORKCELL.exists(), reason="the pictures are not here")
@pytest.mark.parametrize("shift", [0.0, 1.0])
def test_rendered_pictures_of_a_workcell(shift: float, tmp_path: Path, capsys: Capture) -> None:
    """From pictures to the camera; also where its file counts pixels from another corner."""
    pytest.importorskip("cv2")
    board, out = WORKCELL / "board.yaml", tmp_path / "corners.csv"
    found = answer(capsys, "detect", WORKCELL / "images", "--board", board, "--out", out)
    assert found["verdict"]["usable"]
    known = read_camera(WORKCELL / "camera.yaml")
    moved = np.add(known.intrinsics, [0.0, 0.0, shift, shift, 0, 0, 0, 0, 0])
    write_camera(tmp_path / "camera.yaml", replace(known, intrinsics=moved))
    options = ["--corners", out, "--board", board, "--camera", tmp_path / "camera.yaml"]
    said = answer(capsys, "hand-eye", WORKCELL / "poses.csv", "--setup", "eye-to-hand", *options)
    truth = np.array(json.loads((WORKCELL / "truth.json").read_text())["T_base_camera"])
    T = np.array(said["X"])
    # The pose method is 2.2 mm and 0.12° off. What is left is a turn of all poses.
    # These pictures are exact but for four samples to a pixel, which rendered again at the fit
    # explain 0.87 of the errors (correlation). With them taken off, corners scatter by 0.015 px in
    # place of 0.030, and X stays where it was, 0.93 mm and 0.0255° away. At 0.0147 px the truth
    # leaves a χ² of 2533 with 948 degrees of freedom, X free 971, three turns of the base about its
    # origin (0.019°, 0.002°, 0.018°) 1018; shifts of the base 1731, focal lengths, principal point
    # and distortion 1225, sizes of board and of motions no less than without. A common turn of the
    # base is in no picture, whoever finds the corners and whatever is free.
    assert np.linalg.norm(T[:3, 3] - truth[:3, 3]) < 0.9e-3
    assert np.linalg.norm(vector_from_rotation(truth[:3, :3].T @ T[:3, :3])) < np.radians(0.025)
    assert said["counts"]["inliers"] == 40
    held = answer(
        capsys,
        *("hand-eye", WORKCELL / "poses.csv", "--setup", "eye-to-hand", *options),
        *("--intrinsics", "fixed"),
    )
    named = [note for note in held["verdict"]["notes"] if "intrinsics that were held" in note]
    assert len(named) == bool(shift)


def test_two_cameras_and_a_board_with_marks_are_solved_together() -> None:
    board = Charuco(7, 6, 0.03, 0.022, "DICT_4X4_50")
    found = solved(pictures(16, pixel=0.05, eyes=(X, SECOND), board=board))
    for seen, eye in zip(found.cameras, (X, SECOND), strict=True):
        assert np.linalg.norm(errors(seen, eye)[:3]) < 1e-3
        assert np.array_equal(seen.Z, found.cameras[0].Z)
    assert len(found.cameras[1].images) > 6


# ── what is wrong ────────────────────────────────────────────────────────────────────────────
def other(scene: Pictures, corners: Any, **view: Any) -> Pictures:
    """The scene with other corners."""
    return replace(scene, views=(replace(scene.views[0], corners=corners, **view),))


def test_boards_turned_by_half_a_turn_and_wrong_poses_are_left_out() -> None:
    scene = pictures(20, pixel=0.1)
    corners = scene.views[0].corners
    turned = np.isin(corners.image, ["003.png", "011.png"])
    last = len(BOARD.points) - 1
    point = np.where(turned, last - corners.point, corners.point)
    scene = other(scene, replace(corners, point=point))
    scene.hand.pose[1][7] += 0.02
    found = solved(scene)
    (seen,) = found.cameras
    assert seen.strange == ["003.png", "007.png", "011.png"]
    assert seen.turned == {"board": ("003.png", "011.png"), "picture": ()}
    assert found.outliers == (3, 7, 11)
    assert np.linalg.norm(errors(seen)[:3]) < 1e-3
    assert "In 003.png, 011.png the board is turned by half a turn" in found.assessment.notes[0]


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_a_board_that_looks_the_same_turned_is_numbered_as_the_poses_tell(setup: str) -> None:
    """However many pictures are numbered from the other end."""
    board = Chessboard(6, 4, 0.03)
    scene = pictures(20, setup=setup, pixel=0.1, robot=(1e-4, 2e-4), board=board)
    corners = scene.views[0].corners
    turned = np.isin(corners.image, [f"{k:03d}.png" for k in range(1, 20, 2)])
    point = np.where(turned, len(board.points) - 1 - corners.point, corners.point)
    with pytest.warns(SutaCalibWarning, match="looks the same after half a turn; in"):
        (seen,) = solved(other(scene, replace(corners, point=point)), setup=setup).cameras
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
    other = replace(second, corners=turned)
    with pytest.warns(SutaCalibWarning, match="from the other end than in the pictures of a row"):
        found = solved(replace(scene, views=(first, other)), setup=setup)
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
    found = solved(other(scene, replace(corners, pixel=pixel)))
    (seen,) = found.cameras
    assert seen.turned == {"board": (), "picture": ("004.png", "012.png")}
    assert "In 004.png, 012.png the picture is turned by half a turn" in found.assessment.notes[0]
    assert np.linalg.norm(errors(seen)[:3]) < 1e-3


@pytest.mark.parametrize("intrinsics", ["fixed", "free"])
def test_a_size_of_other_pictures_in_the_file_is_named(intrinsics: str) -> None:
    scene = pictures(16, pixel=0.1, given=replace(CAMERA, width=2560, height=1920))
    (note,) = solved(scene, intrinsics=intrinsics).assessment.notes
    assert "says 2560 x 1920 px" in note


def test_a_board_that_is_numbered_mirrored_is_named() -> None:
    scene = pictures(pixel=0.1)
    corners = scene.views[0].corners
    row, column = np.divmod(corners.point, BOARD.columns)
    mirrored = replace(corners, point=BOARD.columns * row + BOARD.columns - 1 - column)
    found = solved(other(scene, mirrored))
    assert "seen from behind" in found.assessment.notes[0]
    assert np.linalg.norm(found.cameras[0].X[:3, 3] - X[1]) < 1e-3


def test_one_corner_far_off_costs_no_more_than_its_picture() -> None:
    scene = pictures(pixel=0.1)
    corners = scene.views[0].corners
    pixel = corners.pixel.copy()
    pixel[40] += [25.0, 10.0]
    (seen,) = solved(other(scene, replace(corners, pixel=pixel))).cameras
    assert np.linalg.norm(errors(seen)[:3]) < 1e-3


def test_pictures_that_agree_with_no_x_say_why() -> None:
    scene = pictures(pixel=0.1)
    corners = scene.views[0].corners
    wide = replace(corners, pixel=corners.pixel * 0.5 + [500.0, 0.0])
    half = replace(corners, pixel=(corners.pixel + 0.5) / 2 - 0.5)
    mirrored = replace(corners, pixel=[1279.0, 0.0] + corners.pixel * [-1.0, 1.0])
    upwards = replace(corners, pixel=[0.0, 959.0] + corners.pixel * [1.0, -1.0])
    rotation, position = scene.hand.pose
    far = replace(scene, hand=replace(scene.hand, pose=(rotation, 1e3 * position)))
    small = other(scene, corners, board=BOARD.scaled(0.1))
    for wrong, said in (
        (other(scene, wide), "focal length of some (49|50)"),
        (other(scene, half), "corners of pictures of some 640 x 480 px"),
        (other(scene, corners, board=EXCHANGED), "if its columns and rows are exchanged"),
        (other(scene, mirrored), "or the pictures are mirrored"),
        (other(scene, upwards), "if v counts upwards"),
        (far, "moves 100"),
        (small, "moves 10 times"),
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
    found = solved(other(scene, scene.views[0].corners, board=BOARD.scaled(size)), setup=setup)
    (seen,) = found.cameras
    assert found.assessment.level == level
    assert seen.board_scale * size == pytest.approx(1.0, rel=0.01)
    assert any("as the pictures show by the size" in n for n in found.assessment.notes) == (
        size != 1.0
    )


def sized(seed: int, size: float, **more: Any) -> SeenCamera:
    """From a rough hand, by a board that its file has so many times as large as it is."""
    scene = pictures(20, pixel=0.05, robot=(2e-3, 3e-3), seed=seed)
    (found,) = solved(
        other(scene, scene.views[0].corners, board=BOARD.scaled(size)), **more
    ).cameras
    return found


def test_how_large_the_board_is_is_told_as_surely_as_a_rough_hand_tells_it() -> None:
    """Six of each: their root mean square scatters by a fifth or so."""
    off = []
    for seed in range(6):
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
    assert any("were held (fx" in note for note in found.assessment.notes)


def test_a_board_of_other_counts_is_named_by_its_columns() -> None:
    scene = pictures(pixel=0.1)
    wrong = Chessboard(BOARD.columns + 1, BOARD.rows + 1, BOARD.square)
    with pytest.raises(SamplesError, match=f"numbered along rows of {BOARD.columns}"):
        solved(other(scene, scene.views[0].corners, board=wrong))


def test_a_board_of_other_counts_is_named_without_a_camera_too() -> None:
    """A camera that is found from the corners must not be blamed for the board's file."""
    scene = pictures(pixel=0.1)
    corners = scene.views[0].corners
    some = corners.take(corners.point < 25)
    for wrong, said in (
        (other(scene, corners, board=EXCHANGED, camera=None), "columns and rows are exchanged"),
        (other(scene, some, board=Chessboard(5, 5, 0.03), camera=None), "numbers of columns"),
    ):
        with pytest.raises(SamplesError, match=said):
            solved(wrong)


def test_names_that_do_not_match_are_refused() -> None:
    scene = pictures()
    corners = scene.views[0].corners
    renamed = replace(corners, image=np.char.add("x", corners.image))
    with pytest.raises(SamplesError, match=r"000\.png.* in the samples and x000\.png"):
        solved(other(scene, renamed))
    two = corners.take(np.isin(corners.image, ["000.png", "001.png"]))
    with (
        pytest.warns(UserWarning, match="no corners of 14 of 16 images"),
        pytest.raises(SamplesError, match="found 2 pictures that tell where the board is"),
    ):
        solved(other(scene, two))


# ── the command ──────────────────────────────────────────────────────────────────────────────
def test_the_command_answers_and_writes(tmp_path: Path, capsys: Capture) -> None:
    options = pictures(14, pixel=0.1).written(tmp_path)
    out = tmp_path / "out"
    found = answer(capsys, "hand-eye", *options, "--model", "AX=ZB", "--out", out)
    assert found["frames"] == {"X": "T_hand_eye", "Z": "T_base_target"}
    assert np.linalg.norm(np.array(found["X"])[:3, 3] - X[1]) < 2e-3
    assert 0.1 < found["reprojection_rms_px"] < 0.2
    assert found["outliers"] == []
    assert found["counts"]["images"] == 14
    camera = found["camera"]
    assert camera["fx"] == pytest.approx(1000.0, abs=5.0)
    assert len(camera["distortion"]) == len(camera["std"]["distortion"]) == 5
    assert 0.0 < camera["std"]["fx"] < 5.0
    assert {p.name for p in out.iterdir()} == {
        *("residuals.csv", "hand_eye.svg", "result.json", "report.html", "camera.yaml")
    }
    written = read_camera(out / "camera.yaml")
    assert written.covariance is not None
    assert written.intrinsics[0] == pytest.approx(camera["fx"])
    run = json.loads((out / "result.json").read_text())["run"]
    assert {Path(name).name for name in run["inputs"]} == {
        *("poses.csv", "corners.csv", "board.yaml", "camera.yaml")
    }


def test_the_screen_says_what_counts(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    options = pictures(14, pixel=0.1, setup="eye-to-hand").written(tmp_path)
    assert cli("hand-eye", *options, "--setup", "eye-to-hand", "--intrinsics", "fixed") == 0
    said, err = capsys.readouterr()
    assert err == ""
    assert max(map(len, said.splitlines())) <= 80
    assert "X = T_base_eye" in said
    assert "reprojection rms 0.1" in said
    assert "14 of 14 pictures fitted" in said
    assert "Intrinsics" not in said


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--board", "b.yaml"], "belong to --corners"),
        (["--corners", "c.csv"], "--corners needs --board"),
        (["--corners", "c.csv", "--board", "b.yaml", "--intrinsics", "fixed"], "needs --camera"),
        (
            ["--corners", "c.csv", "--corners", "d.csv", "--board", "b", "--camera", "k"],
            "1 --camera for 2 --corners",
        ),
        (["--corners", "c.csv", "--board", "b.yaml"], "found no such file"),
    ],
)
def test_options_that_do_not_go_together(
    options: list[str], said: str, tmp_path: Path, capsys: Capture
) -> None:
    assert cli("hand-eye", tmp_path / "poses.csv", *options) == 2
    assert said in capsys.readouterr().err


def test_a_corner_outside_the_cameras_picture_is_refused(tmp_path: Path, capsys: Capture) -> None:
    scene = pictures()
    options = scene.written(tmp_path)
    corners = scene.views[0].corners
    outside = corners_of(corners.image, corners.point, np.add(corners.pixel, [900.0, 0.0]))
    write_corners(tmp_path / "corners.csv", outside)
    assert cli("hand-eye", *options) == 2
    err = capsys.readouterr().err
    assert "corners.csv:" in err
    assert f"one in the picture, which is {CAMERA.width} x {CAMERA.height} px" in err
