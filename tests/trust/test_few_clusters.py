"""A covariance that few clusters have told, and what a test by it may conclude."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from suta_calib import CalibrationJob, SolverOptions, solve
from suta_calib.trust import contradicted_priors
from suta_calib.trust.contradicted_priors import chance_of, freedom_of, wishart_freedom


@pytest.mark.parametrize("size", [1, 3])
def test_a_mean_has_one_degree_of_freedom_less_than_there_are_clusters(size: int) -> None:
    gain = np.tile(np.diag(np.arange(1.0, size + 1)), (8, 1, 1))
    assert wishart_freedom(gain, np.zeros((size, size)), np.arange(size)) == pytest.approx(7.0)


def test_clusters_that_tell_nothing_are_none_and_unequal_ones_count_for_less() -> None:
    gain = np.ones((12, 1, 1))
    gain[6:] = 0.0
    none = np.zeros((1, 1))
    assert wishart_freedom(gain, none, np.array([0])) == pytest.approx(5.0)
    gain[0] = 4.0
    assert wishart_freedom(gain, none, np.array([0])) < 4.0


def test_units_of_the_parameters_do_not_matter() -> None:
    random = np.random.default_rng(0)
    rows = random.standard_normal((10, 6, 4))
    gain = np.swapaxes(rows, 1, 2) @ rows
    scale = np.diag([1.0, 1e-4, 1e3, 1.0])
    some = np.array([1, 3])
    found = wishart_freedom(gain, np.zeros((4, 4)), some)
    assert wishart_freedom(scale @ gain @ scale, np.zeros((4, 4)), some) == pytest.approx(found)
    assert 1.0 < found < 9.0


def test_chances_of_a_mean_by_its_own_scatter_are_uniform() -> None:
    """Hotelling's: also of so few that chi-squared would see 25 % beyond its 5 %."""
    random, count, size = np.random.default_rng(1), 8, 3
    seen = random.standard_normal((4000, count, size))
    mean = seen.mean(axis=1)
    off = seen - mean[:, None]
    covariance = np.swapaxes(off, 1, 2) @ off / (count * (count - 1))
    squared = np.einsum("ni,nij,nj->n", mean, np.linalg.inv(covariance), mean)
    p = np.array([chance_of(value, size, count - 1.0) for value in squared.tolist()])
    for level in (0.01, 0.05, 0.5):
        assert abs((p < level).mean() - level) < 4 * np.sqrt(level * (1 - level) / len(p))


def test_too_few_clusters_contradict_nothing() -> None:
    assert chance_of(1e6, 4, 2.5) == 1.0


def test_many_rows_of_a_cluster_are_summed_by_themselves(
    repository: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = CalibrationJob.load(repository / "data" / "suta" / "calibration.yaml")
    solution = solve(job.problem(), SolverOptions(starts=1))
    row_by_row = freedom_of(solution, solution.free[:2])
    monkeypatch.setattr(contradicted_priors, "MANY_EACH", 1)
    assert freedom_of(solution, solution.free[:2]) == pytest.approx(row_by_row, rel=1e-9)
