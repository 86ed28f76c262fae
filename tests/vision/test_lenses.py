"""Which lens took pictures of a board, and where rendered corners are by each."""

from __future__ import annotations

import numpy as np
import pytest
from studies import of_size

cv2 = pytest.importorskip("cv2")

from lens_scenes import BOARD, SIZE, TRUE, before, camera, corners_seen, each_camera  # noqa: E402

from suta_calib.arrays import FloatArray  # noqa: E402
from suta_calib.geometry.lens import EQUIDISTANT, LENSES  # noqa: E402
from suta_calib.geometry.lens_slopes import pixel_slopes  # noqa: E402
from suta_calib.geometry.numbers import (  # noqa: E402
    skew,
)
from suta_calib.measurements import Charuco  # noqa: E402
from suta_calib.measurements.board import Board  # noqa: E402
from suta_calib.vision import RenderOptions, rendered  # noqa: E402
from suta_calib.vision.camera_fit import (  # noqa: E402
    CameraFitOptions,
    calibrate_camera,
    view_poses,
)
from suta_calib.vision.detection import finder_of  # noqa: E402
from suta_calib.vision.projection_uncertainty import projection_std  # noqa: E402


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


@pytest.mark.parametrize("seeds", of_size(1, 2))
@each_camera
def test_the_lens_is_found_that_took_the_pictures(name: str, seeds: int) -> None:
    right, ratios = chosen(name, range(seeds))
    assert right == seeds
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


CHARUCO = Charuco(10, 7, 0.03, 0.022, "DICT_5X5_100")


@pytest.mark.parametrize(
    ("name", "board"),
    [*((name, BOARD) for name in TRUE), ("plumb_bob", CHARUCO), ("fisheye of 190 deg", CHARUCO)],
)
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


@pytest.mark.parametrize("seeds", of_size(6, 10))
@pytest.mark.parametrize("name", ["plumb_bob", "fisheye of 190 deg"])
def test_the_projection_is_as_sure_as_the_map_says(name: str, seeds: int) -> None:
    """Errors of the projection after the best turn, in the middle and towards a corner."""
    true, asked = camera(name), np.array([[640.0, 480.0], [400.0, 480.0], [300.0, 250.0]])
    off, std = [], []
    for seed in range(seeds):
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
