"""The picture of two edges that cross, blurred: its values and slopes, and what follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

cv2 = pytest.importorskip("cv2")

from vision_scenes import (  # noqa: E402
    CHARUCO,
    CHESSBOARD,
    MARKERS,
    OPTIONS,
    facing,
    taken,
    truth,
)

from suta_calib.measurements import Board  # noqa: E402
from suta_calib.vision.corner_model import (  # noqa: E402
    crossed,
    evaluated,
    fit_corners,
    fitted,
)
from suta_calib.vision.detection import finder_of  # noqa: E402


@pytest.mark.parametrize("rho", [-0.95, -0.3, 0.0, 0.6, 0.9])
def test_two_blurred_edges_are_a_bivariate_normal(rho: float):
    t1, t2 = 1.5 * np.random.default_rng(1).standard_normal((2, 1, 30))
    product, density, *_ = crossed(t1, t2, np.array([[rho]]))
    known = multivariate_normal(cov=[[1.0, rho], [rho, 1.0]])
    at = np.stack([t1[0], t2[0]], axis=1)
    signs = 4.0 * known.cdf(at) - 2.0 * (norm.cdf(t1[0]) + norm.cdf(t2[0])) + 1.0
    assert np.allclose(product[0], signs, atol=2e-5)
    assert np.allclose(density[0], known.pdf(at))


@pytest.mark.parametrize("single", [0.0, 1.0])
def test_slopes_of_the_model_are_its_differences(single: float):
    random, n = np.random.default_rng(2), 5
    span = np.arange(-4.0, 5.0)
    offset = np.stack(np.meshgrid(span, span), axis=-1).reshape(-1, 2)
    low = [-0.5, -0.5, 0.0, 0.9, 0.5, 60.0, 20.0]
    high = [0.5, 0.5, 0.3, 2.4, 1.5, 90.0, 50.0]
    values = random.uniform(low, high, (n, 7))
    patch, weight = random.uniform(0, 200, (n, len(offset))), np.ones((n, len(offset)))
    _, J, _ = evaluated(values, offset, patch, weight, single)
    for k, step in enumerate(1e-5 * np.eye(7)):
        ahead, behind = (
            evaluated(values + by, offset, patch, weight, single)[2] for by in (step, -step)
        )
        assert np.allclose((ahead - behind) / 2e-5, J[..., k], atol=1e-3)


@pytest.mark.parametrize("tilt_deg", [(40, 40, 100), (30, 20, 40)])
def test_markers_seen_aslant_are_where_they_are(tilt_deg: tuple[float, float, float]):
    """Their corners are not square there: blur rounds a sharp one more than a blunt one."""
    T = facing(MARKERS, tilt_deg)
    clean = taken(MARKERS, T, replace(OPTIONS, samples=12, noise=0.0)).astype(float)
    found = [
        finder_of(MARKERS).find(
            np.round(clean + random.standard_normal(clean.shape)).astype(np.uint8)
        )
        for random in map(np.random.default_rng, range(4))
    ]
    error = np.array([each.pixel for each in found]) - truth(MARKERS, found[0].point, T)
    stated = np.array([each.std for each in found])[..., None]
    assert error.shape == (4, 8, 2)
    assert 0.7 < np.sqrt(np.mean((error / stated) ** 2)) < 1.4


def moved(picture: np.ndarray, length: float, angle_deg: float) -> np.ndarray:
    """A picture that was taken while everything in it moved by ``length`` px."""
    kernel = np.zeros((15, 15))
    way = np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    for part in np.linspace(-0.5, 0.5, 121):
        place = 7.0 + part * length * way
        (i, j), (x, y) = np.floor(place).astype(int), place % 1.0
        kernel[j : j + 2, i : i + 2] += np.outer([1.0 - y, y], [1.0 - x, x])
    return cv2.filter2D(picture, -1, kernel / kernel.sum())


@pytest.mark.parametrize("board", [CHESSBOARD, MARKERS], ids=["chessboard", "markers"])
@pytest.mark.parametrize("angle_deg", [20.0, 100.0])
def test_pictures_of_a_moving_hand_have_corners_as_good_as_they_say(board: Board, angle_deg: float):
    clean = taken(board, options=replace(OPTIONS, samples=8, noise=0.0)).astype(float)
    clean = moved(clean, 4.0, angle_deg)
    ratios = []
    for random in map(np.random.default_rng, range(3)):
        picture = np.round(clean + random.standard_normal(clean.shape)).astype(np.uint8)
        found = finder_of(board).find(picture)
        ratios.append((found.pixel - truth(board, found.point)) / found.std[:, None])
    assert 0.6 < np.sqrt(np.mean(np.square(np.concatenate(ratios)))) < 1.5


def test_a_blur_that_is_longer_one_way_is_told_and_a_round_one_left_round():
    clean = taken(CHESSBOARD, options=replace(OPTIONS, blur=0.0, samples=8, noise=0.0))
    there = truth(CHESSBOARD, np.arange(len(CHESSBOARD.points)))
    for across, along in ((1.2, 1.2), (0.8, 1.8)):
        blurred = cv2.GaussianBlur(clean.astype(float), (0, 0), along, sigmaY=across)
        noise = np.random.default_rng(0).standard_normal(clean.shape)
        fit = fitted(blurred + noise, there, 6)
        longer = np.log(fit.shape[0, 0] / fit.shape[1, 1])
        # A pixel blurs by a twelfth of its square besides.
        expected = 0.5 * np.log((along**2 + 1 / 12) / (across**2 + 1 / 12))
        assert longer == pytest.approx(expected, abs=0.04)
        assert np.linalg.det(fit.shape) == pytest.approx(1.0)
        if across == along:
            assert np.array_equal(fit.shape, np.eye(2))


def test_corners_among_markers_seen_aslant_are_no_markers_corners():
    T = facing(CHARUCO, (60, 40, 20), 0.42)
    found = finder_of(CHARUCO).find(taken(CHARUCO, T))
    assert len(found.point) >= 8
    assert np.abs(found.pixel - truth(CHARUCO, found.point, T)).max() < 0.3


@pytest.mark.parametrize("blur", [0.4, 1.5, 2.5])
def test_blur_parts_squares_no_less(blur: float):
    """How far dark and light are parted is held against what the model has as blurred."""
    picture = taken(CHARUCO, options=replace(OPTIONS, blur=blur))
    there = truth(CHARUCO, np.arange(len(CHARUCO.points)))
    assert fit_corners(picture, there, 4).parted == pytest.approx(1.0, abs=0.1)
