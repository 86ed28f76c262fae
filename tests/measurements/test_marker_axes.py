"""Markers that lie on a board another way round than its file says are taken as they are seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from suta_calib.errors import SutaCalibWarning
from suta_calib.geometry import projected
from suta_calib.measurements import (
    Camera,
    Chessboard,
    Corners,
    Marker,
    Markers,
    Samples,
    corners_of,
)
from suta_calib.measurements.marker_axes import markers_as_seen
from suta_calib.terms import CameraView, MeasuredPoses
from suta_calib.terms.board_pictures import BoardPictures

INTRINSICS = np.array([600.0, 600.0, 320.0, 240.0, -0.25, 0.1, 0.0, 0.0, 0.0])
Y_UP = np.diag([1.0, -1.0, -1.0])
QUARTER = Rotation.from_euler("z", 90, degrees=True).as_matrix()


def grid(turn: np.ndarray) -> Markers:
    """Twelve markers, each turned in its own axes."""
    places = [np.array([0.05 * (k % 4), 0.05 * (k // 4), 0.0]) for k in range(12)]
    return Markers("DICT_APRILTAG_36h11", {k: Marker(p, 0.035, turn) for k, p in enumerate(places)})


def seen(board: Markers, count: int = 3) -> Corners:
    """Corners in pictures from before the board, which its markers face, found to 0.2 px."""
    random, rows = np.random.default_rng(5), []
    points = np.array(list(board.points))
    place = board.positions(points)
    for k in range(count):
        R = Rotation.from_rotvec(0.4 * random.normal(size=3)).as_matrix()
        R = R @ np.diag([1.0, board.into, board.into])
        pixel = projected((place - place.mean(axis=0)) @ R.T + [0.01, 0.0, 0.4], INTRINSICS)
        rows.append((np.full(len(points), f"{k}.png"), points, pixel))
    names, numbers, pixels = (np.concatenate(part) for part in zip(*rows, strict=True))
    return corners_of(names, numbers, pixels + 0.2 * random.normal(size=pixels.shape))


@pytest.mark.parametrize("turn", [Y_UP, QUARTER, QUARTER @ Y_UP], ids=["y up", "quarter", "both"])
def test_markers_are_turned_as_they_are_seen(turn: np.ndarray):
    true, written = grid(turn), grid(np.eye(3))
    board, sentence = markers_as_seen(written, seen(true))
    points = list(true.points)
    assert np.allclose(board.positions(points), true.positions(points), atol=1e-12)
    assert ("y up" in sentence) == (turn is Y_UP)
    if turn is Y_UP:
        assert "rotation_rpy_deg: [180, 0, 0]" in sentence


@pytest.mark.parametrize("turn", [np.eye(3), Y_UP], ids=["y down", "y up"])
def test_a_right_file_is_left_as_it_is(turn: np.ndarray):
    board = grid(turn)
    assert markers_as_seen(board, seen(board)) == (board, "")


def test_what_tells_nothing_changes_nothing():
    """One marker lies as it is said to; a chessboard has none."""
    board, one = grid(np.eye(3)), seen(grid(Y_UP))
    assert markers_as_seen(board, one.take(one.point // 4 == 3)) == (board, "")
    chessboard = Chessboard(5, 4, 0.03)
    assert markers_as_seen(chessboard, one) == (chessboard, "")


def test_pictures_of_an_arm_are_read_so_too():
    true = grid(Y_UP)
    corners = seen(true, 4)
    samples = Samples.from_arrays([], np.zeros((4, 0)), labels={"image": corners.images})
    poses = MeasuredPoses(np.tile(np.eye(3), (4, 1, 1)), np.zeros((4, 3)), samples)
    with pytest.warns(SutaCalibWarning, match="places the markers with y up"):
        term = CameraView.of_corners(poses, corners, grid(np.eye(3)), Camera(640, 480, INTRINSICS))
    assert np.nanmax(term.pictures.rms) < 0.4
    assert term.pictures.numbered_otherwise == ("", "good")


def test_corners_that_are_listed_counter_clockwise_are_named():
    """As the AprilTag library lists them: it is not the file that is wrong."""
    board = grid(np.eye(3))
    clockwise = seen(board)
    listed = replace(clockwise, point=4 * (clockwise.point // 4) + 3 - clockwise.point % 4)
    turned, sentence = markers_as_seen(board, listed)
    assert "listed counter-clockwise" in sentence
    assert np.allclose(turned.positions(range(48)), board.positions(np.arange(48) ^ 3))
    nowhere = replace(board, markers={n: Marker(size=0.035) for n in board.markers})
    camera = Camera(640, 480, INTRINSICS)
    for corners, level in ((clockwise, "good"), (listed, "care")):
        pictures = BoardPictures(nowhere, camera, corners.table(nowhere.points))
        assert pictures.numbered_otherwise[1] == level
