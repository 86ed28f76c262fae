"""What a report needs of a calibration: `suta_calib.job.calibration.CalibrationResult` is one.

Reports stand below jobs in the package, so they describe what they read instead of importing it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from suta_calib.diagnostics.accuracy import Accuracy, TermAccuracy
from suta_calib.measurements.exclusion import Exclusion
from suta_calib.model.arm import ArmModel
from suta_calib.solver.solution import Estimate, Solution


class Observation(Protocol):
    """One row of a job's ``observations`` or ``validation``."""

    @property
    def label(self) -> str:
        """Tells several instruments of one kind apart."""

    @property
    def kind(self) -> str:
        """What was observed."""

    @property
    def exclude(self) -> Exclusion | None:
        """Samples the row leaves out."""

    @property
    def artefact(self) -> Path | None:
        """The artefact's file, where the kind needs one."""

    @property
    def seated(self) -> bool:
        """Whether the artefact's sockets leave the tip anything."""


class Spec(Protocol):
    """A job file."""

    @property
    def path(self) -> Path:
        """The file."""

    @property
    def observations(self) -> Sequence[Observation]:
        """Rows that were fitted, in the order of the terms."""

    @property
    def validation(self) -> Sequence[Observation]:
        """Rows that were not, in the order of the terms."""


class Job(Protocol):
    """A job file brought to life."""

    @property
    def spec(self) -> Spec:
        """The file, typed."""

    @property
    def arm(self) -> ArmModel:
        """The arm at nominal."""


class Result(Protocol):
    """A job, its solution, and how far off the arm is before and after."""

    @property
    def job(self) -> Job:
        """What was asked."""

    @property
    def solution(self) -> Solution:
        """What came out."""

    @property
    def accuracy(self) -> Accuracy:
        """How good it is."""


def arm_estimates(solution: Solution) -> dict[str, Estimate]:
    """Estimates of the arm's parameters, without the terms' own unknowns."""
    names = solution.problem.names[: solution.problem.arm_count]
    return {name: solution.estimates[name] for name in names}


def labelled_terms(result: Result) -> dict[str, list[tuple[str, TermAccuracy]]]:
    """The terms of each set, ``calibration`` and ``validation``, with their job rows' labels."""
    spec, accuracy = result.job.spec, result.accuracy
    sets = {
        "calibration": (spec.observations, accuracy.calibration),
        "validation": (spec.validation, accuracy.validation),
    }
    return {
        name: [(row.label, term) for row, term in zip(rows, terms, strict=True)]
        for name, (rows, terms) in sets.items()
    }
