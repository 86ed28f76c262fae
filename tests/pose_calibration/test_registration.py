"""Rigid registration of points: exact, robust, its covariance, Fitzpatrick's target error."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from registration_scenes import NATURES, NOISE, Points, at_points, error_of, simulate
from spread import is_as_predicted
from studies import first_of, of_size

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.pose_calibration.registration import Registration, register
from suta_calib.terms import TrackedPoint
from suta_calib.terms.synthetic import OutlierModel, PoseNoise
from suta_calib.trust.hypotheses.scaled_points import ScaledPoints


# ── Exact points ─────────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("robust", [True, False])
@pytest.mark.parametrize(
    "vector",
    [
        *(
            (0.0, 0.0, 0.0),
            (1e-9, 0.0, 0.0),
            (0.3, -1.2, 0.7),
            (np.pi, 0.0, 0.0),
            (0.0, -np.pi, 0.0),
        ),
        tuple(np.pi * np.array([1.0, 2.0, -2.0]) / 3.0),
        tuple((np.pi - 1e-9) * np.array([2.0, -1.0, 2.0]) / 3.0),
    ],
)
def test_exact_points_give_back_the_transform(vector: tuple[float, ...], robust: bool) -> None:
    T = rotation_from_vector(vector), np.array([0.2, -0.3, 1.5])
    _, a, b = simulate(8, T=T)
    found = register(a, b, robust=robust)
    np.testing.assert_allclose(found.rotation, T[0], atol=1e-9)
    np.testing.assert_allclose(found.position, T[1], atol=1e-9)
    assert found.outliers == ()
    assert found.rms < 1e-9
    assert found.assessment.level == "good"
    np.testing.assert_array_equal(found.matrix[3], [0, 0, 0, 1])
    np.testing.assert_allclose(found.act(a), b, atol=1e-9)


def test_least_squares_is_arun_s_closed_form() -> None:
    """The rotation of the singular value decomposition, written out."""
    _, a, b = simulate(15, spread=PoseNoise(2e-3), seed=2)
    moment = (b - b.mean(axis=0)).T @ (a - a.mean(axis=0))
    u, _, v = np.linalg.svd(moment)
    R = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
    found = register(a, b, robust=False)
    np.testing.assert_allclose(found.rotation, R, atol=1e-8)
    np.testing.assert_allclose(found.position, b.mean(axis=0) - R @ a.mean(axis=0), atol=1e-8)
    expected = a @ R.T + found.position - b
    assert found.rms == pytest.approx(np.sqrt(np.mean(np.sum(expected**2, axis=1))), rel=1e-6)


# ── Outliers ─────────────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("seeds", of_size(3, 8))
@pytest.mark.parametrize("nature", NATURES)
def test_outliers_are_listed_and_cost_next_to_nothing(nature: Any, seeds: int) -> None:
    """30 % of 40 points: the error is that of the others alone."""
    robust, alone = [], []
    for seed in range(seeds):
        data, a, b = simulate(40, spread=NOISE, seed=seed, gross=OutlierModel(0.3, nature))
        found = register(a, b)
        assert found.outliers == data.outliers, seed
        assert found.assessment.level == "good"
        rows = data.inliers
        robust.append(at_points(found, data))
        alone.append(at_points(register(a[rows], b[rows], robust=False), data))
    assert np.sqrt(np.mean(np.square(robust))) < 1.3 * np.sqrt(np.mean(np.square(alone)))


# ── Uncertainty ──────────────────────────────────────────────────────────────────────────────
def fitzpatrick(points: FloatArray, target: FloatArray, fle: float) -> float:
    """Root mean square target error by equation 46 of Fitzpatrick, West, Maurer (1998).

    ``TRE² = FLE²/N (1 + 1/3 Σ d_k² / f_k²)``: d_k the target's distance from principal axis k of
    the fiducials, f_k their own root mean square distance from it.
    """
    centred = points - points.mean(axis=0)
    axes = np.linalg.svd(centred)[2]
    along, of_target = centred @ axes.T, (target - points.mean(axis=0)) @ axes.T
    others = 1.0 - np.eye(3)
    ratio = (others @ of_target**2) / np.mean(along**2 @ others, axis=0)
    return float(np.sqrt(fle**2 / len(points) * (1.0 + ratio.sum() / 3.0)))


@pytest.mark.parametrize("count", [6, 20, 29])
def test_the_target_error_is_fitzpatrick_s(count: int) -> None:
    _, a, b = simulate(count, spread=NOISE, seed=4, size=(0.2, 0.1, 0.05))
    found = register(a, b, robust=False)
    targets = np.vstack([a.mean(axis=0), np.random.default_rng(0).uniform(-0.3, 0.3, (5, 3))])
    # Of few points the scatter itself is uncertain: Student's variance.
    freedom = 3 * count - 6
    sigma = np.sqrt(3.0) * found.sigma * np.sqrt(freedom / (freedom - 2) if count < 30 else 1.0)
    expected = [fitzpatrick(a, target, sigma) for target in targets]
    np.testing.assert_allclose(found.target_error(targets), expected, rtol=0.02)


def spread_over_prediction(count: int, trials: int) -> tuple[float, float]:
    """Errors in units of each answer's standard deviation, RMS: of the pose, and at a target."""
    errors, at_target = [], []
    target = np.array([[0.3, 0.1, -0.2]])
    for seed in range(trials):
        # The points stay, the noise differs: the seed of the scene is the first one's.
        data, a, _ = simulate(count, seed=1)
        R, p = data.true_pose("base")
        noise = NOISE.position * np.random.default_rng([seed, count]).standard_normal(a.shape)
        found = register(a, a @ R.T + p + noise)
        errors.append(error_of(found, data) ** 2 / np.diag(found.covariance))
        off = np.sum((found.act(target) - target @ R.T - p) ** 2)
        at_target.append(off / found.target_error(target)[0] ** 2)
    return float(np.sqrt(np.mean(errors))), float(np.sqrt(np.mean(at_target)))


@pytest.mark.parametrize("count", [6, 40])
def test_the_monte_carlo_spread_is_the_predicted_one(count: int) -> None:
    pose, target = spread_over_prediction(count, 20)
    assert is_as_predicted(pose, 6 * 20)
    assert is_as_predicted(target, 3 * 20)


@pytest.mark.parametrize("seeds", of_size(20, 50))
@pytest.mark.parametrize("count", [4, 5, 6])
def test_few_points_err_by_what_each_answer_states(count: int, seeds: int) -> None:
    """Of each set by its own ±, which the scatter of few makes too small as often as too large."""
    squares = []
    for seed in range(seeds):
        random = np.random.default_rng([seed, count])
        a = random.uniform(-0.1, 0.1, (count, 3))
        found = register(a, a + NOISE.position * random.standard_normal(a.shape))
        target = np.array([[0.15, 0.1, -0.1]])
        off = found.act(target) - target
        squares.append(np.sum(off**2) / found.target_error(target)[0] ** 2)
    assert 0.75 < np.sqrt(np.mean(squares)) < 1.3


# ── A scale, which no rigid transform has ────────────────────────────────────────────────────
@pytest.mark.parametrize("count", [5, 12, 60])
@pytest.mark.parametrize(("scale", "level"), [(1.015, "bad"), (0.98, "bad"), (1.002, "care")])
def test_a_scale_is_told_with_its_uncertainty(count: int, scale: float, level: str) -> None:
    for seed in range(3):
        _, a, b = simulate(count, spread=PoseNoise(0.05e-3, 0.0), seed=seed)
        found = register(a, scale * b)
        finding = found.finding(ScaledPoints.name)
        assert finding.level == level
        assert found.scale == pytest.approx(scale, abs=5.0 * found.scale_std)
        size, sets = finding.evidence.size[0], finding.evidence.effect.about
        assert sets.left(size * sets.placed) < 0.3e-3
        assert any("times as far apart" in note for note in found.assessment.notes)


def test_no_scale_is_seen_where_there_is_none() -> None:
    for count in (4, 6, 30):
        for seed in range(12):
            _, a, b = simulate(count, spread=NOISE, seed=seed)
            assert register(a, b).finding(ScaledPoints.name) is None


@pytest.mark.slow
@pytest.mark.parametrize("count", [6, 12, 40])
def test_the_monte_carlo_spread_is_the_predicted_one_closely(count: int) -> None:
    pose, target = spread_over_prediction(count, 600)
    assert 0.9 < pose < 1.12
    assert 0.9 < target < 1.12


# ── Invariance ───────────────────────────────────────────────────────────────────────────────
@pytest.fixture(scope="module")
def contaminated() -> tuple[Points, Registration]:
    _, a, b = simulate(30, spread=NOISE, seed=6, gross=OutlierModel(0.2, "slipped"))
    return (a, b), register(a, b)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_the_unit_of_length_does_not_count(
    contaminated: tuple[Points, Registration], scale: float
) -> None:
    (a, b), found = contaminated
    scaled = register(scale * a, scale * b)
    assert scaled.outliers == found.outliers
    np.testing.assert_allclose(scaled.rotation, found.rotation, atol=1e-9)
    np.testing.assert_allclose(scaled.position / scale, found.position, atol=1e-9)
    unit = np.repeat([scale, 1.0], 3)
    expected = found.covariance * np.outer(unit, unit)
    relative = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(scaled.covariance / relative, expected / relative, atol=1e-6)


def test_the_frames_do_not_count(contaminated: tuple[Points, Registration]) -> None:
    """Turned and moved frames give the transform between them, and the same residuals."""
    (a, b), found = contaminated
    Qa, Qb = rotation_from_vector([[0.4, 2.0, -1.0], [-2.5, 0.3, 0.9]])
    pa, pb = np.array([5.0, -3.0, 2.0]), np.array([-1.0, 0.5, 4.0])
    moved = register(a @ Qa.T + pa, b @ Qb.T + pb)
    assert moved.outliers == found.outliers
    np.testing.assert_allclose(moved.rotation, Qb @ found.rotation @ Qa.T, atol=1e-8)
    expected = Qb @ (found.position - found.rotation @ Qa.T @ pa) + pb
    np.testing.assert_allclose(moved.position, expected, atol=1e-7)
    np.testing.assert_allclose(moved.residuals, found.residuals @ Qb.T, atol=1e-8)
    both = np.kron(np.eye(2), Qb)
    scale = np.abs(found.covariance).max()
    turned = both @ found.covariance @ both.T
    np.testing.assert_allclose(moved.covariance, turned, atol=1e-4 * scale)


def test_the_order_of_the_points_does_not_count(contaminated: tuple[Points, Registration]) -> None:
    """Other minimal samples are drawn; what is fitted in the end is the same."""
    (a, b), found = contaminated
    order = np.random.default_rng(0).permutation(len(a))
    again = register(a[order], b[order])
    assert sorted(order[list(again.outliers)].tolist()) == list(found.outliers)
    np.testing.assert_allclose(again.rotation, found.rotation, atol=1e-6)
    np.testing.assert_allclose(again.position, found.position, atol=1e-6)


def test_the_way_back_is_the_inverse(contaminated: tuple[Points, Registration]) -> None:
    (a, b), found = contaminated
    back = register(b, a)
    np.testing.assert_allclose(back.matrix @ found.matrix, np.eye(4), atol=1e-5)
    assert back.outliers == found.outliers


@pytest.mark.parametrize("seed", first_of(range(8)))
def test_noisy_fiducials_are_registered_all_the_same(seed: int) -> None:
    """Five millimetres on points within ± 100 mm are much, and no reason to refuse."""
    term = TrackedPoint.simulate(12, spread=PoseNoise(5e-3), seed=seed).term
    found = register(term.poses.at({})[1], term.poses.samples.position)
    assert 3e-3 < found.sigma < 8e-3
