"""Points that cannot be registered, and those that look so: mirrors, lines, strangers."""

from __future__ import annotations

import numpy as np
import pytest
from registration_scenes import NOISE, at_points, simulate
from studies import first_of

from suta_calib.errors import SamplesError
from suta_calib.pose_calibration.registration import register
from suta_calib.terms.synthetic import OutlierModel, PoseNoise


# ── Arun's third case ────────────────────────────────────────────────────────────────────────
def test_coplanar_points_are_fine_even_seen_in_a_mirror() -> None:
    """A flat set is its mirror image turned over: one proper rotation fits either."""
    data, a, b = simulate(12, spread=NOISE, size=(0.2, 0.15, 0.0))
    found = register(a, b)
    assert at_points(found, data) < 3 * NOISE.position
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)
    mirrored = register(a * [-1.0, 1.0, 1.0], b)
    assert np.linalg.det(mirrored.rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(mirrored.residuals, found.residuals, atol=1e-7)


@pytest.mark.parametrize("noise", [0.0, 3e-4])
@pytest.mark.parametrize("share", [0.0, 0.3])
@pytest.mark.parametrize("axis", range(3))
def test_a_mirror_image_is_refused(axis: int, share: float, noise: float) -> None:
    _, a, b = simulate(20, spread=PoseNoise(noise), gross=OutlierModel(share))
    with pytest.raises(SamplesError, match=r"mirror image.*right-handed.*swap two axes"):
        register(a * (1.0 - 2.0 * np.eye(3)[axis]), b)


@pytest.mark.parametrize("seed", first_of(range(5)))
def test_noise_larger_than_the_depth_of_a_flat_set_is_no_mirror(seed: int) -> None:
    """The points say either handedness equally well: not the data's fault."""
    data, a, b = simulate(12, spread=NOISE, seed=seed, size=(0.2, 0.15, 1e-4))
    assert at_points(register(a, b), data) < 3 * NOISE.position


# ── What is refused ──────────────────────────────────────────────────────────────────────────
def test_too_few_points_are_refused() -> None:
    _, a, b = simulate(5)
    for count in (1, 2):
        with pytest.raises(SamplesError, match=f"found {count} points; expected at least 3"):
            register(a[:count], b[:count])
    assert register(a[:3], b[:3]).assessment.level == "care"


def test_different_numbers_of_points_are_refused() -> None:
    _, a, b = simulate(6)
    with pytest.raises(
        SamplesError, match="6 points and 5 points; expected the same points in both"
    ):
        register(a, b[:5])


def test_points_that_coincide_are_refused() -> None:
    _, a, _ = simulate(6)
    with pytest.raises(SamplesError, match="same point in every row of the first set"):
        register(np.tile(a[:1], (6, 1)), a)
    with pytest.raises(SamplesError, match="same point in every row of the second set"):
        register(a, np.tile(a[:1], (6, 1)))


@pytest.mark.parametrize("noise", [0.0, 3e-4])
def test_points_on_a_line_are_refused(noise: float) -> None:
    _, a, b = simulate(10, spread=PoseNoise(noise), size=(0.2, 0.0, 0.0))
    with pytest.raises(SamplesError, match="points on a line in the first set"):
        register(a, b)


@pytest.mark.parametrize("seed", first_of(range(3)))
def test_what_is_nearly_a_line_depends_on_the_noise(seed: int) -> None:
    """A rod of 0.2 mm tells its roll to an exact instrument, and nothing to one of 0.3 mm."""
    thin = (0.2, 2e-4, 2e-4)
    data, a, b = simulate(20, seed=seed, size=thin)
    assert at_points(register(a, b), data) < 1e-9
    _, a, b = simulate(20, seed=seed, size=thin, spread=NOISE)
    with pytest.raises(SamplesError, match="nearly lie on a line, compared with their scatter"):
        register(a, b)


def test_points_that_do_not_correspond_are_called_so() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.1, 0.1, (12, 3))
    with pytest.raises(SamplesError, match=r"after the best registration.*row for row"):
        register(points, rng.uniform(-0.1, 0.1, (12, 3)))


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (np.full((5, 3), np.nan), "not finite"),
        (np.zeros((5, 2)), "shape"),
        ([["a", "b", "c"]] * 5, "no array of numbers"),
    ],
)
def test_arrays_that_are_no_points_are_refused(source: object, message: str) -> None:
    with pytest.raises(SamplesError, match=message):
        register(source, np.eye(5, 3))  # type: ignore[arg-type]
