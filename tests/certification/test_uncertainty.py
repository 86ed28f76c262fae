"""Stated uncertainties against repeated simulated measurements; holes and side touched worse."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from certified_artefact import (
    NOISE,
    TRUE_POSITIONS,
    Change,
    certified,
    moved,
    positions,
    truth,
    yaws,
)
from studies import first_of

from data.artefact.probed_artefact import csv_text, exact_rows
from suta_calib.arrays import FloatArray
from suta_calib.certification.frame import shape_covariance
from suta_calib.certification.noise import ProbingNoise, scatter_of_holes
from suta_calib.certification.points import PLAIN, CertificationOptions, read_raw_points
from suta_calib.certification.procedure import certify
from suta_calib.certification.result import Certification
from suta_calib.certification.scatter import Scatter
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


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    return measured(truth(), tmp_path_factory.mktemp("runs") / "runs.csv", FEW)


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


# ── What a touch is worth on each kind of feature ─────────────────────────────────────────────
STATED = CertificationOptions(sigma=NOISE)
SETS = 40


def worse(feature: str, sigma: float, seed: int) -> Change:
    """Touches of this feature scatter more than all others."""
    random = np.random.default_rng(1000 + seed)
    return lambda touched, _name, _k, point: (
        point + sigma * random.standard_normal(3) * (touched == feature)
    )


def sets(
    folder: Path, feature: str, sigma: float, options: CertificationOptions, count: int = SETS
) -> list[Certification]:
    return [
        certified(folder, worse(feature, sigma, seed), options=options, seed=seed)
        for seed in range(count)
    ]


def standardised(found: list[Certification], axes: slice) -> float:
    """Root mean square of error over standard deviation; the origin has none in x and y."""
    ratios = [
        (positions(each) - TRUE_POSITIONS)[1:, axes]
        / np.array([m.std for m in each.landmarks])[1:, axes]
        for each in found
    ]
    return float(np.sqrt(np.mean(np.square(ratios))))


@pytest.mark.parametrize("options", [PLAIN, STATED], ids=["learnt", "stated"])
@pytest.mark.parametrize("sigma", first_of([0.0, 1e-5, 4e-6], 2))
def test_centres_are_as_sure_as_the_touches_of_holes(
    tmp_path: Path, sigma: float, options: CertificationOptions
) -> None:
    found = sets(tmp_path, "hole", sigma, options)
    assert 0.8 < standardised(found, slice(0, 2)) < 1.25
    assert 0.8 < standardised(found, slice(2, 3)) < 1.25
    learnt = np.median([each.probing.of("hole") for each in found])
    assert learnt == pytest.approx(np.hypot(sigma, NOISE), rel=0.2)
    # Tops and flats have no part in it.
    assert np.median([each.noise for each in found]) == pytest.approx(NOISE, rel=0.2)


def test_holes_touched_ten_times_worse_are_told(tmp_path: Path) -> None:
    found = sets(tmp_path, "hole", 1e-5, CertificationOptions(drawing=truth()), 10)
    assert {each.assessment.level for each in found} == {"care"}
    assert all("diagonals of the holes" in each.assessment.notes[0] for each in found)
    # Few tell less of it than the planes do of theirs: wider intervals.
    assert all(each.coverage_factor > 2.15 for each in found)


def test_sound_sets_say_nothing_of_it(tmp_path: Path) -> None:
    """A touch in a thousand is called wrong where none is; holes and side are not accused."""
    for options in (PLAIN, STATED):
        found = sets(tmp_path, "hole", 0.0, options, 60)
        assert not any(each.damaged for each in found)
        assert all(each.assessment.level == "good" for each in found if not each.wrong_touches)
        assert sum(bool(each.wrong_touches) for each in found) <= 4
        assert sum(bool(each.probing.by_kind) for each in found) <= 12


def test_one_damaged_pillar_makes_no_noise(tmp_path: Path) -> None:
    for seed in range(10):
        found = certified(tmp_path, moved([4e-5, 0, 0], "hole", "L1", [1]), seed=seed)
        assert found.damaged == ("L1",)
        assert found.probing.of("hole") < 2 * NOISE


def test_a_rough_side_makes_the_direction_unsure(tmp_path: Path) -> None:
    smooth, found = certified(tmp_path), sets(tmp_path, "side", 5e-6, PLAIN)
    assert sum("side is rougher" in " ".join(e.assessment.notes) for e in found) > 0.9 * SETS
    assert np.median([each.heading_std for each in found]) > 3 * smooth.heading_std
    assert 0.8 < standardised(found, slice(0, 2)) < 1.25


def test_a_pillar_beyond_the_others_does_not_count() -> None:
    random = np.random.default_rng(0)
    uneven = 2e-6 * random.standard_normal((200, 2))
    assert scatter_of_holes(uneven).sigma == pytest.approx(2e-6, rel=0.1)
    uneven[:20] += 1e-3
    assert scatter_of_holes(uneven).freedom == 360
    assert scatter_of_holes(uneven).sigma == pytest.approx(2e-6, rel=0.1)
    assert scatter_of_holes(uneven[:4]).freedom == 0
    assert Scatter(0.0, 0).sigma == 0.0


def test_no_feature_is_worth_more_than_the_planes() -> None:
    noise = ProbingNoise(1e-6, 1e-6, 50.0)
    assert noise.beside("hole", Scatter(30 * 1e-14, 30)).of("hole") == 1e-6
    assert noise.beside("hole", Scatter(3 * 1e-8, 3)).of("hole") == 1e-6
    own = noise.beside("hole", Scatter(30 * 1e-10, 30))
    assert own.of("hole") == pytest.approx(1e-5)
    assert (own.of("side"), own.touch, own.freedom_of("hole")) == (1e-6, 1e-6, 30.0)
    assert own.freedom_of("side") == 50.0
