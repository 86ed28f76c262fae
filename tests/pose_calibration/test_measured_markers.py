"""Markers that a hand-eye calibration measures: their ±, the screen, JSON, and the board's file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from camera_scenes import X, write_hand
from cli_job import Capture, cli
from marker_scenes import CAMERA, DICTIONARY, MarkerScene, marker_scene, sought

from suta_calib.geometry.numbers import vector_from_rotation
from suta_calib.measurements import read_board, write_board, write_camera, write_corners
from suta_calib.measurements.board import Markers
from suta_calib.pose_calibration.pictures import hand_eye_from_pictures


@pytest.fixture(scope="module")
def scene() -> MarkerScene:
    return marker_scene(14)


@pytest.fixture
def files(scene: MarkerScene, tmp_path: Path) -> list[object]:
    write_hand(tmp_path / "poses.csv", scene.hand)
    write_corners(tmp_path / "corners.csv", scene.corners)
    write_camera(tmp_path / "camera.yaml", CAMERA)
    write_board(tmp_path / "board.yaml", Markers(DICTIONARY, sought(scene.true, ())))
    return [
        *(tmp_path / "poses.csv", "--corners", tmp_path / "corners.csv"),
        *("--board", tmp_path / "board.yaml", "--camera", tmp_path / "camera.yaml"),
    ]


def test_the_truth_is_within_its_standard_deviations(scene: MarkerScene) -> None:
    views = scene.views(sought(scene.true, ()))
    found = hand_eye_from_pictures(scene.hand, views, model="AX=ZB")
    (camera,) = found.cameras
    assert found.assessment.level == "good"
    assert np.all(np.abs(camera.X[:3, 3] - X[1]) < 4.0 * camera.std["X"][:3])
    assert camera.markers is not None
    assert 1e-4 < camera.markers.length_scale.std < 1e-3
    for number, marker in camera.markers.markers.items():
        true = scene.true[number]
        assert marker.size_std is not None
        assert abs(marker.size - true.size) < 4.0 * marker.size_std < 1e-3
        assert marker.position_std is not None
        assert marker.rotation_std is not None
        if number != 3:
            off = np.abs(marker.position - true.position)
            assert np.all(off < 4.0 * marker.position_std)
            turn = np.abs(vector_from_rotation(true.rotation.T @ marker.rotation))
            assert np.all(turn < 4.0 * marker.rotation_std)


def test_the_measured_board_is_a_file_to_be_used(
    files: list[object], tmp_path: Path, capsys: Capture
) -> None:
    assert cli("hand-eye", *files, "--out", tmp_path / "out") == 0
    said = capsys.readouterr().out
    assert "Markers in the frame of marker 3" in said
    assert "board.yaml" in said
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert set(result["markers"]) == {"3", "4", "5", "6", "7", "8"}
    assert {"position_mm", "position_std_mm", "size_mm", "size_std_mm"} <= set(
        result["markers"]["4"]
    )
    board = read_board(tmp_path / "out" / "board.yaml")
    assert isinstance(board, Markers)
    assert board.unplaced == ()
    files[4] = tmp_path / "out" / "board.yaml"
    assert cli("hand-eye", *files, "--json") == 0
    again = json.loads(capsys.readouterr().out)
    assert again["markers"] is None
    assert again["X_position_mm"] == pytest.approx(result["X_position_mm"], abs=0.1)


def test_without_a_camera_it_says_what_is_missing(files: list[object], capsys: Capture) -> None:
    assert cli("hand-eye", *files[:5]) == 2
    said = capsys.readouterr().err
    assert "markers of unknown places, and no camera" in said
