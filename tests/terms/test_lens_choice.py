"""Which lens a camera without a file has, by its pictures alone; said in hand-eye and in jobs."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camera_scenes import BOARD, LENS, Pictures, X, Z, after, pictures, solved, write_hand
from cli_job import Capture, cli

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.lens import EQUIDISTANT, LENSES, PLUMB_BOB, RATIONAL, Lens
from suta_calib.geometry.numbers import rotation_from_vector, vector_turning_z_to
from suta_calib.measurements import (
    Camera,
    Chessboard,
    Corners,
    corners_of,
    write_board,
    write_corners,
)
from suta_calib.pose_calibration.pictures import View
from suta_calib.terms.hand_eye_start import inverse_poses
from suta_calib.terms.lens_choice import camera_alone

# A usual lens, the colour camera of a depth camera, and a fisheye.
TRUE: dict[str, list[float]] = {
    "plumb_bob": [900, 905, 640, 480, -0.25, 0.08, 1e-3, -2e-3, 0.01],
    "rational_polynomial": [610, 610, 640, 480, 0.45, -2.5, 5e-4, -3e-4, 1.45, 0.33, -2.33, 1.38],
    "equidistant": [390, 392, 640, 480, -0.02, 0.003, -0.001, 0.0001],
}
SMALL = Chessboard(7, 5, 0.04)


def seen_by(lens: Lens, count: int = 12, seed: int = 0) -> Pictures:
    """Boards all over the picture of a camera on a hand, whose file nobody has."""
    random = np.random.default_rng(seed)
    camera = Camera(1280, 960, np.array(TRUE[lens.name], dtype=float), lens=lens)
    pixel = random.uniform([200, 200], [1080, 760], (count, 2))
    ahead: FloatArray = camera.directions(pixel)
    turn = rotation_from_vector(vector_turning_z_to(ahead))
    turn = turn @ rotation_from_vector(0.5 * random.uniform(-1, 1, (count, 3)))
    points = np.array([*SMALL.points.values()])
    place = ahead * random.uniform(0.3, 0.6, (count, 1)) - turn @ points.mean(axis=0)
    pixels = camera.project(np.einsum("nij,kj->nki", turn, points) + place[:, None])
    pixels = pixels + 0.1 * random.standard_normal(pixels.shape)
    image, point = np.nonzero(camera.inside(pixels))
    names = np.array([f"{k:03d}.png" for k in range(count)])
    corners = corners_of(names[image], point, pixels[image, point])
    scene = pictures(count, given=None)
    hand = after(Z, inverse_poses(after(X, (turn, place))))
    return Pictures(replace(scene.hand, pose=hand), (View("default", corners, SMALL),))


@pytest.mark.parametrize("lens", LENSES.values(), ids=list(LENSES))
def test_the_lens_is_chosen_that_took_the_pictures(lens: Lens) -> None:
    (view,) = seen_by(lens).views
    camera, choice = camera_alone(view.corners, view.board)
    assert camera.lens is lens
    assert camera.intrinsics[:4] == pytest.approx(TRUE[lens.name][:4], rel=0.01)
    assert choice is not None
    assert set(choice.left_out) == set(LENSES)
    assert choice.left_out[lens.name] < 0.2
    assert f"the lens is taken for {lens.name}" in choice.sentence
    assert "px (" in choice.sentence


def test_a_lens_that_is_said_is_taken() -> None:
    (view,) = seen_by(PLUMB_BOB).views
    for lens in (RATIONAL, PLUMB_BOB):
        camera, choice = camera_alone(view.corners, view.board, lens)
        assert (camera.lens, choice) == (lens, None)


def test_few_pictures_choose_no_lens() -> None:
    (view,) = pictures(5, given=None, pixel=0.1, seed=3).views
    camera, choice = camera_alone(view.corners, BOARD)
    assert camera.lens is PLUMB_BOB
    assert camera.intrinsics[:2] == pytest.approx(LENS[:2], rel=0.1)
    assert choice is not None
    assert "with fewer than 6 pictures no model can be chosen" in choice.sentence


def test_another_board_is_still_named() -> None:
    (view,) = seen_by(PLUMB_BOB).views
    with pytest.raises(SamplesError, match="columns and rows are exchanged"):
        camera_alone(view.corners, Chessboard(5, 7, 0.04))


def test_x_of_a_fisheye_needs_no_file() -> None:
    seen = solved(seen_by(EQUIDISTANT)).cameras[0]
    assert seen.camera.lens is EQUIDISTANT
    assert np.linalg.norm(seen.X[:3, 3] - X[1]) < 5.0 * np.linalg.norm(seen.std["X"][:3])


def test_hand_eye_says_which_lens_it_took(tmp_path: Path, capsys: Capture) -> None:
    scene = seen_by(EQUIDISTANT)
    (view,) = scene.views
    write_hand(tmp_path / "poses.csv", scene.hand)
    write_corners(tmp_path / "corners.csv", view.corners)
    write_board(tmp_path / "board.yaml", view.board)
    files = [tmp_path / "poses.csv", "--corners", tmp_path / "corners.csv"]
    files += ["--board", tmp_path / "board.yaml"]
    assert cli("hand-eye", *files, "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert said["camera"]["distortion_model"] == "equidistant"
    assert set(said["camera"]["lens_left_out_rms_px"]) == set(LENSES)
    assert cli("hand-eye", *files, "--out", tmp_path / "out") == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "equidistant (fisheye)" in shown
    # How large the pictures are is in no file.
    assert said["camera"]["width"] is None
    assert "the least that holds all corners" in shown
    assert (tmp_path / "out/camera.yaml").read_text().startswith("# image_width and image_height")
    assert cli("hand-eye", *files, "--lens", "equidistant", "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert said["camera"]["distortion_model"] == "equidistant"
    assert said["camera"]["lens_left_out_rms_px"] is None
    assert cli("hand-eye", *files, "--lens", "plumb_bob") == 2
    refused = capsys.readouterr().err
    assert "use equidistant (--lens" in refused
    assert "camera's file" not in refused


def mirrored(corners: Corners) -> Corners:
    return replace(corners, pixel=corners.pixel * [-1.0, 1.0] + [1279.0, 0.0])


FISHEYE = Camera(1280, 960, np.array(TRUE["equidistant"], dtype=float), lens=EQUIDISTANT)


@pytest.mark.parametrize(
    ("given", "change", "said"),
    [
        (
            Camera(1280, 960, np.append(FISHEYE.intrinsics, 0.0)),
            lambda corners: corners,
            r"a lens of the model equidistant \(fisheye\)",
        ),
        (FISHEYE.resized(2.0), lambda corners: corners, "pictures of about 1280 x 960 px"),
        (FISHEYE.resized(0.5), lambda corners: corners, "a corner in the picture, which is 640 x"),
        (FISHEYE, mirrored, "the pictures are mirrored"),
    ],
    ids=["plumb_bob", "smaller", "larger", "mirrored"],
)
def test_a_fisheye_file_that_is_wrong_is_named(
    given: Camera, change: Callable[[Corners], Corners], said: str
) -> None:
    scene = seen_by(EQUIDISTANT)
    (view,) = scene.views
    wrong = replace(view, camera=given, corners=change(view.corners))
    with pytest.raises(SamplesError, match=said):
        solved(Pictures(scene.hand, (wrong,)))
