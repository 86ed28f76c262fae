"""Boards of every kind are found where they are, with numbers that are their file's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2")

from vision_scenes import (  # noqa: E402
    CAMERA,
    CHARUCO,
    CHESSBOARD,
    MARKERS,
    OPTIONS,
    facing,
    taken,
    truth,
)

from suta_calib.errors import BoardError  # noqa: E402
from suta_calib.geometry import projected  # noqa: E402
from suta_calib.measurements import Camera, Charuco, Chessboard, Marker, Markers  # noqa: E402
from suta_calib.vision import RenderOptions, rendered  # noqa: E402
from suta_calib.vision.chessboard import ChessboardFinder  # noqa: E402
from suta_calib.vision.detection import finder_of  # noqa: E402
from suta_calib.vision.finder import NotSeenError  # noqa: E402
from suta_calib.vision.markers import marker_cells  # noqa: E402

BOARDS = {"chessboard": CHESSBOARD, "charuco": CHARUCO, "markers": MARKERS}
every_board = pytest.mark.parametrize("board", BOARDS.values(), ids=BOARDS)


def reason(board, grey) -> str:
    with pytest.raises(NotSeenError) as refused:
        finder_of(board).find(grey)
    return str(refused.value)


@every_board
@pytest.mark.parametrize("turn", [7, 100, 195])
def test_every_corner_is_where_it_is_whichever_way_the_board_lies(board, turn: float):
    T = facing(board, (25, -15, turn))
    found = finder_of(board).find(taken(board, T))
    error = found.pixel - truth(board, found.point, T)
    assert len(found.point) >= 0.9 * len(board.points)
    # A marker's corner has an edge's length to lean on, a square's four.
    assert np.sqrt(np.mean(error**2)) < (0.1 if board is MARKERS else 0.04)
    assert found.blur == pytest.approx(OPTIONS.blur, abs=0.15)


def test_the_stated_deviation_is_the_scatter():
    finder, T = finder_of(CHESSBOARD), facing(CHESSBOARD)
    noisy = replace(OPTIONS, noise=6.0)
    found = [finder.find(taken(CHESSBOARD, T, noisy, seed)) for seed in range(6)]
    scatter = np.std([each.pixel for each in found], axis=0, ddof=1)
    stated = np.mean([each.std for each in found], axis=0)
    assert 0.75 < np.sqrt(np.mean(scatter**2)) / np.sqrt(np.mean(stated**2)) < 1.25


def test_a_blurred_board_is_found_as_well():
    grey = taken(CHESSBOARD, options=replace(OPTIONS, blur=2.5))
    found = finder_of(CHESSBOARD).find(grey)
    assert np.abs(found.pixel - truth(CHESSBOARD, found.point)).max() < 0.3


@pytest.mark.parametrize(
    ("width", "options", "rms"),
    [
        (640, RenderOptions(samples=2, black=60, white=180, noise=40.0), 0.2),
        (1600, RenderOptions(samples=1, blur=3.5), 0.05),
    ],
    ids=["noise", "blur"],
)
def test_a_board_that_is_clear_only_in_smaller_copies_is_found(width: int, options, rms: float):
    """Noise hides every corner in the whole picture; wide blur makes a further row of its rim."""
    board, scale = Chessboard(11, 8, 0.03), width / 320
    camera = CAMERA.resized(scale)
    T = facing(board, depth=0.55)
    scene = 90 + 40 * np.sin(np.indices((camera.height, camera.width)).sum(axis=0) / (30 * scale))
    grey = rendered(board, camera, T, np.random.default_rng(1), options, scene=scene)
    found = ChessboardFinder(board).find(grey)
    assert len(found.point) > 80
    place = board.positions(found.point) @ T[:3, :3].T + T[:3, 3]
    assert np.std(found.pixel - projected(place, camera.intrinsics)) < rms
    with pytest.raises(NotSeenError, match="11x8 inner corners instead of 10x8"):
        ChessboardFinder(Chessboard(10, 8, 0.03)).find(grey)


def test_a_large_board_before_a_dark_scene_is_found():
    """What is behind it has as many patches as it has squares, and its black is not the darkest."""
    board, random = Chessboard(28, 17, 0.02), np.random.default_rng(0)
    camera = Camera(800, 500, np.array([750.0, 750, 400, 250, 0, 0, 0, 0, 0]))
    T = facing(board, (6, -7, 1), 1.6)
    scene = 22.0 + cv2.GaussianBlur(random.normal(0, 200, (500, 800)), (0, 0), 12)
    options = RenderOptions(samples=2, black=45, white=200, margin=0.3)
    grey = rendered(board, camera, T, random, options, scene=np.clip(scene, 3, 60))
    found = finder_of(board).find(grey)
    place = board.positions(found.point) @ T[:3, :3].T + T[:3, 3]
    assert len(found.point) == 28 * 17
    assert np.std(found.pixel - projected(place, camera.intrinsics)) < 0.1


def test_a_covered_corner_is_left_out_and_the_others_keep_their_numbers():
    grey = taken(CHESSBOARD)
    u, v = truth(CHESSBOARD, np.array([8]))[0].round().astype(int)
    grey[v - 3 : v + 4, u - 3 : u + 4] = 255
    found = finder_of(CHESSBOARD).find(grey)
    assert sorted(set(range(30)) - set(found.point.tolist())) == [8]
    assert np.abs(found.pixel - truth(CHESSBOARD, found.point)).max() < 0.2


@pytest.mark.parametrize("corners", [(7, 6), (5, 4)])
def test_a_board_of_another_size_is_named(corners: tuple[int, int]):
    said = reason(Chessboard(*corners, 0.03), taken(CHESSBOARD))
    assert f"inner corners instead of {corners[0]}x{corners[1]}" in said
    assert "6x5" in said


def test_two_boards_are_none():
    one = taken(CHESSBOARD)
    assert "two boards" in reason(CHESSBOARD, np.hstack([one, one]))


def test_a_marker_twice_is_two_boards():
    near = taken(MARKERS, facing(MARKERS, depth=0.8))
    assert "two boards: marker" in reason(MARKERS, np.vstack([near, near]))


@every_board
def test_an_empty_picture_and_one_of_something_else(board):
    random = np.random.default_rng(0)
    flat = np.full((240, 320), 90, dtype=np.uint8) + random.integers(0, 3, (240, 320), np.uint8)
    assert "an empty picture" in reason(board, flat)
    blobs = cv2.GaussianBlur(random.integers(0, 255, (240, 320), np.uint8), (0, 0), 9.0)
    stretched = cv2.normalize(blobs, None, 0, 255, cv2.NORM_MINMAX)
    assert "blurred" in reason(board, stretched)


@pytest.mark.parametrize("board", [CHARUCO, MARKERS], ids=["charuco", "markers"])
def test_mirrored_markers_and_other_dictionaries_are_named(board):
    grey = taken(board)
    assert "mirrored" in reason(board, np.ascontiguousarray(grey[:, ::-1]))
    other = replace(board, dictionary="DICT_6X6_50")
    assert f"markers of {board.dictionary}" in reason(other, grey)


def test_a_charuco_of_another_width_is_named():
    said = reason(Charuco(6, 5, 0.04, 0.028, CHARUCO.dictionary), taken(CHARUCO))
    assert "a board 5 squares wide instead of 6" in said


def test_markers_stand_where_opencv_draws_them():
    for rows in (5, 6):
        board = Charuco(5, rows, 0.04, 0.028, CHARUCO.dictionary)
        for legacy in (False, True):
            known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
            theirs = cv2.aruco.CharucoBoard((5, rows), 0.04, 0.028, known)
            theirs.setLegacyPattern(legacy)
            middles = np.array(theirs.getObjPoints())[:, :, :2].mean(axis=1)
            assert np.allclose((marker_cells(board, legacy=legacy) + 0.5) * 0.04, middles)


def test_a_charuco_as_older_versions_drew_it_is_found():
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    drawn = cv2.aruco.CharucoBoard((5, 6), 0.04, 0.028, known)
    drawn.setLegacyPattern(True)
    found = finder_of(CHARUCO).find(drawn.generateImage((200, 240)))
    assert found.point.tolist() == list(range(20))
    expected = CHARUCO.positions(found.point)[:, :2] / 0.04 * 40 - 0.5
    assert np.allclose(found.pixel, expected, atol=0.1)


def test_a_board_that_its_dictionary_cannot_have_is_refused():
    with pytest.raises(BoardError, match="did you mean 'DICT_4X4_50'"):
        finder_of(replace(CHARUCO, dictionary="DICT_4X4_5"))
    with pytest.raises(BoardError, match="marker 77 of DICT_4X4_50, which has 50"):
        finder_of(Markers("DICT_4X4_50", {77: Marker(np.zeros(3), 0.1)}))


def test_squares_without_number_are_left_to_the_search_that_ends(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A part of a large board: OpenCV's search from square to square need not come to an end."""
    tiles = Chessboard(31, 29, 0.012)
    picture = taken(tiles, facing(tiles, (25, -20, 15), 0.3))

    def endless(*_: object, **__: object) -> None:
        raise AssertionError("the search from square to square")

    monkeypatch.setattr(cv2, "findChessboardCorners", endless)
    for size in ((6, 5), (4, 3), (9, 6)):
        with pytest.raises(NotSeenError, match=r"chessboard|inner corners instead of"):
            finder_of(Chessboard(*size, 0.03)).find(picture)
    # The board itself has no more squares than are looked for.
    with pytest.raises(AssertionError, match="from square to square"):
        finder_of(CHESSBOARD).find(taken(CHESSBOARD))
