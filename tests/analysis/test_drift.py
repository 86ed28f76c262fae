"""Errors that grow as parameters walk, against what their derivatives say."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli_job import cli

from suta_calib import CalibrationJob, SolverOptions, solve
from suta_calib.analysis.study import DriftOptions, drift_study
from suta_calib.errors import ParameterError, SamplesError
from suta_calib.solver.solution import Solution
from suta_calib.trust.accuracy import block_residuals

JOB = Path(__file__).parents[2] / "data/thesis/calibration.yaml"
ANGLE, LENGTH = np.radians(0.02), 0.05e-3


@pytest.fixture(scope="module")
def job() -> CalibrationJob:
    return CalibrationJob.load(JOB)


@pytest.fixture(scope="module")
def solution(job: CalibrationJob) -> Solution:
    return solve(job.problem(), SolverOptions(starts=1))


def growth_per_day(job: CalibrationJob, solution: Solution) -> float:
    """Of the mean square, m²: the sum over parameters of rate² times the mean square derivative."""
    arm = solution.problem.arm_parameters
    values = {name: solution.values[name] for name in arm.names}
    total, step = 0.0, 1e-6
    for estimate in solution.arm_estimates.values():
        if estimate.std is None:
            continue
        sides = [
            block_residuals(
                job.validation, arm, values | {estimate.name: values[estimate.name] + by}
            )[0]
            for by in (step, -step)
        ]
        slope = (sides[0] - sides[1]) / (2 * step)
        rate = ANGLE if arm[estimate.name].unit == "rad" else LENGTH
        total += rate**2 * float(np.mean(slope**2))
    return total


def test_the_mean_square_grows_as_the_derivatives_say(job: CalibrationJob, solution: Solution):
    options = DriftOptions(ANGLE, LENGTH, days=100.0, trials=150, steps=2)
    found = drift_study(solution, job.validation, options)
    grown = [point.rms**2 - found.now**2 for point in found.points]
    expected = growth_per_day(job, solution) * np.array([50.0, 100.0])
    np.testing.assert_allclose(grown, expected, rtol=0.25)
    assert found.points[0].low < found.points[0].rms < found.points[0].high
    assert 0 < found.interval <= 100.0
    assert "Calibrate again after" in found.assessment.sentence


def test_parameters_that_hardly_walk_need_no_calibration(
    job: CalibrationJob, solution: Solution
) -> None:
    found = drift_study(solution, job.validation, DriftOptions(1e-9, trials=5, steps=3))
    assert found.interval == np.inf
    assert "of the arms have drifted beyond" in found.assessment.sentence
    assert [point.rms for point in found.points] == pytest.approx([found.now] * 3)


def test_what_cannot_be_studied_is_refused(job: CalibrationJob, solution: Solution) -> None:
    with pytest.raises(SamplesError, match="no validation data"):
        drift_study(solution, (), DriftOptions(ANGLE))
    for bad in ((0.0, 0.0), (-1.0, 0.0), (np.nan, 1.0)):
        with pytest.raises(ParameterError, match="no drift rate of the parameters"):
            DriftOptions(*bad)


def test_the_command_says_when(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    walk = ("--kind", "drift", "--walk-deg", "0.02", "--trials", "20", "--days", "50")
    assert cli("study", JOB, *walk, "--out", tmp_path / "out", "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["walk_deg"] == pytest.approx(0.02)
    assert answer["limit_mm"] == pytest.approx(1.05 * answer["now_mm"])
    assert [point["days"] for point in answer["points"]] == pytest.approx(
        list(np.linspace(50 / 12, 50, 12))
    )
    assert (tmp_path / "out" / "drift.svg").is_file()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--kind", "drift"), "needs --walk-deg or --walk-mm"),
        (("--kind", "drift", "--walk-deg", "0.01", "--sizes", "1-3"), "draws no sets"),
        (("--walk-deg", "0.01"), "are for --kind drift"),
    ],
)
def test_options_that_do_not_go_together(
    options: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli("study", JOB, *options) == 2
    assert said in " ".join(capsys.readouterr().err.split())
