"""Checks of a measured arm: a ball in two sockets, at seven places that were not calibrated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from suta_calib import CalibrationJob, SolverOptions, solve
from suta_calib.check import Checker, repaired
from suta_calib.units import from_deg

OFF = 3e-3
# What takes its place, where rows cannot tell a link's end from the ball, m and rad.
LEFT = 1.3 * OFF, from_deg(0.5)


@pytest.fixture(scope="module")
def job(repository: Path) -> CalibrationJob:
    return CalibrationJob.load(repository / "examples" / "panda_sockets" / "calibration.yaml")


def test_what_the_model_lacks_elsewhere_is_no_change(job: CalibrationJob) -> None:
    """The validation rows said that errors are twice those predicted at other places."""
    result = job.run()
    assert result.solution.widening > 1.5
    checker, (rows,) = Checker(result.solution), job.validation
    places = rows.poses.samples.labels["placement"]
    for place in dict.fromkeys(places.tolist()):
        mine = np.flatnonzero(places == place)
        assert checker.check(rows.take(mine)).unchanged
        for first in range(0, len(mine) - 9, 10):
            assert checker.check(rows.take(mine[first : first + 10])).unchanged


@pytest.fixture(scope="module")
def checker(job: CalibrationJob) -> Checker:
    """Without what validation rows say."""
    return Checker(solve(job.problem(), SolverOptions(starts=1)))


@pytest.mark.parametrize("name", ["ball_link.x", "panda_joint7.x"])
def test_a_ball_tells_of_no_turn_of_itself(
    job: CalibrationJob, checker: Checker, name: str
) -> None:
    """It was 3 mm elsewhere when it was calibrated; its turns, and a link's, move no touch."""
    true = checker.solution.values
    moved = Checker(checker.solution, {**true, name: true[name] + OFF}, checker.estimated)
    (rows,) = job.validation
    mine = np.flatnonzero(rows.poses.samples.labels["placement"] == "mid_right")
    checking = moved.checking(rows.take(mine))
    check = checking.run()
    assert not check.unchanged
    (before,), (after,) = check.before, check.after
    assert after[1] < 0.6 * before[1]
    repair = repaired(checking, check)
    parameters = repair.solution.problem.parameters
    for again in repair.names:
        now = repair.solution.values[again]
        if again in ("ball_link.rx", "ball_link.ry", "ball_link.rz"):
            assert now == parameters[again].nominal
        else:
            left = LEFT[parameters[again].unit == "rad"]
            assert now == pytest.approx(true.get(again, parameters[again].nominal), abs=left)
