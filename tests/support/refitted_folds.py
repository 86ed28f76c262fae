"""Cross-validation by solving every fold anew: what the linearised one must agree with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from suta_calib.errors import SamplesError
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import Term
from suta_calib.trust.accuracy import assess
from suta_calib.trust.cross_validation import (
    CrossValidation,
    Fold,
    FoldErrors,
    limited_errors,
)


def cross_validate(
    every: Sequence[Term],
    folds: Sequence[Fold],
    parameters: ParameterSet,
    noise: Sequence[float],
    options: SolverOptions = SolverOptions(starts=1),
) -> CrossValidation | None:
    """Solve each fold's training part, and look at what it makes of the rest; None if one fails.

    Errors are counted in the ``noise`` of each block of all terms, the same for every candidate.
    """
    errors = []
    for fold in folds:
        training = [term.take(~out) for term, out in zip(every, fold.samples, strict=True)]
        try:
            solution = solve(Problem(training, parameters), options)
        except SamplesError:
            return None
        if not solution.converged:
            return None
        each = iter(noise)
        levels = [[next(each) for _ in term.blocks] for term in training]
        squares, count, lengths = 0.0, 0, []
        terms = assess(solution, list(fold.held_out.values())).validation
        for k, term in zip(fold.held_out, terms, strict=True):
            for found, block, level in zip(term.blocks, term.term.blocks, levels[k], strict=True):
                limited = limited_errors(found, block.noise.huber)
                squares += float(np.sum((limited / level) ** 2))
                count += found.residual_after.size
                if found is term.blocks[0] and term.term.kind == terms[0].term.kind:
                    lengths.append(limited)
        errors.append(FoldErrors(squares, count, np.concatenate(lengths)))
    return CrossValidation(tuple(errors))
