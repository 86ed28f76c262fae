"""Least median of squares: what most rows agree on, whatever the others say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from suta_calib.pose_calibration import consensus
from suta_calib.pose_calibration.consensus import (
    FALSE_ALARM,
    TRIES,
    Consensus,
    find_consensus,
    minimal_samples,
    outlier_limit,
)


def centre_of(values: np.ndarray, seed: int = 0, shapes: list | None = None) -> Consensus:
    """Consensus on a centre: the simplest model, of one row; kinds of residuals in threes."""
    kinds = values.reshape(len(values), -1, 3)

    def residuals(centres: np.ndarray, rows: np.ndarray) -> np.ndarray:
        if shapes is not None:
            shapes.append((len(centres), rows.shape[-1]))
        return np.linalg.norm(kinds[rows] - centres[:, None], axis=-1)

    samples = minimal_samples(np.zeros(len(values), dtype=np.intp), 1, seed)
    propose = lambda rows: kinds[rows].mean(axis=1)  # noqa: E731
    return find_consensus(len(values), samples, propose, residuals, 1)


def cluster(count: int, outliers: int, seed: int, kinds: int = 1) -> np.ndarray:
    """Rows about a centre, one unit apart; the last ones agree with each other elsewhere."""
    values = np.random.default_rng(seed).standard_normal((count, 3 * kinds)) + 5.0
    values[count - outliers :] += 100.0
    return values


@pytest.mark.parametrize("count", [20, 51, 200])
def test_nearly_half_of_the_rows_may_be_anything_even_agree_with_each_other(count: int) -> None:
    outliers = count - (count + 2) // 2
    for seed in range(10):
        found = centre_of(cluster(count, outliers, seed))
        assert not found.inliers[count - outliers :].any()
        assert found.inliers[: count - outliers].mean() > 0.9


def test_one_more_and_the_majority_is_the_other() -> None:
    found = centre_of(cluster(50, 26, 0))
    np.testing.assert_array_equal(np.flatnonzero(found.inliers), np.arange(24, 50))


@pytest.mark.parametrize("outliers", [0, 60])
def test_the_scatter_found_is_that_of_the_inliers(outliers: int) -> None:
    """Seen by its better half only, so roughly; it errs to the large side where outliers are."""
    sigmas = [centre_of(cluster(200, outliers, seed)).sigmas[0] for seed in range(20)]
    # A quantile taken as the half of 200 rows is one of 140 at a higher place.
    rank = 101 / (200 - outliers + 1)
    expected = np.sqrt(chi2.ppf(rank, 3) / chi2.ppf(101 / 201, 3))
    assert np.mean(sigmas) == pytest.approx(expected, rel=0.12)


def test_units_of_the_kinds_do_not_count() -> None:
    """Displacements in mm or in m, beside turns: the same rows."""
    values = cluster(60, 20, 1, kinds=2)
    values[:5, 3:] += 30.0
    found = centre_of(values)
    scaled = centre_of(values * np.repeat([1e3, 1.0], 3))
    np.testing.assert_array_equal(np.flatnonzero(found.inliers), np.arange(5, 40))
    np.testing.assert_array_equal(found.inliers, scaled.inliers)
    np.testing.assert_allclose(scaled.sigmas, found.sigmas * [1e3, 1.0], rtol=1e-9)


def test_both_kinds_are_judged() -> None:
    """Rows that fit in one kind only do not agree."""
    values = np.random.default_rng(2).standard_normal((60, 6))
    values[:10, :3] += 50.0
    values[10:20, 3:] += 50.0
    found = centre_of(values)
    np.testing.assert_array_equal(np.flatnonzero(~found.inliers), np.arange(20))


def test_exact_rows_agree_and_their_scatter_is_not_zero() -> None:
    values = np.full((30, 3), 7.0)
    values[:9] += np.arange(1.0, 10.0)[:, None]
    found = centre_of(values)
    np.testing.assert_array_equal(np.flatnonzero(~found.inliers), np.arange(9))
    assert 0 < found.sigmas[0] < 1e-9


def test_the_seed_decides_and_nothing_else() -> None:
    values = cluster(40, 15, 3)
    first, second = centre_of(values, 7), centre_of(values, 7)
    np.testing.assert_array_equal(first.inliers, second.inliers)
    np.testing.assert_array_equal(first.sigmas, second.sigmas)


def test_samples_hold_distinct_rows_of_one_group() -> None:
    group = np.array([0] * 3 + [1] * 10 + [2] * 30)
    samples = minimal_samples(group, 4, seed=0)
    assert samples.shape == (TRIES, 4)
    assert (np.diff(samples, axis=1) > 0).all()
    groups = group[samples]
    assert (groups == groups[:, :1]).all()
    # The first group is too small to give a sample; the others give theirs by their size.
    assert set(groups[:, 0]) == {1, 2}
    assert np.mean(groups[:, 0] == 2) == pytest.approx(0.75, abs=0.1)
    np.testing.assert_array_equal(samples, minimal_samples(group, 4, seed=0))
    assert (samples != minimal_samples(group, 4, seed=1)).any()


@pytest.mark.parametrize("kinds", [1, 2])
def test_a_clean_set_loses_a_row_as_seldom_as_promised(kinds: int) -> None:
    """4,000 sets of 50 rows: 40 are expected to lose one, give or take 6."""
    squared = np.random.default_rng(0).standard_normal((4000, 50, 3 * kinds)) ** 2
    lost = (squared.sum(axis=2) > outlier_limit(50, kinds)).any(axis=1).sum()
    assert abs(lost - 4000 * FALSE_ALARM) < 20


def test_all_models_are_tried_on_some_rows_and_the_best_of_them_on_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The same rows agree, with nearly half of them wrong, and few residuals are held at once."""
    values, shapes = cluster(1000, 450, 0), list[tuple[int, int]]()
    found = centre_of(values, shapes=shapes)
    assert max(models * rows for models, rows in shapes) <= TRIES * consensus.SCREENING
    monkeypatch.setattr(consensus, "SCREENING", 1000)
    np.testing.assert_array_equal(found.inliers, centre_of(values).inliers)
    assert not found.inliers[550:].any()


def test_many_rows_are_all_judged_by_a_model_that_a_part_of_them_chose(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    values, shapes = cluster(4000, 1700, 0), list[tuple[int, int]]()
    whole = centre_of(values)
    monkeypatch.setattr(consensus, "MOST_ROWS", 500)
    found = centre_of(values, shapes=shapes)
    assert not found.inliers[2300:].any()
    assert (found.inliers == whole.inliers).mean() > 0.995
    assert abs(found.sigmas[0] / whole.sigmas[0] - 1.0) < 0.15
    # All rows are looked at once, under one model.
    assert [shape for shape in shapes if shape[1] > 500] == [(1, 4000)]
