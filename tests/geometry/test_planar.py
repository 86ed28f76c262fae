"""Circles and lines in profiles of a line scanner."""

from __future__ import annotations

import numpy as np
import pytest

from suta_calib.geometry.planar import circle_in, fitted_circle, line_in, piece_of_line


def arc(noise: float, beside: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 2) on 100° of a circle of 10 mm among reflections, and which they are."""
    random = np.random.default_rng(seed)
    angle = np.radians(np.linspace(140, 40, 300))
    on = np.array([3e-3, -20e-3]) + 10e-3 * np.column_stack([np.cos(angle), np.sin(angle)])
    on[:, 1] += noise * random.standard_normal(300)
    left, right = (
        np.column_stack([np.linspace(*ends, beside // 2), random.uniform(-50e-3, 0, beside // 2)])
        for ends in ((-40e-3, -6e-3), (12e-3, 40e-3))
    )
    kept = np.concatenate([np.zeros(len(left)), np.ones(300), np.zeros(len(right))])
    return np.concatenate([left, on, right]), kept.astype(bool)


@pytest.mark.parametrize("beside", [0, 500])
@pytest.mark.parametrize("noise", [0.0, 5e-5])
def test_the_circle_is_found_among_reflections(noise: float, beside: int) -> None:
    points, true = arc(noise, beside)
    found = circle_in(points)
    assert found is not None
    np.testing.assert_allclose(found.centre, [3e-3, -20e-3], atol=1e-6 + noise / 2)
    assert found.radius == pytest.approx(10e-3, abs=1e-6 + noise / 2)
    assert found.on[true].mean() > 0.95
    assert not beside or found.on[~true].mean() < 0.1


def test_no_circle_larger_than_the_ball_is_found_nor_on_what_is_flat() -> None:
    points, _ = arc(1e-5, 0)
    assert circle_in(points, 8e-3) is None
    x = np.linspace(-0.05, 0.05, 400)
    flat = np.column_stack([x, 0.2 * x + 2e-5 * np.random.default_rng(1).standard_normal(400)])
    assert circle_in(flat) is None
    assert circle_in(flat[:5]) is None


def test_the_line_is_found_beside_a_step() -> None:
    random = np.random.default_rng(2)
    x = np.linspace(-0.05, 0.05, 400)
    z = np.where(x < 0.02, 0.1 + 0.3 * x, 0.05) + 3e-5 * random.standard_normal(400)
    found = line_in(np.column_stack([x, z]))
    assert found is not None
    (left, right), on = found.ends, found.on
    assert np.mean(on == (x < 0.02)) > 0.98
    slope = (right - left)[1] / (right - left)[0]
    assert slope == pytest.approx(0.3, abs=1e-3)
    assert line_in(np.zeros((3, 2))) is None


def test_a_circle_and_a_piece_of_a_line_are_those_of_least_squares() -> None:
    points, true = arc(5e-5, 0)
    centre, radius = fitted_circle(points[true])
    away = np.linalg.norm(points - centre, axis=1)
    slope = np.column_stack([(points - centre) / away[:, None], np.ones(len(points))])
    np.testing.assert_allclose(slope.T @ (away - radius), 0.0, atol=1e-9)
    line = np.column_stack([np.linspace(0, 1, 50), np.linspace(0, 0.5, 50)])
    ends = piece_of_line(line)
    np.testing.assert_allclose(ends.mean(axis=0), line.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(ends.T @ ends / 2, line.T @ line / 50, atol=1e-12)
