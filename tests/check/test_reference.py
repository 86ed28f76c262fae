"""A job that holds dimensions which are off: they are no change, and hide none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from suta_calib import CalibrationJob, SolverOptions, solve
from suta_calib.check import Checker, repaired
from suta_calib.terms import Term
from suta_calib.units import from_deg


@pytest.fixture(scope="module")
def job(repository: Path) -> CalibrationJob:
    """Thirteen unknowns, of an arm whose other dimensions are off too."""
    return CalibrationJob.load(repository / "data" / "suta" / "calibration.yaml")


@pytest.fixture(scope="module")
def checker(job: CalibrationJob) -> Checker:
    return Checker(solve(job.problem(), SolverOptions(starts=1)))


def placements(job: CalibrationJob) -> list[Term]:
    """The first repeats of each placement that was not calibrated."""
    labels = job.validation[0].poses.samples.labels
    return [
        job.validation[0].take(
            np.flatnonzero((labels["placement"] == name) & (labels["repeat"] == "1"))
        )
        for name in dict.fromkeys(labels["placement"].tolist())
    ]


def test_dimensions_that_were_always_off_are_no_change(
    job: CalibrationJob, checker: Checker
) -> None:
    assert checker.reference is not checker.solution
    rows = placements(job)
    assert len(rows) == 5
    for term in rows:
        check = checker.check(term)
        assert check.unchanged
        assert check.assessment.usable
        assert "select: geometric" in " ".join(check.assessment.notes)
        # As calibrated, and not as held against.
        assert check.before[0][1] > 0.6e-3


def test_a_joint_is_named_and_repaired_beside_them(job: CalibrationJob, checker: Checker) -> None:
    off = from_deg(0.3)
    for term in placements(job):
        samples = term.poses.samples
        q = samples.q.copy()
        q[:, 2] += off
        moved = term.over_poses(term.poses.with_samples(replace(samples, q=q)))
        checking = checker.checking(moved)
        check = checking.run()
        assert check.changed[0].what == "joint joint_3"
        value, std = check.changed[0].amounts["rad"]
        assert value == pytest.approx(-off, abs=3 * std)
        assert check.after[0][1] < check.before[0][1]
        repair = repaired(checking, check)
        by = {name: repair.solution.values[name] - v for name, v in repair.before.values.items()}
        assert by["joint_3.offset"] == pytest.approx(-off, abs=3 * std)
        # What the job holds is held.
        assert repair.solution.problem.names == repair.before.problem.names


def test_a_job_of_all_geometry_is_its_own_reference(repository: Path) -> None:
    job = CalibrationJob.load(repository / "data" / "suta" / "calibration_full.yaml")
    checker = Checker(solve(job.problem(), SolverOptions(starts=1)))
    assert checker.reference is checker.solution
