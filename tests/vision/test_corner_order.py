"""The numbers and frames that the guide to corners shows are those of `detect`, and of OpenCV."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from suta_calib.measurements import Charuco, Chessboard, Markers
from suta_calib.vision.detection import finder_of

cv2 = pytest.importorskip("cv2")


@pytest.fixture(scope="module")
def figure(repository: Path) -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(repository / "docs" / "figures"))
        return importlib.import_module("corners")


def drawn(figure: ModuleType, kind: type) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """The picture of a board in the guide, and where the guide has its numbers, px."""
    (board,) = (board for board in figure.BOARDS.values() if isinstance(board, kind))
    shift = figure.facing(board)[:3, 3]
    places = {n: figure.CAMERA.project(point + shift) for n, point in board.points.items()}
    return figure.picture(board), places


@pytest.mark.parametrize("kind", [Chessboard, Charuco, Markers])
def test_detect_numbers_corners_as_the_guide_draws_them(figure: ModuleType, kind: type) -> None:
    (board,) = (board for board in figure.BOARDS.values() if isinstance(board, kind))
    picture, places = drawn(figure, kind)
    found = finder_of(board).find(picture)
    assert sorted(found.point.tolist()) == sorted(places)
    expected = np.array([places[number] for number in found.point.tolist()])
    # Half a pixel would show: the centre of the first pixel is 0, 0.
    assert np.abs(found.pixel - expected).max() < 0.1


def test_opencv_numbers_a_chessboard_row_by_row(figure: ModuleType) -> None:
    """From either end."""
    picture, places = drawn(figure, Chessboard)
    success, corners = cv2.findChessboardCorners(picture, (4, 3))
    assert success
    expected, pixels = np.array([*places.values()]), corners.reshape(-1, 2)
    off = min(np.abs(way - expected).max() for way in (pixels, pixels[::-1]))
    assert off < 1.0


def test_opencv_numbers_markers_and_charuco_boards_alike(figure: ModuleType) -> None:
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    picture, places = drawn(figure, Markers)
    quads, numbers, _ = cv2.aruco.ArucoDetector(known).detectMarkers(picture)
    assert sorted(numbers.ravel().tolist()) == [2, 7]
    for quad, marker in zip(quads, numbers.ravel().tolist(), strict=True):
        expected = np.array([places[4 * marker + k] for k in range(4)])
        assert np.abs(quad.reshape(4, 2) - expected).max() < 2.0
    board = cv2.aruco.CharucoBoard((5, 4), 0.04, 0.028, known)
    picture, places = drawn(figure, Charuco)
    corners, ids, *_ = cv2.aruco.CharucoDetector(board).detectBoard(picture)
    expected = np.array([places[number] for number in ids.ravel().tolist()])
    assert len(ids) == len(places)
    assert np.abs(corners.reshape(-1, 2) - expected).max() < 1.0
    # The same frame, from the outer corner of the board.
    ours = [*figure.BOARDS.values()][1].points
    assert np.allclose(board.getChessboardCorners(), [*ours.values()], atol=1e-6)


def test_a_chessboard_looks_like_one_in_a_mirror(figure: ModuleType) -> None:
    """No picture of one tells; markers do."""
    (board, _, markers) = figure.BOARDS.values()
    found = finder_of(board).find(np.ascontiguousarray(figure.picture(board)[:, ::-1]))
    assert len(found.point) == 12
    with pytest.raises(Exception, match="mirrored"):
        finder_of(markers).find(np.ascontiguousarray(figure.picture(markers)[:, ::-1]))
