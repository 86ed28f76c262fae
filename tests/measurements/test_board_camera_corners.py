"""Boards, cameras and corners: files round trip; whatever is wrong is refused with its place."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from suta_calib.errors import BoardError, CameraError, InputError, SamplesError
from suta_calib.geometry.lens import PLUMB_BOB, projected
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.measurements import (
    Board,
    Camera,
    Charuco,
    Chessboard,
    Marker,
    Markers,
    corners_of,
    read_board,
    read_camera,
    read_corners,
    write_board,
    write_camera,
    write_corners,
)

TAGS = {
    7: Marker(np.array([0.0, 0.0, 0.0]), 0.08),
    12: Marker(np.array([0.1, 0.02, 0.0]), 0.05, rotation_from_rpy([0.0, 0.4, 0.1])),
}
BOARDS = [
    Chessboard(24, 17, 0.015),
    Charuco(12, 9, 0.02, 0.015, "DICT_5X5_1000"),
    Markers("DICT_APRILTAG_36h11", TAGS),
]
TYPE, D = "type: ", "dictionary: D\n"
LENS = [900.0, 910.0, 640.0, 350.0, -0.3, 0.12, 1e-3, -2e-3, -0.02]
ROS = """\
image_width: 1920
image_height: 1080
camera_name: narrow_stereo
camera_matrix: {rows: 3, cols: 3, data: [1371.0, 0, 959.5, 0, 1372.5, 539.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0, 0, 0, 0]}
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
"""
NAME = "camera_name: narrow_stereo"
OPENCV = """\
%YAML:1.0
---
calibration_time: "Sun Nov 22"
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 6.5e+02, 0., 3.2e+02, 0., 6.51e+02, 2.4e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 4
   cols: 1
   dt: d
   data: [ -2.8e-01, 2.5e-02, 1.2e-03, -1.4e-04 ]
"""


@pytest.mark.parametrize("board", BOARDS, ids=lambda board: board.type)
def test_a_board_is_written_and_read_back(tmp_path: Path, board: Board) -> None:
    write_board(tmp_path / "board.yaml", board)
    read = read_board(tmp_path / "board.yaml")
    assert type(read) is type(board)
    assert list(read.points) == list(board.points)
    numbers = list(board.points)
    np.testing.assert_allclose(read.positions(numbers), board.positions(numbers), atol=1e-11)


def test_points_are_numbered_along_the_rows_and_around_a_marker() -> None:
    chessboard, charuco, tags = BOARDS
    np.testing.assert_allclose(
        chessboard.positions([0, 23, 24]) / 0.015,
        np.array([[0, 0, 0], [23, 0, 0], [0, 1, 0]]),
        atol=1e-12,
    )
    np.testing.assert_allclose(charuco.positions([0, 11]) / 0.02, [[1, 1, 0], [1, 2, 0]])
    np.testing.assert_allclose(
        tags.positions([28, 29, 30, 31]) / 0.04, [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    )
    assert max(tags.points) == 51
    assert not chessboard.symmetric
    assert Chessboard(4, 6, 0.01).symmetric


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (TYPE + "circles\n", "one of chessboard, charuco, markers"),
        (TYPE + "chessboard\ncorners: [4, 3]\n", "square_mm: found no such key"),
        (TYPE + "chessboard\ncorners: [4, 3]\nsquare: 0.05\n", "square"),
        (TYPE + "chessboard\ncorners: [4, 3]\nsquare_mm: 0.05\n", "look like metres"),
        (TYPE + "chessboard\ncorners: [4, 3]\nsquare_mm: .nan\n", "a finite number"),
        (TYPE + "chessboard\ncorners: [4, 3]\nsquare_mm: 50000\n", "look like µm"),
        (TYPE + "chessboard\ncorners: [4.5, 3]\nsquare_mm: 50\n", "two whole numbers"),
        (TYPE + "chessboard\ncorners: [1, 3]\nsquare_mm: 50\n", "two whole numbers from 2"),
        (
            TYPE + "charuco\nsquares: [5, 4]\nsquare_mm: 20\nmarker_mm: 20\n" + D,
            "smaller than its sq",
        ),
        (
            TYPE + "markers\n" + D + "markers: {x: {position_mm: [0, 0, 0], size_mm: 8}}\n",
            "number of the marker",
        ),
        (TYPE + "markers\n" + D + "markers: {7: {position_mm: [0, 0, 0]}}\n", "size_mm"),
        (TYPE + "markers\n" + D + "markers: {7: {size_mm: 0}}\n", "a positive number"),
        (TYPE + "markers\n" + D + "markers: {7: {size_mm: 8}, 7: {}}\n", "the key '7' twice"),
        (
            TYPE + "markers\n" + D + "markers: {7: {rotation_rpy_deg: [0, 0, 0]}}\n",
            "rotation_rpy_deg without position_mm",
        ),
        (
            TYPE + "markers\n" + D + "markers: {7: {size_mm: 8}}\nstretch: free\n",
            "stretch: fixed, where places of markers are unknown",
        ),
    ],
)
def test_a_board_that_is_none_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "board.yaml"
    path.write_text(text)
    with pytest.raises(BoardError, match=r"board\.yaml") as error:
        read_board(path)
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Chessboard(0, -1, 0.03), r"board \(chessboard\): found 0 columns and -1 rows"),
        (lambda: Chessboard(5.0, 4, 0.03), "two whole numbers from 1 up"),  # type: ignore[arg-type]
        (lambda: Chessboard(5, 4, 0.0), "a square of 0 mm; expected a size greater than 0"),
        (lambda: Charuco(5, 1, 0.03, 0.02, "D"), "two whole numbers from 2 up"),
        (lambda: Charuco(5, 4, np.nan, 0.02, "D"), "a square of nan mm"),
        (lambda: Charuco(5, 4, 0.03, -0.02, "D"), "a marker of -20 mm"),
        (lambda: Charuco(5, 4, 0.03, 0.04, "D"), "a marker smaller than its square"),
        (lambda: Marker(np.zeros(3), 0.0), "a marker of 0 mm"),
        (lambda: Markers("D", {}), "no markers; expected at least one"),
    ],
)
def test_a_board_of_no_size_is_none(make: Callable[[], object], said: str) -> None:
    with pytest.raises(BoardError, match=said):
        make()


def test_a_point_that_a_board_does_not_have_is_refused() -> None:
    with pytest.raises(BoardError, match="found point 32; expected 4 m"):
        BOARDS[2].positions([28, 32])


def test_cameras_of_ros_and_of_opencv_are_read(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(ROS)
    camera = read_camera(path)
    assert (camera.width, camera.height, camera.covariance) == (1920, 1080, None)
    np.testing.assert_array_equal(camera.intrinsics[:5], [1371.0, 1372.5, 959.5, 539.5, 0.1])
    path.write_text(OPENCV)
    expected = [650.0, 651.0, 320.0, 240.0, -0.28, 0.025, 1.2e-3, -1.4e-4, 0.0]
    np.testing.assert_array_equal(read_camera(path).intrinsics, expected)


def test_a_camera_is_written_and_read_back_bit_for_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    factor = rng.normal(size=(9, 9)) * np.array([1, 1, 1, 1, 1e-2, 1e-3, 1e-4, 1e-5, 0])[:, None]
    lens = np.array(LENS) * (1 + 1e-3 * rng.random(9))
    camera = Camera(1280, 720, lens, factor @ factor.T, corners="0ab")
    write_camera(tmp_path / "camera.yaml", camera)
    read = read_camera(tmp_path / "camera.yaml")
    assert (read.width, read.height) == (1280, 720)
    np.testing.assert_array_equal(read.intrinsics, camera.intrinsics)
    np.testing.assert_allclose(read.covariance, camera.covariance, rtol=1e-14)
    assert list(read.values) == list(PLUMB_BOB.names)
    assert read.corners == "0ab"


def test_corners_are_told_from_others_by_what_their_file_says(tmp_path: Path) -> None:
    pixel = np.array([[1.00001, 2.0], [3.0, 4.0], [5.0, 6.0]])
    corners = corners_of(["a.png", "b.png", "a.png"], [0, 0, 1], pixel)
    write_corners(tmp_path / "corners.csv", corners.take(np.array([2, 0, 1])))
    assert read_corners(tmp_path / "corners.csv").digest == corners.digest
    assert corners.take(np.array([0, 1])).digest != corners.digest
    assert corners_of(corners.image, corners.point, pixel + 1e-3).digest != corners.digest


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("image_width: 1920\n", "", "image_width: found no such key"),
        ("plumb_bob", "equidistant", "5 coefficients are those of plumb_bob"),
        ("plumb_bob", "fov", "expected one of plumb_bob, rational_polynomial, equidistant"),
        ("1371.0, 0,", "1.371, 0,", "the focal length must be in pixels"),
        ("1371.0, 0,", ".inf, 0,", "a finite number"),
        ("1371.0, 0,", "1371.0, 2.5,", "without skew"),
        ("959.5", "2959.5", "a principal point in the picture"),
        ("1920", "640", "a principal point in the picture"),
        (
            "[0.1, 0, 0, 0, 0]",
            "[0.1, 0, 0, 0, 0, 0.2, 0, 0]",
            "8 coefficients are those of rational_polynomial",
        ),
        ("0, 0, 1]}\nd", "0, 0, 1\nd", "text that is not YAML"),
        (NAME, "covariance: {data: [1, 2]}", "a list of 81 numbers"),
        (NAME, f"covariance: {{data: [{', '.join(['1', *['2'] * 80])}]}}", "not a covariance"),
    ],
)
def test_a_camera_that_is_none_is_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = tmp_path / "camera.yaml"
    assert old in ROS
    path.write_text(ROS.replace(old, new))
    with pytest.raises(CameraError, match=r"camera\.yaml") as error:
        read_camera(path)
    assert said in str(error.value)


def test_a_lens_is_taken_out_of_a_picture_again() -> None:
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-0.35, 0.35, (50, 2)), np.ones(50)])
    np.testing.assert_allclose(
        PLUMB_BOB.undistorted(projected(points, LENS), LENS), points[:, :2], atol=1e-9
    )


def test_a_lens_that_folds_back_spreads_nothing_without_bounds() -> None:
    """Far from the middle the iteration reached 1e260, and whoever used it divided by zero."""
    lens = [0.011920619862781767, 0.7232055926401535, 3.61752993942482e-4, -3.81619183e-4, -2.46726]
    folded = np.array([2694.8704, 2703.2094, 1949.115, 1088.5807, *lens])
    across = np.linspace(400.0, 600.0, 2001)
    found = PLUMB_BOB.undistorted(np.column_stack([across, np.full(2001, 263.3)]), folded)
    assert np.abs(found).max() < 100.0


def test_corners_are_written_and_read_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    pixel = np.round(rng.uniform(0, 1000, (6, 2)), 4)
    written = corners_of(["a b.png"] * 3 + ["ü.png"] * 3, [0, 1, 5, 0, 1, 2], pixel)
    write_corners(tmp_path / "corners.csv", written)
    read = read_corners(tmp_path / "corners.csv")
    assert read.images == ["a b.png", "ü.png"]
    np.testing.assert_array_equal(read.point, written.point)
    np.testing.assert_array_equal(read.pixel, written.pixel)
    assert read.lines == (2, 3, 4, 5, 6, 7)
    assert read.take(read.point == 5).lines == (4,)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("a.png,0,1,nan\n", "corners.csv:2: column 'v': found 'nan'"),
        ("a.png,0.5,1,2\n", "corners.csv:2: column 'point'"),
        ("a.png,-1,1,2\n", "whole, from 0"),
        (",0,1,2\n", "an empty cell"),
        ("a.png,0,1,2\nb.png,0,1,2\na.png,0,3,4\n", "corners.csv:4: image a.png, point 0: found"),
        ("a.png,0,1e9,2\n", "column 'u'"),
        ("a.png,0,1\n", "ends in the middle of a row"),
        ("", "a header without data"),
    ],
)
def test_corners_that_cannot_be_used_are_refused(tmp_path: Path, rows: str, said: str) -> None:
    path = tmp_path / "corners.csv"
    path.write_text("image,point,u,v\n" + rows)
    with pytest.raises(SamplesError) as error:
        read_corners(path)
    assert said in str(error.value)


def test_corners_of_another_board_or_picture_are_refused() -> None:
    camera = Camera(640, 480, np.array([600.0, 600, 320, 240, 0, 0, 0, 0, 0]))
    corners = corners_of(["a"] * 2, [0, 11], [[1.0, 2.0], [639.4, 479.4]])
    corners.check(Chessboard(4, 3, 0.05), camera)
    with pytest.raises(SamplesError, match="found point 11; expected a number from 0 to 5"):
        corners.check(Chessboard(3, 2, 0.05), camera)
    outside = corners_of(["a"], [0], [[640.0, 2.0]])
    with pytest.raises(SamplesError, match=r"640\.0, 2\.0 px; expected a corner in the picture"):
        outside.check(Chessboard(4, 3, 0.05), camera)


def test_arrays_that_do_not_fit_are_no_corners() -> None:
    with pytest.raises(InputError, match=r"expected \(n,\), \(n,\), \(n, 2\)"):
        corners_of(["a"], [0, 1], [[1.0, 2.0]])
