"""A rolling shutter: each corner of a picture is of its own moment."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_job import answer, printed, refused

from suta_calib import CalibrationJob, SolverOptions, solve
from suta_calib.errors import ParameterError
from suta_calib.solver import Ipopt
from suta_calib.solver.compiled_residual import TermErrors, term_residuals
from suta_calib.solver.problem import Problem
from suta_calib.terms.line_delay import LineDelay, rolled

SIMULATION = """
arm: {urdf: URDF, tip: hand}
seed: 1
posture_deg: {joint_2: 20, joint_3: 60, joint_5: 100}
errors:
  - {select: ["joint_[2-5].offset"], std_deg: 0.4}
noise: {corner_px: 0.1, encoder_bits: 20}
sets:
  fitted:
    kind: camera_view
    board: BOARD
    camera: CAMERA
    samples: 40
    motion: {step_ms: 300, time_offset_ms: -35, speed_deg_per_s: 20}
    line_delay_us: 30
    camera_pose: {position_mm: [30, -60, 40], rotation_rpy_deg: [2, -3, 90]}
    board_pose: {position_mm: [450, 0, 10], rotation_rpy_deg: [0.5, -0.5, 20]}
"""
JOB = """
arm: {urdf: URDF, tip: hand}
parameters:
  - {select: ["joint_[2-5].offset"], prior_deg: 1}
observations:
  - {kind: camera_view, samples: fitted/*.csv, corners: corners/fitted.csv, board: BOARD,
     camera: CAMERA, time_offset_ms: {bound: 100}, line_delay_us: {bound: 100}}
"""
OFFSET, DELAY = "time_offset[default]", "line_delay[default]"


def filled(text: str, repository: Path) -> str:
    folder = repository / "examples/camera_on_arm"
    for word, name in (("URDF", "arm.urdf"), ("BOARD", "board.yaml"), ("CAMERA", "camera.yaml")):
        text = text.replace(word, str(folder / name))
    return text


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory, repository: Path) -> Path:
    folder = tmp_path_factory.mktemp("rolling")
    (folder / "simulation.yaml").write_text(filled(SIMULATION, repository))
    printed("simulate", folder / "simulation.yaml", "--out", folder)
    (folder / "calibration.yaml").write_text(filled(JOB, repository))
    return folder / "calibration.yaml"


@pytest.fixture(scope="module")
def problem(job: Path) -> Problem:
    loaded = CalibrationJob.load(job)
    # A few corners of a few pictures suffice.
    (term,) = loaded.observations
    return Problem([term.take(np.arange(4, 9))], loaded.parameters)


@pytest.fixture
def at(problem: Problem) -> Any:
    x = problem.start()
    x[problem.names.index(OFFSET)], x[problem.names.index(DELAY)] = -0.034, 2.5e-5
    return x


def test_derivatives_are_right(problem: Problem, at: Any) -> None:
    sigmas = problem.assumed_sigmas()
    _, gradient, _ = problem.evaluation.cost_gradient_hessian(at, sigmas)
    for place, name in enumerate(problem.names):
        step = 1e-9 if name == DELAY else 1e-6
        costs = []
        for change in (step, -step):
            moved = at.copy()
            moved[place] += change
            costs.append(problem.evaluation.cost(moved, sigmas))
        expected = (costs[0] - costs[1]) / (2 * step)
        assert gradient[place] == pytest.approx(expected, rel=1e-4, abs=1e-3 * abs(gradient).max())


def test_every_way_to_evaluate_it_is_the_same(problem: Problem, at: Any) -> None:
    (term,), values = problem.terms, problem.values(at)
    (line,) = problem.linearise(at, problem.assumed_sigmas())
    names = problem.names[: problem.arm_count]
    np.testing.assert_allclose(term_residuals(term, values)[0], line.residual, atol=1e-12)
    np.testing.assert_allclose(TermErrors(term, names)(values)[0], line.residual, atol=1e-12)
    # It matters: 29 ms of a moving camera.
    sharp = values | {DELAY: 0.0}
    assert np.abs(term_residuals(term, sharp)[0] - line.residual).max() > 1e-4
    shift = np.full(term.poses.samples.q.shape, 0.01)
    residual = line.residual.copy()
    with problem.evaluation.table.shifted([shift]):
        (moved,) = problem.linearise(at, problem.assumed_sigmas())
        np.testing.assert_allclose(
            TermErrors(term, names)(values, shift)[0], moved.residual, atol=1e-12
        )
    (after,) = problem.linearise(at, problem.assumed_sigmas())
    np.testing.assert_allclose(after.residual, residual, atol=1e-15)


def test_ipopt_with_exact_second_derivatives_agrees(problem: Problem) -> None:
    found = [
        solve(problem, SolverOptions(starts=1, solver=solver, weights=None))
        for solver in (Ipopt(), Ipopt(exact=True))
    ]
    np.testing.assert_allclose(found[0].x, found[1].x, rtol=1e-6, atol=1e-8)


def test_time_offset_and_line_delay_are_found(job: Path) -> None:
    result = answer("calibrate", job)
    for name, truth, near in ((OFFSET, -0.035, 5e-4), (DELAY, 30e-6, 1e-6)):
        found = result["parameters"][name]
        assert abs(found["value"] - truth) < min(near, 3.5 * found["std"])
    assert result["metrics"]["calibration"]["after"]["rms_px"] < 0.16
    (delay,) = result["line_delays"].values()
    assert delay["line_delay_us"] == pytest.approx(30.0, abs=1.0)


def test_a_given_line_delay_is_not_estimated(job: Path) -> None:
    text = job.read_text()
    given = job.with_name("given.yaml")
    given.write_text(text.replace("line_delay_us: {bound: 100}", "line_delay_us: 30"))
    (term,) = CalibrationJob.load(given).observations
    assert [(p.nominal, p.free) for p in term.unknowns if p.name == DELAY] == [(30e-6, False)]


def test_what_it_would_see_is_what_was_simulated(job: Path) -> None:
    loaded = CalibrationJob.load(job)
    (term,) = loaded.observations
    solution = solve(Problem([term], loaded.parameters), SolverOptions(starts=1))
    seen, ideal = term.poses.samples.pixels, term.observed(solution.values, term.poses).pixels
    assert seen is not None
    assert ideal is not None
    assert np.nanmax(np.abs(seen - ideal)) < 0.6
    sharp = term.observed(solution.values | {DELAY: 0.0}, term.poses).pixels
    assert sharp is not None
    assert np.nanmax(np.abs(seen - sharp)) > 0.7


def test_what_cannot_be_is_refused(job: Path) -> None:
    text, wrong = job.read_text(), job.with_name("wrong.yaml")
    for before, after, said in (
        ("line_delay_us: {bound: 100}", "line_delay_us: 33000", "it is the time of one row"),
        ("line_delay_us: {bound: 100}", "line_delay_us: {value: 30}", "no bound and no prior"),
        (" time_offset_ms: {bound: 100},", "", "expected time_offset_ms beside it"),
    ):
        assert before in text
        wrong.write_text(text.replace(before, after))
        assert said in refused("calibrate", wrong)
    with pytest.raises(ParameterError, match="LineDelay: value"):
        LineDelay(0.03)


def test_a_row_is_seen_when_the_shutter_is_there() -> None:
    def falling(time: float) -> Any:
        return np.array([[[5.0, 100.0 + 2000.0 * time]]])

    ((pixel,),) = rolled(falling, 1e-5, 1000.0)
    # v = 100 + 2000 · 1e-5 v.
    assert pixel[1] == pytest.approx(100.0 / 0.98, abs=1e-6)
    assert replace(LineDelay(3e-5), bound=1e-5).longest == pytest.approx(4e-5)
