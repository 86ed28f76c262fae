"""Would an unknown more predict rows that were not fitted better?

A model that lacks something has residuals that look like some error. That alone is no reason to
act: only an error whose estimation lowers the errors of rows that were left out is worth a note.
This is the first step of the search of `analysis.model_selection`, with the same folds, on the fit
linearised at its solution, and judged on the validation rows as well where there are any.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.diagnostics.accuracy import (
    TermAccuracy,
    block_residuals,
    fit_own,
    term_accuracies,
)
from suta_calib.diagnostics.cross_validation import CrossValidation, limited_rms
from suta_calib.diagnostics.linearised import LinearModels, ModelFit
from suta_calib.units import Unit

# Share of the squared held-out errors that an error must explain: less changes the RMS by less than
# 5 %, which nobody notices.
WORTH_A_NOTE: Final = 0.1


@dataclass(frozen=True)
class ExtensionGain:
    """What estimating some parameters as well makes of the errors of rows that were left out.

    Attributes:
        names: the parameters.
        before, after: RMS of the held-out errors, none counted beyond its Huber threshold.
        unit: SI unit of these.
    """

    names: tuple[str, ...]
    before: float
    after: float
    unit: Unit


def best_extension(
    linear: LinearModels, validation: Sequence[TermAccuracy], choices: Sequence[Sequence[str]]
) -> ExtensionGain | None:
    """The choice that predicts left-out rows best, if any of them is worth a note.

    Args:
        linear: a converged answer over an arm.
        validation: errors of the held-out terms, which must gain as much.
        choices: names of parameters that the job does not estimate, each set tried alone.

    Returns:
        None where no choice lowers the held-out errors by more than chance and by `WORTH_A_NOTE`.
    """
    job = linear.as_fitted
    best: tuple[CrossValidation, ModelFit] | None = None
    for names in choices:
        fit = linear.fit(names)
        errors = linear.cross_validation(fit)
        if not fit.added or not errors.outdoes(job, share=WORTH_A_NOTE):
            continue
        if (best is None or errors.loss < best[0].loss) and _holds_on(validation, linear, fit):
            best = errors, fit
    if best is None:
        return None
    unit = linear.problem.terms[0].error_unit
    return ExtensionGain(best[1].added, job.rms, best[0].rms, unit)


def _holds_on(validation: Sequence[TermAccuracy], linear: LinearModels, fit: ModelFit) -> bool:
    """Whether the validation rows gain as much as is worth a note, own unknowns fitted anew.

    Folds of few placements resemble the rest; validation rows are of other days and places.
    """
    if not validation:
        return True
    problem, terms = linear.problem, [errors.term for errors in validation]
    x = linear.x.copy()
    x[fit.free] += fit.step
    arm = problem.arm_parameters
    values = fit_own(terms, arm, dict(zip(problem.names, x.tolist(), strict=True)))
    residuals = block_residuals(terms, arm, values)
    zero = [np.zeros_like(residual) for residual in residuals]
    after = limited_rms(term_accuracies(terms, zero, residuals))
    return after**2 < (1.0 - WORTH_A_NOTE) * limited_rms(validation) ** 2
