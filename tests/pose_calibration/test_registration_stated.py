"""Registration of points whose instruments state how sure each of them is."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from spread import is_as_predicted
from studies import first_of

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rotation_from_vector, skew, vector_from_rotation
from suta_calib.measurements.pose_files import read_corresponding_points
from suta_calib.pose_calibration.registration import (
    Registration,
    register,
    registration_from_points,
)
from suta_calib.pose_calibration.stated_noise import Agreement, StatedSpread
from suta_calib.report.registration import register_document

R, P = rotation_from_vector([0.3, -1.2, 0.7]), np.array([1.0, 0.2, 0.5])


@cache
def scene(count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points in frame a, and standard deviations in a and in b that span a factor of fifty."""
    random = np.random.default_rng([7, count])
    points = random.uniform(-0.3, 0.3, (count, 3))
    spans = np.exp(random.uniform(np.log(2e-5), np.log(1e-3), (2, count, 3)))
    return points, *spans


def measured(count: int, seed: int, times: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """The points as they were seen in either frame, with ``times`` the noise that is stated."""
    points, of_a, of_b = scene(count)
    noise = times * np.random.default_rng([seed, count]).standard_normal((2, count, 3))
    return points + of_a * noise[0], points @ R.T + P + of_b * noise[1]


def weighed(count: int, seed: int, times: float = 1.0) -> Registration:
    _, of_a, of_b = scene(count)
    return register(*measured(count, seed, times), source_sigma=of_a, target_sigma=of_b)


def error_of(found: Registration) -> FloatArray:
    """Displacement (m) and turn (rad) of the moved points about their centre, (6,)."""
    centre = R.T @ (found.centre - P)
    turn = vector_from_rotation(found.rotation @ R.T)
    return np.concatenate([found.act(centre) - found.centre, turn])


def test_whitened_residuals_scatter_alike() -> None:
    _, of_a, of_b = scene(6)
    spread = StatedSpread(of_a, of_b)
    whitening = spread.whitening(R)
    for k in range(6):
        covariance = R @ np.diag(of_a[k] ** 2) @ R.T + np.diag(of_b[k] ** 2)
        white = whitening[k] @ covariance @ whitening[k].T
        np.testing.assert_allclose(white, spread.typical**2 * np.eye(3), atol=1e-9 * white.max())


def test_the_answer_is_generalised_least_squares() -> None:
    """Of the normal equations nothing is left, and their inverse is the covariance."""
    a, b = measured(8, 2)
    _, of_a, of_b = scene(8)
    found = register(a, b, source_sigma=of_a, target_sigma=of_b, robust=False)
    assert not found.agreement.contradicted
    gradient, normal = np.zeros(6), np.zeros((6, 6))
    for k in range(8):
        covariance = found.rotation @ np.diag(of_a[k] ** 2) @ found.rotation.T
        precision = np.linalg.inv(covariance + np.diag(of_b[k] ** 2))
        motion = np.hstack([np.eye(3), -skew(found.act(a[k]) - found.centre)])
        gradient += motion.T @ precision @ (found.act(a[k]) - b[k])
        normal += motion.T @ precision @ motion
    unit = np.sqrt(np.diag(found.covariance))
    # In units of what each is known to; the weights follow R, which their own change ignores.
    assert np.abs(np.linalg.solve(normal, gradient) / unit).max() < 1e-3
    np.testing.assert_allclose(
        np.linalg.inv(normal) / np.outer(unit, unit),
        found.covariance / np.outer(unit, unit),
        atol=1e-3,
    )


@pytest.mark.parametrize(
    ("count", "trials"), first_of([(4, 15), (12, 10), (40, 8), (4, 30), (12, 20), (40, 15)], 3)
)
def test_the_monte_carlo_spread_is_the_predicted_one(count: int, trials: int) -> None:
    """Of the whole covariance: the squared distance in units of it is χ²."""
    squared = []
    for seed in range(trials):
        found = weighed(count, seed)
        error = error_of(found)
        squared.append(error @ np.linalg.solve(found.covariance, error) / 6.0)
    assert is_as_predicted(float(np.sqrt(np.mean(squared))), 6 * trials)


@pytest.mark.slow
@pytest.mark.parametrize("count", [4, 6, 12, 40])
def test_the_monte_carlo_spread_is_the_predicted_one_closely(count: int) -> None:
    errors = [(error_of(found), found) for found in (weighed(count, s) for s in range(200))]
    squared = [e @ np.linalg.solve(found.covariance, e) / 6.0 for e, found in errors]
    assert 0.93 < np.sqrt(np.mean(squared)) < 1.08
    # What is stated is true: it is seldom contradicted.
    assert np.mean([found.agreement.contradicted for _, found in errors]) < 0.03


def test_rows_that_are_sure_weigh_more() -> None:
    """Weighed, the errors are less than half of what they are when all rows count alike."""
    alike = [error_of(register(*measured(40, seed)))[:3] for seed in range(8)]
    by_sigma = [error_of(weighed(40, seed))[:3] for seed in range(8)]
    assert np.sqrt(np.mean(np.square(by_sigma)) / np.mean(np.square(alike))) < 0.6


@pytest.mark.parametrize("count", [5, 12, 40])
def test_residuals_that_contradict_are_told(count: int) -> None:
    large = weighed(count, 1, 3.0)
    assert large.assessment.level == "care"
    assert large.agreement.too_large
    assert any("times as large as the stated σ" in note for note in large.assessment.notes)
    small = weighed(count, 1, 0.2)
    assert any("the σ are too large" in note for note in small.assessment.notes)
    true = weighed(count, 1)
    assert not any("σ" in note for note in true.assessment.notes)
    # ± is not less than what is stated, and more where that is not enough.
    np.testing.assert_allclose(np.diag(small.covariance), np.diag(true.covariance), rtol=0.02)
    ratio = np.sqrt(np.diag(large.covariance) / np.diag(true.covariance))
    assert np.all((ratio > 2.0) & (ratio < 5.0))


def test_a_gross_error_is_an_outlier_by_its_own_sigma() -> None:
    """Thirty times its σ away, and yet nearer than the others rightly are."""
    points, sigma = scene(20)[0], np.full((20, 3), 1e-3)
    sigma[:10] = 2e-5
    b = points @ R.T + P + sigma * np.random.default_rng(3).standard_normal((20, 3))
    b[7] += [0.0, 6e-4, 0.0]
    found = register(points, b, target_sigma=sigma)
    assert found.outliers == (7,)
    assert np.linalg.norm(found.residuals[7]) < found.rms


def test_one_sigma_for_all_changes_no_answer() -> None:
    a, b = measured(12, 5)
    plain = register(a, b)
    sigma = np.full(a.shape, plain.sigma / np.sqrt(2.0))
    same = register(a, b, source_sigma=sigma, target_sigma=sigma)
    np.testing.assert_allclose(same.matrix, plain.matrix, atol=1e-9)
    assert same.scale == pytest.approx(plain.scale, abs=1e-12)
    only_b = register(a, b, target_sigma=np.sqrt(2.0) * sigma)
    np.testing.assert_allclose(only_b.matrix, plain.matrix, atol=1e-9)
    np.testing.assert_allclose(only_b.covariance, same.covariance, rtol=1e-9, atol=1e-15)


def test_agreement_is_chi_squared() -> None:
    assert Agreement.of(10.0, 10.0).factor == 1.0
    assert not Agreement.of(10.0, 10.0).contradicted
    assert Agreement.of(30.0, 10.0).too_large
    assert Agreement.of(1.0, 10.0).contradicted
    assert not Agreement.of(1.0, 10.0).too_large


@pytest.mark.parametrize("sigma", [np.zeros((4, 3)), -np.ones((4, 3)), np.ones((3, 3))])
def test_what_is_no_sigma_is_refused(sigma: FloatArray) -> None:
    with pytest.raises(SamplesError, match="target_sigma"):
        register(*measured(4, 0), target_sigma=sigma)


def test_files_state_it_in_columns(tmp_path: Path) -> None:
    """One sigma or three, m or mm; the record says what was stated and how it fits."""
    a, b = measured(6, 1)
    of_b = np.full((6, 3), 4e-4) * np.arange(1, 7)[:, None]
    one, two = tmp_path / "a.csv", tmp_path / "b.csv"
    one.write_text("x,y,z\n" + "".join(f"{x!r},{y!r},{z!r}\n" for x, y, z in a.tolist()))
    rows = np.hstack([b, 1e3 * of_b[:, :1]]).tolist()
    two.write_text("x,y,z,sigma_mm\n" + "".join(",".join(map(repr, r)) + "\n" for r in rows))
    points = read_corresponding_points(one, two)
    assert points[0].sigma is None
    np.testing.assert_allclose(points[1].sigma, of_b)
    found = registration_from_points(*points)
    expected = register(a, b, target_sigma=of_b)
    np.testing.assert_allclose(found.matrix, expected.matrix, atol=1e-12)
    record = register_document(found, *points).data["stated"]
    assert record["sigma_mm"] == pytest.approx(1e3 * np.exp(np.log(of_b).mean()))
    assert set(record) == {"sigma_mm", "factor", "chance"}
    two.write_text("x,y,z,sigma\n1,2,3,0\n")
    with pytest.raises(SamplesError, match="greater than 0"):
        read_corresponding_points(two, two)
