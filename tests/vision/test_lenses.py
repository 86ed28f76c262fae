"""Which lens took pictures of a board, and where rendered corners are by each."""

from __future__ import annotations

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2")

from suta_calib.arrays import FloatArray  # noqa: E402
from suta_calib.geometry.lens import EQUIDISTANT, LENSES, PLUMB_BOB, RATIONAL, Lens  # noqa: E402
from suta_calib.geometry.lens_slopes import pixel_slopes  # noqa: E402
from suta_calib.geometry.numbers import (  # noqa: E402
    rotation_from_vector,
    skew,
    vector_turning_z_to,
)
from suta_calib.measurements import Camera, Charuco, Chessboard  # noqa: E402
from suta_calib.measurements.board import Board  # noqa: E402
from suta_calib.measurements.corners import Corners, corners_of  # noqa: E402
from suta_calib.vision import RenderOptions, rendered  # noqa: E402
from suta_calib.vision.camera_fit import (  # noqa: E402
    CameraFitOptions,
    calibrate_camera,
    view_poses,
)
from suta_calib.vision.detection import finder_of  # noqa: E402
from suta_calib.vision.projection_uncertainty import projection_std  # noqa: E402

BOARD = Chessboard(9, 6, 0.03)
SIZE = (1280, 960)
# A usual lens; the colour camera of a depth camera, which has all eight numbers; a lens that is
# 100° wide, and one of 190°.
TRUE: dict[str, tuple[Lens, list[float]]] = {
    "plumb_bob": (PLUMB_BOB, [900, 905, 640, 480, -0.25, 0.08, 1e-3, -2e-3, 0.01]),
    "rational_polynomial": (
        RATIONAL,
        [610, 610, 640, 480, 0.45, -2.5, 5e-4, -3e-4, 1.45, 0.33, -2.33, 1.38],
    ),
    "equidistant": (EQUIDISTANT, [700, 702, 640, 480, 0.02, -0.01, 0.003, -0.0005]),
    "fisheye of 190 deg": (EQUIDISTANT, [390, 392, 640, 480, -0.02, 0.003, -0.001, 0.0001]),
}
each_camera = pytest.mark.parametrize("name", TRUE)


def camera(name: str) -> Camera:
    lens, values = TRUE[name]
    return Camera(*SIZE, np.array(values, dtype=float), lens=lens)


def before(
    taken_by: Camera, board: Board, rng: np.random.Generator, room: int, tilt: float
) -> FloatArray:
    """``T_camera_board`` (4, 4) of a board that faces the camera anywhere in its picture."""
    pixel = rng.uniform([room, room], np.array(SIZE) - room)
    ahead = taken_by.directions(pixel)
    pose = np.eye(4)
    turn = rotation_from_vector(tilt * rng.uniform(-1, 1, 3))
    pose[:3, :3] = rotation_from_vector(vector_turning_z_to(ahead)) @ turn
    middle = np.mean(list(board.points.values()), axis=0)
    pose[:3, 3] = rng.uniform(0.25, 0.5) * ahead - pose[:3, :3] @ middle
    return pose


def corners_seen(taken_by: Camera, seed: int, pictures: int = 20, sigma: float = 0.1) -> Corners:
    """Corners with normal errors, px, of boards that are mostly in the picture."""
    rng, points = np.random.default_rng(seed), np.array(list(BOARD.points.values()))
    numbers, images, number, pixels = np.array([*BOARD.points]), list[str](), [], []
    while len(pixels) < pictures:
        pose = before(taken_by, BOARD, rng, 150, 0.7)
        there = points @ pose[:3, :3].T + pose[:3, 3]
        if not taken_by.lens.ahead(there).all():
            continue
        pixel = taken_by.project(there)
        unit = there / np.linalg.norm(there, axis=1, keepdims=True)
        # Not what a polynomial folds back into the picture.
        seen = taken_by.inside(pixel)
        seen &= np.abs(taken_by.directions(pixel) - unit).max(axis=1) < 1e-3
        if seen.sum() < 30:
            continue
        images += [f"{len(pixels):02d}.png"] * int(seen.sum())
        number.append(numbers[seen])
        pixels.append(pixel[seen] + sigma * rng.standard_normal((int(seen.sum()), 2)))
    return corners_of(np.array(images), np.concatenate(number), np.concatenate(pixels))


def chosen(name: str, seeds: range) -> tuple[int, FloatArray]:
    """How often the right lens is chosen, and errors over their standard deviations then."""
    true, right, ratios = camera(name), 0, []
    for seed in seeds:
        found = calibrate_camera(corners_seen(true, seed), BOARD, *SIZE).camera
        if found.lens is true.lens:
            right += 1
            assert found.stds is not None
            ratios.append((found.intrinsics - true.intrinsics) / found.stds)
    return right, np.array(ratios)


@each_camera
def test_the_lens_is_found_that_took_the_pictures(name: str) -> None:
    right, ratios = chosen(name, range(2))
    assert right == 2
    assert np.abs(ratios[:, :4]).max() < 4.0


@pytest.mark.slow
@each_camera
def test_so_it_is_in_38_of_40_and_every_std_is_true(name: str) -> None:
    right, ratios = chosen(name, range(40))
    assert right >= 38
    # A standard deviation of forty scatters by 11 %: three of these.
    spread = np.sqrt(np.mean(ratios**2, axis=0))
    assert (spread > 0.66).all()
    assert (spread < 1.34).all()


@each_camera
def test_boards_are_where_they_are(name: str) -> None:
    """Also beside the camera, by a lens that sees there."""
    true = camera(name)
    corners = corners_seen(true, 5, pictures=6, sigma=0.0)
    poses, residuals = view_poses(corners, BOARD, true)
    assert len(poses) == 6
    assert np.abs(residuals).max() < 1e-3


def test_a_lens_may_be_asked_for() -> None:
    corners = corners_seen(camera("plumb_bob"), 0)
    for lens in LENSES.values():
        found = calibrate_camera(corners, BOARD, *SIZE, CameraFitOptions(lens=lens))
        assert found.camera.lens is lens


@pytest.mark.parametrize(
    "board", [BOARD, Charuco(10, 7, 0.03, 0.022, "DICT_5X5_100")], ids=["chessboard", "charuco"]
)
@each_camera
def test_rendered_corners_are_found_to_a_tenth(name: str, board: Board) -> None:
    true = camera(name)
    rng = np.random.default_rng(11)
    pose = before(true, board, rng, 330, 0.4)
    # As near as the whole board is in the picture.
    middle = np.mean(list(board.points.values()), axis=0)
    there = pose[:3, :3] @ middle + pose[:3, 3]
    far = 0.5 if true.intrinsics[0] > 600 else 0.28
    pose[:3, 3] = far * there / np.linalg.norm(there) - pose[:3, :3] @ middle
    picture = rendered(board, true, pose, rng, RenderOptions(noise=2.0))
    found = finder_of(board).find(picture)
    expected = true.project(board.positions(found.point) @ pose[:3, :3].T + pose[:3, 3])
    off = np.linalg.norm(found.pixel - expected, axis=1)
    assert len(off) > 0.6 * len(board.points)
    assert np.sqrt(np.mean(off**2)) < 0.1


@pytest.mark.parametrize("name", ["plumb_bob", "fisheye of 190 deg"])
def test_the_projection_is_as_sure_as_the_map_says(name: str) -> None:
    """Errors of the projection after the best turn, in the middle and towards a corner."""
    true, asked = camera(name), np.array([[640.0, 480.0], [400.0, 480.0], [300.0, 250.0]])
    off, std = [], []
    for seed in range(10):
        corners = corners_seen(true, seed)
        fit = calibrate_camera(corners, BOARD, *SIZE, CameraFitOptions(lens=true.lens))
        std.append(projection_std(fit.camera, corners.pixel, asked))
        left = []
        for pixels in (corners.pixel, asked):
            rays = true.directions(pixels)
            by_point, _ = pixel_slopes(true.lens, rays, fit.camera.intrinsics)
            left.append((fit.camera.project(rays) - pixels, by_point @ skew(rays)))
        (apart, by_turn), (apart_there, by_turn_there) = left
        turn = np.linalg.lstsq(by_turn.reshape(-1, 3), apart.ravel(), rcond=None)[0]
        off.append(apart_there - by_turn_there @ turn)
    found = np.sqrt(np.mean(np.sum(np.square(off), axis=2), axis=0))
    # Ten trials of two coordinates: 16 %, three of them.
    np.testing.assert_allclose(found / np.mean(std, axis=0), 1.0, atol=0.5)


def test_the_map_ends_where_a_fisheye_sees_nothing() -> None:
    true = camera("fisheye of 190 deg")
    fit = calibrate_camera(corners_seen(true, 0), BOARD, *SIZE, CameraFitOptions(lens=EQUIDISTANT))
    sure = fit.projection
    assert np.isnan(sure.std[0, 0])
    assert sure.middle < 0.1 < sure.worst
