"""One set of unknowns, fitted and cross-validated, and when it counts as better than another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.analysis.model_selection.cross_validation import CrossValidation
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.solution import Solution

# Of the held-out variance: less is not worth an unknown.
WORTH: Final = 0.02
MOST_FOLDS_MAY_DIFFER: Final = 0.2


@dataclass(frozen=True, eq=False)
class ModelCandidate:
    """One set of unknowns, fitted and cross-validated.

    Attributes:
        name: for people.
        geometry: whether all of the geometry is unknown, not only what the job frees.
        added: names of the parameters that are no geometry.
        solution: fitted to all observations.
        fitted: RMS of the errors that were fitted, m, of the same kind as those held out.
        held_out: errors on what was left out.
    """

    name: str
    geometry: bool
    added: tuple[str, ...]
    solution: Solution
    fitted: float
    held_out: CrossValidation

    @property
    def parameters(self) -> ParameterSet:
        """The arm's unknowns."""
        problem = self.solution.problem
        return ParameterSet(list(problem.parameters.values())[: problem.arm_count])

    def gain_over(self, other: ModelCandidate) -> tuple[float, float]:
        """How much smaller the held-out loss is, and the standard error of that, paired by fold."""
        change = other.held_out.losses - self.held_out.losses
        return float(change.mean()), float(change.std(ddof=1) / np.sqrt(len(change)))

    def outdoes(self, other: ModelCandidate, errors: float = 1.0) -> bool:
        """Whether it predicts what was left out better than another, by the rule of `model_choice`.

        Args:
            other: that one.
            errors: standard errors that the gain must exceed.
        """
        gain, error = self.gain_over(other)
        worse = np.mean(self.held_out.losses >= other.held_out.losses)
        enough = max(errors * error, WORTH * other.held_out.loss)
        return bool(gain > enough and worse <= MOST_FOLDS_MAY_DIFFER)
