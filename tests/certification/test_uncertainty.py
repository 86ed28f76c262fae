"""Stated uncertainties of a certification against repeated simulated measurements."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from certified_artefact import NOISE, truth, yaws

from data.artefact.probed_artefact import csv_text, exact_rows
from suta_calib.arrays import FloatArray
from suta_calib.certification.frame import shape_covariance
from suta_calib.certification.points import PLAIN, CertificationOptions, read_raw_points
from suta_calib.certification.procedure import certify
from suta_calib.certification.result import Certification
from suta_calib.geometry.numbers import wrap
from suta_calib.measurements import Artefact, read_artefact

FEW = 60
MANY = 200
# 95 % intervals, as often as this.
COVERED = (0.90, 0.99)


@dataclass(frozen=True, eq=False)
class Runs:
    """Certifications of one artefact from independent measurements."""

    truth: Artefact
    found: list[Certification]

    @property
    def errors(self) -> FloatArray:
        """(runs, n, 3), m."""
        exact = np.array([mark.position for mark in self.truth.landmarks.values()])
        return np.array([[m.position for m in f.landmarks] for f in self.found]) - exact

    @property
    def std(self) -> FloatArray:
        return np.array([[m.std for m in f.landmarks] for f in self.found])

    @property
    def factor(self) -> FloatArray:
        return np.array([f.coverage_factor for f in self.found])[:, None, None]

    def covered(self) -> FloatArray:
        """(n, 3) share of runs whose 95 % interval holds the truth."""
        return np.mean(np.abs(self.errors) <= self.factor * self.std, axis=0)

    def yaws_covered(self) -> FloatArray:
        yaw = np.array([[m.yaw for m in f.landmarks] for f in self.found])
        std = np.array([[m.yaw_std for m in f.landmarks] for f in self.found])
        return np.mean(np.abs(wrap(yaw - yaws(self.truth))) <= self.factor[..., 0] * std, axis=0)


def measured(
    artefact: Artefact, file: Path, count: int, options: CertificationOptions = PLAIN
) -> Runs:
    exact, found = exact_rows(artefact), []
    for seed in range(count):
        text = csv_text(exact, NOISE, np.random.default_rng(seed))
        file.write_text(text, encoding="utf-8")
        found.append(certify(read_raw_points(file), options))
    return Runs(artefact, found)


@cache
def small(folder: Path) -> Runs:
    return measured(truth(), folder / "runs.csv", FEW)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    return small(tmp_path_factory.getbasetemp())


def told(runs: Runs) -> FloatArray:
    """Coordinates that are measured: the origin's x and y are zero by definition."""
    return runs.std[0] > 0


def test_the_origin_is_exact_by_definition(runs: Runs) -> None:
    assert np.sum(~told(runs)) == 2
    np.testing.assert_array_equal(runs.errors[:, 0, :2], 0.0)


def test_most_intervals_hold_the_truth(runs: Runs) -> None:
    assert COVERED[0] < runs.covered()[told(runs)].mean() < COVERED[1]
    assert COVERED[0] < runs.yaws_covered().mean() < COVERED[1]


def test_the_covariance_is_complete(runs: Runs) -> None:
    """Against the truth, correlations included: the mean square is the number of coordinates."""
    keep = told(runs).reshape(-1)
    squared = []
    for errors, found in zip(runs.errors, runs.found, strict=True):
        error = errors.reshape(-1)[keep]
        squared.append(error @ np.linalg.solve(found.covariance[np.ix_(keep, keep)], error))
    assert np.sqrt(np.mean(squared) / keep.sum()) == pytest.approx(1.0, abs=0.15)


def test_distances_are_known_better_than_a_frame_suggests(runs: Runs) -> None:
    """What a calibration uses: the shape; its standard deviations against the scatter."""
    n = len(runs.truth.landmarks)
    places = np.array([mark.position for mark in runs.truth.landmarks.values()])
    sample = np.cov(runs.errors.reshape(len(runs.found), -1), rowvar=False)
    seen = np.sqrt(np.diag(shape_covariance(places, sample))).reshape(n, 3)
    stated = np.array([[m.shape_std for m in f.landmarks] for f in runs.found]).mean(axis=0)
    assert np.sqrt(np.mean((seen / stated) ** 2)) == pytest.approx(1.0, abs=0.15)
    assert np.all(stated[1:] < 0.95 * runs.std.mean(axis=0)[1:])


@pytest.mark.slow
@pytest.mark.parametrize("stated", [False, True], ids=["learnt", "stated"])
def test_intervals_of_every_coordinate_hold_the_truth(
    tmp_path: Path, repository: Path, stated: bool
) -> None:
    """Fifteen landmarks, 1 µm: 90 to 99 of 100 intervals, for each coordinate of each landmark."""
    drawing = read_artefact(repository / "data" / "suta" / "artefact.yaml")
    options = CertificationOptions(sigma=NOISE) if stated else PLAIN
    runs = measured(drawing, tmp_path / "runs.csv", MANY, options)
    covered = runs.covered()[told(runs)]
    assert np.all((covered >= COVERED[0]) & (covered <= COVERED[1]))
    turns = runs.yaws_covered()
    assert np.all((turns >= COVERED[0]) & (turns <= COVERED[1]))
    assert sum(bool(found.damaged) for found in runs.found) <= 2
    assert sum(bool(found.wrong_touches) for found in runs.found) <= 8
