"""Pictures that are not what the job says (numbering, board, camera), and good ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from camera_scenes import BOARD, CAMERA, pictures
from simulated import arm_named, camera_scene, dh_parameters, perturbed

from suta_calib.errors import SamplesError
from suta_calib.geometry.lens import EQUIDISTANT, PLUMB_BOB, Lens
from suta_calib.measurements import Board, Camera, Chessboard, Marker, Markers
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import CameraView
from suta_calib.terms.board_pictures import BoardPictures
from suta_calib.terms.misread_pictures import check_files, other_size
from suta_calib.trust.assessment import assess_calibration
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.rereading import explaining_reading

Change = Callable[[np.ndarray], np.ndarray]


def board_pictures(noise: float = 0.1, board: Board = BOARD) -> BoardPictures:
    """What a camera half a metre from a board sees."""
    (view,) = pictures(pixel=noise, board=board).views
    pixels = np.full((16, len(board.points), 2), np.nan)
    for row, image in enumerate(view.corners.images):
        mine = view.corners.take(view.corners.image == image)
        pixels[row, mine.point] = mine.pixel
    return BoardPictures(board, CAMERA, pixels)


def on_the_grid(pixels: np.ndarray) -> np.ndarray:
    return pixels.reshape(len(pixels), BOARD.rows, BOARD.columns, 2)


@pytest.mark.parametrize("noise", [0.0, 0.1, 2.0])
def test_good_pictures_are_what_they_are(noise: float) -> None:
    seen = board_pictures(noise)
    check_files(seen)
    assert seen.numbered_otherwise == ("", "good")
    assert seen.misfit < 0.03


def test_numbers_from_the_other_end_of_a_row_turn_z_outwards() -> None:
    seen = board_pictures()
    mirrored = on_the_grid(seen.pixels)[:, :, ::-1].reshape(seen.pixels.shape)
    assert (
        "z of the board's frame points out" in replace(seen, pixels=mirrored).numbered_otherwise[0]
    )
    turned = seen.pixels[:, ::-1]
    assert not replace(seen, pixels=turned).numbered_otherwise[0]


def test_a_board_with_columns_for_rows_is_refused_by_name() -> None:
    seen = replace(board_pictures(), board=Chessboard(BOARD.rows, BOARD.columns, BOARD.square))
    with pytest.raises(SamplesError, match="if its columns and rows are exchanged"):
        check_files(seen)


TAGS = Markers(
    "DICT_APRILTAG_36h11",
    {k: Marker(np.array([0.07 * (k % 3), 0.07 * (k // 3), 0.0]), 0.05) for k in range(6)},
)


@pytest.mark.parametrize("factor", [1.0, 1.01, 0.97, 1.05])
def test_markers_of_another_size_at_the_right_places_are_refused_by_name(factor: float) -> None:
    """Pictures alone tell it; hands need not be where they say."""
    seen, board = board_pictures(board=TAGS), TAGS.with_markers(1.0 / factor)
    assert board is not None
    seen = replace(seen, board=board)
    if factor == 1.0:
        check_files(seen)
    else:
        with pytest.raises(SamplesError, match=f"corners of markers that are {factor:.2f}"):
            check_files(seen)


@pytest.mark.parametrize(("factor", "said"), [(2.0, "2560 x 1920"), (1.5, "1920 x 1440")])
def test_a_camera_of_larger_pictures_is_refused_by_name(factor: float, said: str) -> None:
    """All corners are in its pictures too: nothing else would tell."""
    seen = replace(board_pictures(), camera=CAMERA.resized(factor))
    with pytest.raises(SamplesError, match=f"of about 1280 x 960 px; expected of {said}"):
        check_files(seen)


@pytest.mark.parametrize("factor", [1.5, 2.0])
def test_a_size_of_other_pictures_beside_the_right_matrix_is_named(factor: float) -> None:
    seen = board_pictures()
    larger = Camera(round(factor * 1280), round(factor * 960), CAMERA.intrinsics)
    said = replace(seen, camera=larger)
    check_files(said)
    assert f"states {larger.width} x {larger.height} px" in other_size(said)
    assert "the middle of about 1285 x 953 px" in other_size(said)
    assert not other_size(seen)
    # Cut out of larger pictures: corners are everywhere in what is left of them.
    shift = np.array([500.0, 300.0])
    cut = Camera(780, 660, CAMERA.intrinsics - [0, 0, *shift, 0, 0, 0, 0, 0])
    pixels = seen.pixels - shift
    pixels[~cut.inside(pixels)] = np.nan
    assert not other_size(replace(seen, camera=cut, pixels=pixels))


def test_numbers_of_another_board_are_refused() -> None:
    seen = board_pictures()
    shuffled = np.random.default_rng(0).permutation(len(BOARD.points))
    with pytest.raises(SamplesError, match="in any pose by more than"):
        check_files(replace(seen, pixels=seen.pixels[:, shuffled]))


def test_a_camera_that_somebody_calibrated_badly_is_no_other_one() -> None:
    wrong = CAMERA.intrinsics * [1.02, 1.02, 1.01, 0.99, 0, 0, 0, 0, 0]
    check_files(replace(board_pictures(), camera=Camera(1280, 960, wrong)))


def other_camera(lens: Lens, focal: float, *bent: float) -> Camera:
    distortion = [*bent, *[0.0] * (len(lens.distortion) - len(bent))]
    return Camera(1280, 960, np.array([focal, focal, 640, 480, *distortion]), lens=lens)


@pytest.mark.parametrize(
    "given",
    [
        other_camera(EQUIDISTANT, 500.0),
        other_camera(PLUMB_BOB, 1500.0, -0.1, 0.05),
        other_camera(PLUMB_BOB, CAMERA.intrinsics[0], 1.5),
    ],
    ids=["fisheye", "focus", "bent"],
)
def test_another_cameras_file_is_refused_with_what_the_pictures_show(given: Camera) -> None:
    # The camera's focal length, to a hundredth.
    shown = r"as a camera with the lens plumb_bob, fx (99|100)\d, "
    with pytest.raises(SamplesError, match=shown) as refused:
        check_files(replace(board_pictures(), camera=given))
    assert f"the lens {given.lens.called}, fx {given.intrinsics[0]:.0f}, " in refused.value.expected
    # How a lens is bent is said where the cameras differ in nothing else.
    assert ("k1 1.5" in refused.value.expected) == (given.intrinsics[4] == 1.5)


def test_a_resized_camera_sees_the_same() -> None:
    small = CAMERA.resized(0.5)
    assert (small.width, small.height) == (640, 480)
    # The middle of the first four pixels is the middle of the first one of the small picture.
    assert small.resized(2.0).intrinsics == pytest.approx(CAMERA.intrinsics)
    assert small.intrinsics[2] == pytest.approx((CAMERA.intrinsics[2] - 0.5) / 2)


# ── over an arm ──────────────────────────────────────────────────────────────────────────────
def upside_down(pixels: np.ndarray) -> np.ndarray:
    return [_CAMERA.width - 1.0, _CAMERA.height - 1.0] - pixels


ARM = arm_named("suta")
SCENE = camera_scene(ARM, perturbed(dh_parameters(ARM), seed=1), n=16)
TERM: Any = SCENE.exact()
_CAMERA = TERM.camera


def mirrored(pixels: np.ndarray) -> np.ndarray:
    return [_CAMERA.width - 1.0, 0.0] + pixels * [-1.0, 1.0]


def mirrored_and_numbered(pixels: np.ndarray) -> np.ndarray:
    """As a search for the board numbers it in a mirrored picture: its rows from the last one on."""
    board = TERM.board
    by_row = mirrored(pixels).reshape(-1, board.rows, board.columns, 2)
    return by_row[:, ::-1].reshape(pixels.shape)


def changed(change: Change, rows: slice = slice(None)) -> CameraView:
    pixels = TERM.pixels.copy()
    pixels[rows] = change(pixels[rows])
    return TERM.over_poses(
        TERM.poses.with_samples(replace(TERM.poses.samples, pixels=pixels)),
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda pixels: pixels[:, ::-1], "the board is turned by half a turn"),
        (upside_down, "the picture is turned by half a turn"),
        (mirrored, "the picture is mirrored"),
        (mirrored_and_numbered, "the picture is mirrored"),
    ],
    ids=["board", "picture", "mirror", "mirror, numbered"],
)
def test_some_pictures_upside_down_are_named(change: Change, said: str) -> None:
    ((sentence, level),) = changed(change, slice(2, 5)).doubts.items()
    assert said in sentence
    assert level == "bad"


def test_a_third_of_all_boards_turned_is_named_picture_by_picture() -> None:
    """The mean of all pictures is of no use then; those that agree with each other are."""
    turned = changed(lambda pixels: pixels[:, ::-1], slice(None, None, 3))
    found = turned.pictures.upside_down(turned.poses.at({}))["board"]
    assert np.array_equal(np.flatnonzero(found), np.arange(0, 16, 3))


def test_what_nothing_converges_with_is_named_too() -> None:
    term = changed(lambda pixels: pixels[:, ::-1], slice(None, None, 3))
    solution = solve(Problem([term], dh_parameters(ARM)))
    lost = replace(solution, minimum=replace(solution.minimum, converged=False))
    answer = assess_calibration(CalibrationExamination.of(lost))
    assert answer.level == "bad"
    assert any("turned by half a turn" in note for note in answer.notes)


def test_a_size_of_other_pictures_is_a_doubt() -> None:
    large = replace(_CAMERA, width=2560, height=1920)
    ((sentence, level),) = replace(TERM, camera=large).doubts.items()
    assert "2560 x 1920 px" in sentence
    assert level == "care"


def test_all_pictures_the_other_way_round_are_as_good() -> None:
    """Nobody knows which end of a board is its beginning, or which way up a camera hangs."""
    assert not TERM.doubts
    assert not changed(lambda pixels: pixels[:, ::-1]).doubts


def test_what_the_pictures_have_wrong_is_in_the_assessment() -> None:
    columns = TERM.board.columns

    def mirrored(pixels: np.ndarray) -> np.ndarray:
        return pixels.reshape(len(pixels), -1, columns, 2)[:, :, ::-1].reshape(pixels.shape)

    solution = solve(Problem([changed(mirrored)], dh_parameters(ARM)))
    found = assess_calibration(CalibrationExamination.of(solution))
    assert any("points out of its face" in note for note in found.notes)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"free": True}, "another intrinsics"),
        ({"setup": "eye-to-hand"}, "another setup"),
        ({"camera": _CAMERA.resized(2.0)}, "another camera"),
        ({"board": TERM.board.scaled(2.0)}, "another board"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, dict) else "",
)
def test_two_rows_of_one_camera_say_the_same_of_it(change: dict[str, Any], said: str) -> None:
    other = replace(TERM, **change)
    with pytest.raises(SamplesError, match=said):
        other.check_beside(TERM)
    replace(other, label="second", target="second").check_beside(TERM)
    TERM.take(range(8)).check_beside(TERM)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda pixels: pixels * [1.0, -1.0] + [0.0, _CAMERA.height - 1.0], "v counts upwards"),
        (lambda pixels: pixels[..., ::-1], "u and v are exchanged"),
    ],
    ids=["v", "uv"],
)
def test_pixels_that_are_counted_otherwise_are_named(change: Change, said: str) -> None:
    solution = solve(Problem([changed(change)], dh_parameters(ARM)), SolverOptions(starts=1))
    cause = explaining_reading(solution)
    assert cause is not None
    assert said in cause.description
    assert cause.after < 1e-4 < cause.before


def test_pixels_counted_well_have_no_such_cause() -> None:
    noisy = changed(lambda p: p + 0.3 * np.random.default_rng(0).standard_normal(p.shape))
    solution = solve(Problem([noisy], dh_parameters(ARM)), SolverOptions(starts=1))
    assert explaining_reading(solution) is None


def test_corners_that_would_be_in_the_picture_the_other_way_round_say_so() -> None:
    corners = pictures().views[0].corners
    corners.pixel[0] = 1100.0, 300.0
    corners.check(BOARD, CAMERA)
    exchanged = replace(corners, pixel=corners.pixel[:, ::-1])
    with pytest.raises(SamplesError, match="if u and v were exchanged"):
        exchanged.check(BOARD, CAMERA)
