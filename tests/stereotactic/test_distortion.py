"""Distortion is corrected where it is, and left alone where there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from studies import first_of

from suta_calib.errors import SamplesError
from suta_calib.stereotactic.cis_simulation import simulate_stereotactic
from suta_calib.stereotactic.distortion import (
    RCOND,
    DistortionCorrection,
    _basis,
    _orthonormal,
    fit_distortion,
    is_distorted,
)

SIZE = 0.5


def cloud(frames: int = 60, n: int = 20, seed: int = 0) -> np.ndarray:
    """Clusters of points, all over a cube, as a moved calibration object gives them."""
    random = np.random.default_rng(seed)
    places = random.uniform(0.1, SIZE - 0.1, (frames, 1, 3))
    return places + random.uniform(-0.1, 0.1, (frames, n, 3))


def polynomial(points: np.ndarray) -> np.ndarray:
    """A displacement of degree 2 in every axis, a few mm."""
    x, y, z = np.moveaxis(points / SIZE - 0.5, -1, 0)
    return 0.01 * np.stack([x * y + z**2, x**2 * y**2 - z, y * z**2 + x], axis=-1)


def rms(vectors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))


def fitted(noise: float, seed: int = 1) -> tuple[DistortionCorrection, np.ndarray]:
    """A correction fitted to noisy readings; and fresh points of the volume."""
    measured = cloud()
    off = noise * np.random.default_rng(seed).standard_normal(measured.shape)
    expected = measured + polynomial(measured) + off
    return fit_distortion(measured, expected), cloud(seed=2)[:20]


def test_a_polynomial_is_found_exactly() -> None:
    correction, fresh = fitted(noise=0.0)
    fresh = fresh[correction.inside(fresh)]
    assert correction.degree == 2
    np.testing.assert_allclose(correction.correct(fresh), fresh + polynomial(fresh), atol=1e-12)
    assert correction.rms < 1e-12


def test_noise_does_not_raise_the_degree() -> None:
    correction, fresh = fitted(noise=0.2e-3)
    fresh = fresh[correction.inside(fresh)]
    assert correction.degree == 2
    assert rms(correction.correct(fresh) - fresh - polynomial(fresh)) < 0.1e-3
    assert correction.rms == pytest.approx(0.2e-3 * np.sqrt(3), rel=0.05)


@pytest.mark.parametrize("seed", first_of(range(5)))
def test_noise_alone_is_left_alone(seed: int) -> None:
    expected = cloud()
    measured = expected + 0.5e-3 * np.random.default_rng(seed).standard_normal(expected.shape)
    correction = fit_distortion(measured, expected)
    fresh = cloud(seed=9)
    assert rms(correction.displacement(fresh)) < 0.1e-3
    assert not is_distorted(measured, expected)


def test_distortion_is_noticed() -> None:
    measured = cloud()
    assert is_distorted(measured, measured + polynomial(measured))


def test_cross_validation_is_that_of_fits_without_the_frame() -> None:
    """The formula against fitting again without each frame."""
    measured = cloud(frames=12)
    random = np.random.default_rng(3)
    expected = measured + polynomial(measured) + 1e-3 * random.standard_normal(measured.shape)
    degree, errors = 1, []
    correction = fit_distortion(measured, expected, [degree])
    for frame in range(len(measured)):
        others = np.delete(measured, frame, axis=0), np.delete(expected, frame, axis=0)
        # A trilinear function of position is the same whatever box it is scaled to.
        known = fit_distortion(*others, []).inside(measured[frame])
        basis, left = trilinear(others[0].reshape(-1, 3)), trilinear(measured[frame])
        moved = (others[1] - others[0]).reshape(-1, 3)
        predicted = measured[frame] + left @ np.linalg.lstsq(basis, moved, rcond=None)[0]
        errors.append((predicted - expected[frame])[known])
    assert correction.cross_validation[degree] == pytest.approx(rms(np.concatenate(errors)))


def trilinear(points: np.ndarray) -> np.ndarray:
    x, y, z = points.T
    return np.stack([np.ones_like(x), x, y, z, x * y, y * z, x * z, x * y * z], axis=1)


def test_outside_is_told_and_tame() -> None:
    correction, _ = fitted(noise=0.0)
    centre = (correction.lower + correction.upper) / 2
    outside = centre + np.array([[1.0, 0, 0], [0, -3.0, 0], [5.0, 5.0, 5.0]])
    assert correction.inside(centre[None]).all()
    assert not correction.inside(outside).any()
    # A corner of the box that the points leave out is outside too.
    assert not correction.inside(correction.lower)
    size = correction.upper - correction.lower
    reached = np.clip(outside, correction.lower - 0.2 * size, correction.upper + 0.2 * size)
    np.testing.assert_allclose(
        correction.displacement(outside), correction.displacement(reached), atol=1e-15
    )


def test_a_polynomial_goes_on_beyond_the_border_where_the_border_says_so() -> None:
    correction, _ = fitted(noise=0.0)
    assert correction.continuation == 2
    assert correction.growth < 1e-9
    near = correction.upper + 0.2 * (correction.upper - correction.lower) * np.eye(3)
    np.testing.assert_allclose(correction.displacement(near), polynomial(near), atol=1e-12)


def test_there_is_no_step_at_the_border() -> None:
    measured = cloud()
    bent = measured + 5e-3 * np.sin(9.0 * measured) + 1e-4 * cloud(seed=4)
    correction = fit_distortion(measured, bent)
    assert 0 < correction.continuation < correction.degree
    inside, outside = (correction.upper + step for step in (-1e-9, 1e-9))
    moved = correction.displacement(np.stack([inside, outside]))
    np.testing.assert_allclose(*moved, atol=1e-9)


def test_the_error_outside_is_the_one_to_expect_and_less_than_without_going_on() -> None:
    """Half a wave of distortion, of which the outermost layer of frames was never calibrated."""
    found, predicted, staying = [], [], []
    for seed in range(4):
        made = simulate_stereotactic(seed=seed, distortion=3e-3, em_noise=0.05e-3, grid=4)
        readings, true = made.data.readings.em, made.truth.expected
        place = true.mean(axis=1)[:, seed % 3]
        inner = place > place.min() + 0.1
        correction = fit_distortion(readings[inner], true[inner])
        left = readings[~inner]
        beyond = correction.outside(left) > 0
        stays = replace(correction, continued=np.zeros((1, 3)))
        for errors, by in ((found, correction), (staying, stays)):
            errors.append(rms((by.correct(left) - true[~inner])[beyond]))
        predicted.append(correction.extrapolation_error(left[beyond]))
    assert np.sqrt(np.mean(np.square(found))) < 0.5 * np.sqrt(np.mean(np.square(staying)))
    assert 0.5 < np.sqrt(np.mean(np.square(found)) / np.mean(np.square(predicted))) < 2.0


def test_the_border_says_of_noise_alone_that_nothing_grows() -> None:
    expected = cloud()
    measured = expected + 0.5e-3 * np.random.default_rng(0).standard_normal(expected.shape)
    correction = fit_distortion(measured, expected)
    assert correction.continuation == 0
    assert correction.extrapolation_error(correction.upper + 0.1) < correction.cross_validation[0]


def test_fitted_points_are_inside() -> None:
    measured = cloud()
    assert fit_distortion(measured, measured).inside(measured).all()


def test_shapes_are_kept() -> None:
    correction, fresh = fitted(noise=0.0)
    assert correction.correct(fresh).shape == fresh.shape
    assert correction.inside(fresh).shape == fresh.shape[:-1]
    one = fresh[0, 0]
    np.testing.assert_allclose(correction.correct(one), correction.correct(fresh)[0, 0])


def test_few_points_allow_low_degrees_only() -> None:
    measured = cloud(frames=3, n=9)
    correction = fit_distortion(measured, measured + polynomial(measured))
    assert set(correction.cross_validation) <= {0, 1}


def test_a_nearly_flat_cloud_does_not_blow_up() -> None:
    """Directions that the data barely show are not fitted."""
    measured = cloud()
    measured[..., 2] = 0.3 * measured[..., 0] + 1e-4 * measured[..., 2]
    expected = measured + 1e-3 * np.sin(8 * measured)
    correction = fit_distortion(measured, expected)
    fresh = measured[::2] + np.array([0, 1e-5, 0])
    assert rms(correction.correct(fresh) - fresh - 1e-3 * np.sin(8 * fresh)) < 2e-5


def test_too_little_is_refused() -> None:
    measured = cloud(frames=4)
    with pytest.raises(SamplesError, match="1 frame"):
        fit_distortion(measured[:1], measured[:1])
    flat = measured * [1.0, 1.0, 0.0]
    with pytest.raises(SamplesError, match="in one plane"):
        fit_distortion(flat, measured)
    assert not is_distorted(flat, flat)


def test_a_basis_spans_what_singular_values_say_and_no_more() -> None:
    points = np.random.default_rng(0).random((400, 3))
    points[:, 2] = 0.5 + 1e-3 * points[:, 2]
    basis = _basis(points, 4)
    left, size, _ = np.linalg.svd(basis, full_matrices=False)
    kept = left[:, size > RCOND * size[0]]
    u, back = _orthonormal(basis)
    assert u.shape == kept.shape < basis.shape
    np.testing.assert_allclose(u.T @ u, np.eye(u.shape[1]), atol=1e-12)
    # What rounding of the squares may turn the smallest direction by (Davis and Kahan 1970).
    turned = np.finfo(float).eps * (size[0] / size[kept.shape[1] - 1]) ** 2
    assert np.linalg.norm(u @ u.T - kept @ kept.T, 2) < turned < 1e-4
    np.testing.assert_allclose(basis @ back, u, atol=1e-8)


def quartic(points: np.ndarray) -> np.ndarray:
    """A displacement of degree 4 in every axis, a few mm."""
    x, y, z = np.moveaxis(4.0 * (points / SIZE - 0.5), -1, 0)
    return 1e-3 * np.stack([x * y - 0.3 * z**4, x**3 - 0.2 * y**4, y * z**3 + 0.2 * x], axis=-1)


def wave(points: np.ndarray) -> np.ndarray:
    """No polynomial: half a wave over the volume, 5 mm."""
    return 5e-3 * np.sin(points[..., [1, 2, 0]] * (np.pi / SIZE) + [0.3, 1.0, 2.0])


@pytest.mark.parametrize(
    ("field", "share", "left"),
    [(quartic, 0.05, 0.5), (quartic, 0.15, 0.8), (wave, 0.05, 1.01), (wave, 0.15, 1.01)],
)
def test_outside_it_goes_on_as_the_border_says_at_that_distance(
    field: Callable[[np.ndarray], np.ndarray], share: float, left: float
) -> None:
    """A layer of a fifth of the box says of noise what one of a twentieth does not."""
    errors, staying, expected = [], [], []
    for seed in range(3):
        measured, random = cloud(frames=120, seed=seed), np.random.default_rng(6 + seed)
        noise = 0.2e-3 * random.standard_normal(measured.shape)
        outside = random.uniform(0.1, SIZE - 0.1, (300, 3))
        outside[np.arange(300), np.arange(300) % 3] = SIZE * (1.0 + share * random.random(300))
        found = fit_distortion(measured, measured + field(measured) + noise, corrected=outside)
        wanted = outside + field(outside)
        border = np.clip(outside, found.lower, found.upper)
        staying.append(rms(found.displacement(border) + outside - wanted))
        errors.append(rms(found.correct(outside) - wanted))
        inside = found.cross_validation[found.degree]
        expected.append(np.hypot(found.extrapolation_error(outside), inside))
    assert rms(np.array(errors)) < left * rms(np.array(staying))
    assert rms(np.array(errors)) < 2.5 * rms(np.array(expected))
