"""A stereo pair or a rig: where cameras are by a board that they saw together."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from camera_scenes import BOARD, CAMERA, SECOND, X, pictures
from click.testing import CliRunner

from suta_calib.arrays import FloatArray
from suta_calib.cli._app import app
from suta_calib.errors import SamplesError
from suta_calib.geometry.lens import EQUIDISTANT
from suta_calib.geometry.numbers import homogeneous, rotation_from_vector, vector_from_rotation
from suta_calib.measurements import (
    Camera,
    Chessboard,
    corners_of,
    write_board,
    write_camera,
    write_corners,
)
from suta_calib.pose_calibration.pictures import View
from suta_calib.pose_calibration.rig import RigCalibration, rig_from_pictures

TRUE = np.linalg.inv(homogeneous(*X)) @ homogeneous(*SECOND)


# How well the files know the cameras: fx, fy, cx, cy, px; a lens that is known.
KNOWN = np.array([2.0, 2.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def calibrated(seed: int) -> Camera:
    error = KNOWN * np.random.default_rng(seed).standard_normal(len(KNOWN))
    return replace(CAMERA, intrinsics=CAMERA.intrinsics + error, covariance=np.diag(KNOWN**2))


def pair(seed: int = 0, count: int = 16, **more: object) -> list[View]:
    views = pictures(count, pixel=0.1, eyes=(X, SECOND), seed=seed, **more).views  # type: ignore[arg-type]
    return [
        replace(view, label=name, camera=calibrated(100 * seed + k))
        for k, (view, name) in enumerate(zip(views, "ab", strict=True))
    ]


def errors(found: RigCalibration) -> FloatArray:
    """Displacement, m, and turn, rad, of the second camera, over their ±."""
    (second,) = found.others
    shift = second.pose[:3, 3] - TRUE[:3, 3]
    turn = vector_from_rotation(TRUE[:3, :3].T @ second.pose[:3, :3])
    return np.concatenate([shift, turn]) / second.std6


def test_a_stereo_pair_is_found_without_a_robot() -> None:
    found = rig_from_pictures(pair())
    assert found.assessment.level == "good"
    assert np.abs(errors(found)).max() < 3.5
    back = found.between("b", "a")
    assert np.allclose(back.pose @ found.others[0].pose, np.eye(4))
    # The board's scale is a part of the distance, and so of its ±.
    scale = BOARD.length_scale.std * np.linalg.norm(TRUE[:3, 3])
    assert np.linalg.norm(found.others[0].std6[:3]) > scale


def test_a_wrong_file_that_is_held_is_named() -> None:
    held = rig_from_pictures(pair(), intrinsics="fixed")
    assert held.assessment.usable
    wrong = pair()
    camera = wrong[0].camera
    assert camera is not None
    factors = np.array([1.01, 1.01, *np.ones(7)])
    wrong[0] = replace(wrong[0], camera=replace(camera, intrinsics=camera.intrinsics * factors))
    held = rig_from_pictures(wrong, intrinsics="fixed")
    assert not held.assessment.usable
    assert "contradict the file of camera a" in held.assessment.sentence + str(
        held.assessment.notes
    )


def test_its_std_is_the_scatter() -> None:
    ratios = np.array([errors(rig_from_pictures(pair(seed))) for seed in range(8)])
    # The scale is right here: what is in the ± of places for it is not in their scatter.
    spread = np.sqrt(np.mean(ratios**2, axis=0))
    assert (spread < 1.6).all()
    assert (spread[3:] > 0.5).all()


@pytest.mark.slow
def test_so_it_is_over_forty_pairs() -> None:
    ratios = np.array([errors(rig_from_pictures(pair(seed))) for seed in range(40)])
    spread = np.sqrt(np.mean(ratios[:, 3:] ** 2, axis=0))
    assert (spread > 0.66).all()
    assert (spread < 1.34).all()


def test_files_that_are_right_may_be_held() -> None:
    views = [replace(view, camera=CAMERA) for view in pair()]
    found = rig_from_pictures(views, intrinsics="fixed")
    assert found.cameras[0].camera.covariance is None
    assert np.abs(errors(found)).max() < 3.5


def test_pictures_belong_together_by_their_numbers() -> None:
    left, right = pair()
    names = np.array([f"right_{int(name[:3]):d}.png" for name in right.corners.image.tolist()])
    renamed = replace(right, corners=replace(right.corners, image=names))
    same, other = (rig_from_pictures([left, one]) for one in (right, renamed))
    assert np.allclose(same.others[0].pose, other.others[0].pose)


def test_a_board_that_looks_the_same_after_half_a_turn() -> None:
    left, right = pair(board=Chessboard(6, 4, 0.03))
    turned = np.isin(right.corners.image, ["002.png", "004.png"])
    point = np.where(turned, 23 - right.corners.point, right.corners.point)
    found = rig_from_pictures([left, replace(right, corners=replace(right.corners, point=point))])
    assert found.assessment.level == "good"
    assert np.abs(errors(found)).max() < 3.5


def test_a_picture_of_another_instant_is_left_out_and_named() -> None:
    left, right = pair()
    pixel = right.corners.pixel + np.where(right.corners.image == "005.png", 20.0, 0.0)[:, None]
    found = rig_from_pictures([left, replace(right, corners=replace(right.corners, pixel=pixel))])
    assert sum((camera.left_out for camera in found.cameras), ()) == ("005.png",)
    assert "005.png" in found.assessment.notes[0]
    assert np.abs(errors(found)).max() < 3.5


def test_pictures_of_other_instants_are_named() -> None:
    """The board moved between the left and the right picture."""
    left, right = pair()
    random = np.random.default_rng(1)
    moved = {name: 4.0 * random.standard_normal(2) for name in right.corners.images}
    pixel = right.corners.pixel + [moved[name] for name in right.corners.image.tolist()]
    seen = replace(right.corners, pixel=pixel).take(CAMERA.inside(pixel))
    found = rig_from_pictures([left, replace(right, corners=seen)])
    assert not found.assessment.usable
    assert any("not of one instant" in note for note in found.assessment.notes)


def test_what_is_not_enough_is_refused_by_name() -> None:
    left, right = pair()
    with pytest.raises(SamplesError, match="one camera"):
        rig_from_pictures([left])
    with pytest.raises(SamplesError, match="no file of camera b"):
        rig_from_pictures([left, replace(right, camera=None)])
    few = right.corners.take(np.isin(right.corners.image, ["000.png", "001.png"]))
    with pytest.raises(SamplesError, match="2 instants at which camera b"):
        rig_from_pictures([left, replace(right, corners=few)])
    wrong = Camera(1280, 960, np.array([500.0, 500, 640, 480, 0, 0, 0, 0]), lens=EQUIDISTANT)
    with pytest.raises(SamplesError, match="plumb_bob"):
        rig_from_pictures([left, replace(right, camera=wrong)])


def three_cameras() -> tuple[list[View], list[FloatArray]]:
    """A pair and a fisheye, of which the last two alone saw the board together with the second."""
    fisheye = Camera(1280, 960, np.array([500.0, 500, 640, 480, 0.01, 0, 0, 0]), lens=EQUIDISTANT)
    cameras = [CAMERA, CAMERA, fisheye]
    poses = [np.eye(4), TRUE, TRUE @ homogeneous(rotation_from_vector([0.1, 0.3, 0]), [0.1, 0, 0])]
    points, random = np.array(list(BOARD.points.values())), np.random.default_rng(3)
    rows: list[list[tuple[str, int, FloatArray]]] = [[], [], []]
    for k in range(24):
        turn = rotation_from_vector(random.uniform(-0.5, 0.5, 3))
        board = points @ turn.T + [*random.uniform(-0.05, 0.05, 2), random.uniform(0.5, 0.7)]
        board = board - (turn @ points.mean(axis=0)) + TRUE[:3, 3] / 2
        for c in (0, 1) if k < 12 else (1, 2):
            there = (board - poses[c][:3, 3]) @ poses[c][:3, :3]
            for n, pixel in enumerate(cameras[c].project(there)):
                if cameras[c].inside(pixel):
                    rows[c].append((f"{k}.png", n, pixel + 0.1 * random.standard_normal(2)))
    views = [
        View(name, corners_of(*map(np.array, zip(*seen, strict=True))), BOARD, camera)
        for name, seen, camera in zip("abc", rows, cameras, strict=True)
    ]
    return views, poses


def test_a_rig_of_several_cameras_in_files(tmp_path: Path) -> None:
    views, poses = three_cameras()
    write_board(tmp_path / "board.yaml", BOARD)
    words = ["--board", tmp_path / "board.yaml"]
    for view in views:
        write_corners(tmp_path / f"{view.label}.csv", view.corners)
        assert view.camera is not None
        write_camera(tmp_path / f"{view.label}.yaml", view.camera)
        words += ["--corners", f"{view.label}={tmp_path / view.label}.csv"]
        words += ["--camera", f"{view.label}={tmp_path / view.label}.yaml"]
    out = tmp_path / "out"
    answer = CliRunner().invoke(app, ["rig", *map(str, words), "--out", str(out)])
    assert answer.exit_code == 0, answer.output
    record = json.loads((out / "result.json").read_text())
    assert [one["eye"] for one in record["between_eyes"]] == ["b", "c"]
    for one, true in zip(record["between_eyes"], poses[1:], strict=True):
        assert np.linalg.norm(np.array(one["T"])[:3, 3] - true[:3, 3]) < 2e-3
    chain = yaml.safe_load((out / "camchain.yaml").read_text())
    assert chain["cam2"]["distortion_model"] == "equidistant"
    expected = np.linalg.inv(poses[2]) @ poses[1]
    assert np.allclose(chain["cam2"]["T_cn_cnm1"], expected, atol=5e-3)
    assert (out / "camera-c.yaml").is_file()
