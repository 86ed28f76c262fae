"""Rows of an instrument that state how well each coordinate was seen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_job import Capture, answer, cli, simulated, write_simulated_job
from scipy.optimize import least_squares
from simulated import Spread, dh_parameters
from terms_cases import SIGMA, scene

from suta_calib.analysis.study.trial import resimulated
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements import Samples, write_samples
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import ArmPoses, MeasuredPoses, Noise, TrackedPoint
from suta_calib.trust.accuracy import block_residuals

CASE = "tracked_point that states its noise"


def stated(count: int, seed: int = 3) -> np.ndarray:
    """Standard deviations (count, 3) from 10 µm to 1 mm."""
    return np.asarray(10 ** np.random.default_rng(seed).uniform(-5, -3, (count, 3)))


def registration(count: int = 12) -> TrackedPoint:
    """Points seen by an instrument, with noise as they state it."""
    made = TrackedPoint.simulate(count, seed=1)
    sigma = stated(count)
    noise = sigma * np.random.default_rng(4).standard_normal((count, 3))
    samples = made.term.poses.samples
    seen = replace(samples, position=made.seen[1] + noise, position_sigma=sigma)
    return TrackedPoint(MeasuredPoses(*made.poses, seen))


def test_a_fit_is_weighted_least_squares() -> None:
    term = registration()
    solution = solve(Problem([term], ParameterSet()))
    points, samples = term.poses.at({})[1], term.poses.samples

    def weighted(x: np.ndarray) -> np.ndarray:
        off = points @ rotation_from_vector(x[3:]).T + x[:3] - samples.position
        return np.asarray((off / samples.position_sigma).ravel())

    found = least_squares(weighted, solution.problem.start(), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    np.testing.assert_allclose(solution.x, found.x, rtol=0, atol=1e-9)


def test_errors_are_those_of_the_points_whatever_they_state() -> None:
    term = registration()
    solution = solve(Problem([term], ParameterSet()))
    (errors,) = block_residuals([term], ParameterSet(), solution.values)
    ideal = term.observed(solution.values, term.poses).position
    np.testing.assert_allclose(errors, ideal - term.poses.samples.position, atol=1e-12)


def arms_error(term: TrackedPoint) -> float:
    """Root mean square error of what is told of the arm's geometry, in units of its scales."""
    solution = solve(Problem([term], dh_parameters(scene(CASE).arm)))
    truth, parameters = scene(CASE).truth, solution.problem.parameters
    told = [e for e in solution.estimates.values() if e.std and not e.given and e.name in truth]
    assert len(told) >= 5
    errors = [(e.value - truth[e.name]) / parameters[e.name].scale for e in told]
    return float(np.sqrt(np.mean(np.square(errors))))


def test_the_arm_is_found_better_than_without_weights() -> None:
    s, better = scene(CASE), []
    for samples in s.samples(SIGMA, seed=2, trials=8):
        unweighted = replace(samples, position_sigma=None)
        weighted, plain = (
            arms_error(TrackedPoint(ArmPoses(s.arm, each))) for each in (samples, unweighted)
        )
        better.append(weighted / plain)
    # Standard deviations uniform in their logarithm over a factor of 9: half is what to expect.
    assert np.exp(np.mean(np.log(better))) < 0.75


@pytest.mark.parametrize("times", [0.5, 4.0])
def test_the_level_is_a_factor_on_what_the_rows_state(times: float) -> None:
    s = scene(CASE)
    assert s.stated is not None
    typical = float(np.exp(np.log(s.stated).mean()))
    (samples,) = s.samples(Spread(times * typical), seed=5)
    term = TrackedPoint(ArmPoses(s.arm, samples))
    solution = solve(Problem([term], dh_parameters(s.arm)))
    assert solution.noise[0] / typical == pytest.approx(times, rel=0.25)
    # Standard deviations of the answer follow the level found, not the one stated.
    fixed = TrackedPoint(ArmPoses(s.arm, samples), Noise(times * typical, fixed=True))
    known = solve(Problem([fixed], dh_parameters(s.arm)))
    np.testing.assert_allclose(known.x, solution.x, rtol=0, atol=1e-8)


def test_one_sigma_for_all_rows_changes_nothing() -> None:
    s = scene("tracked_point")
    (samples,) = s.samples(SIGMA, seed=6)
    even = replace(samples, position_sigma=np.full((len(samples), 3), 2e-4))
    plain, weighted = (
        solve(Problem([TrackedPoint(ArmPoses(s.arm, each))], dh_parameters(s.arm)))
        for each in (samples, even)
    )
    np.testing.assert_allclose(weighted.x, plain.x, rtol=0, atol=1e-8)
    assert weighted.noise[0] == pytest.approx(plain.noise[0], rel=1e-3)


def test_what_is_simulated_again_scatters_as_the_rows_state() -> None:
    s = scene(CASE)
    term = TrackedPoint(ArmPoses(s.arm, s.samples()[0]))
    assert term.typical_sigma is not None
    levels = [2.0 * term.typical_sigma]
    (again,) = resimulated([term], s.truth | own_truth(term), levels, np.random.default_rng(9))
    off = again.poses.samples.position - s.position
    relative = (off / s.stated).ravel()
    assert np.std(relative) == pytest.approx(2.0, rel=0.3)
    # Fine rows and coarse ones alike.
    fine = s.stated.ravel() < np.median(s.stated)
    assert np.std(relative[fine]) == pytest.approx(np.std(relative[~fine]), rel=0.4)


def own_truth(term: TrackedPoint) -> dict[str, float]:
    """Where the instrument stands, from exact rows."""
    x = term.start(*term.poses.at(scene(CASE).truth))
    return {p.name: float(v) for p, v in zip(term.own_parameters, x, strict=True)}


def with_stated(samples: Samples, sigma: np.ndarray, seed: int) -> Samples:
    """With more noise, as it is stated."""
    assert samples.position is not None
    noise = sigma * np.random.default_rng(seed).standard_normal(sigma.shape)
    return replace(samples, position=samples.position + noise, position_sigma=sigma)


@pytest.fixture
def job(tmp_path: Path, suta_urdf: Path) -> Path:
    """Fitted rows of 0.05 to 1 mm; all of the held-out ones of 2 mm."""
    path = write_simulated_job(tmp_path / "job", suta_urdf)
    arm = ArmModel.from_urdf(path.parent / "arm.urdf", "tip")
    spread = np.clip(stated(80), 5e-5, None)
    fitted = with_stated(simulated(arm, 80, 1), spread, 7)
    held_out = with_stated(simulated(arm, 40, 2), np.full((40, 3), 2e-3), 8)
    write_samples(path.parent / "calibration" / "a.csv", fitted)
    write_samples(path.parent / "validation" / "a.csv", held_out)
    return path


def test_coarser_held_out_rows_are_no_surprise(job: Path) -> None:
    content = answer("calibrate", job, "--out", job.parent / "out")
    (row,) = content["held_out"]
    assert row["predicted_std"] == pytest.approx(2e-3, rel=0.3)
    assert 0.8 < row["std"] / row["predicted_std"] < 1.2
    rms = content["metrics"]["validation"]["after"]["rms_mm"]
    assert rms == pytest.approx(2 * np.sqrt(3), rel=0.2)


def test_a_blank_cell_is_refused_by_name(job: Path, capsys: Capture) -> None:
    rows = (job.parent / "calibration" / "a.csv").read_text().splitlines()
    cells = rows[3].split(",")
    cells[rows[0].split(",").index("sigma_y")] = ""
    (job.parent / "calibration" / "a.csv").write_text(
        "\n".join([*rows[:3], ",".join(cells)]) + "\n"
    )
    assert cli("calibrate", job) == 2
    assert "a.csv:4: column 'sigma_y': found ''" in capsys.readouterr().err


def test_files_of_which_some_state_nothing_are_refused(
    job: Path, suta_urdf: Path, capsys: Capture
) -> None:
    arm = ArmModel.from_urdf(suta_urdf, "tip")
    write_samples(job.parent / "calibration" / "b.csv", simulated(arm, 10, 3))
    assert cli("calibrate", job) == 2
    assert "b.csv: found no column 'sigma'" in capsys.readouterr().err


def test_every_answer_about_the_job_is_given(job: Path) -> None:
    """Leaving out, simulating again and dividing up the errors know of the weights."""
    assert answer("calibrate", job, "--out", job.parent / "out")["status"] == "converged"
    for command in (("outliers",), ("study", "--trials", "3", "--sizes", "40"), ("budget",)):
        assert answer(command[0], job, *command[1:])["verdict"]["usable"]
