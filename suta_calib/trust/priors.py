"""Do the data say that an arm is farther off than its priors allow?

Where priors may be widened, the fit has learned by how much, and every standard deviation knows it
(`solver.weights`). Where a job holds them (``fixed: true``), the same is learned beside the fit: a
prior that is far too narrow keeps errors of the arm in the residuals, where no standard deviation
sees them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.options import WeightOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.weights import Learned, learn_weights


@dataclass(frozen=True)
class PriorNotes:
    """Sentences on the priors, by what they mean for the answer."""

    bad: tuple[str, ...] = ()
    care: tuple[str, ...] = ()
    facts: tuple[str, ...] = ()


def judge_priors(solution: Solution) -> PriorNotes:
    """Compare the size of the arm's errors with the priors that a job states."""
    bad, care = _held(solution)
    widened = {} if solution.weights is None else solution.weights.priors
    narrow = {k: v for k, v in widened.items() if v.contradicted and v.value > 1}
    if not narrow:
        return PriorNotes(bad, care)
    sentence = (
        f"The errors of the arm are larger than the job's priors: {_listed(narrow)} times. The fit "
        "has widened the priors by these factors, and every ± includes it."
    )
    # Factor on priors that the fit has widened from which on it is no guess but another unit.
    if max(factor.value for factor in narrow.values()) > 30.0:
        return PriorNotes(bad, (*care, f"{sentence} Check the units of these priors."))
    return PriorNotes(bad, care, (sentence,))


def _held(solution: Solution) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Sentences on priors that the job holds: what must not be used, what must be known."""
    given = solution.problem.as_given()
    held = [p for p in given.arm_parameters.values() if p.prior and p.prior_fixed]
    if not held:
        return (), ()
    free = ParameterSet(replace(p, prior_fixed=False) for p in given.arm_parameters.values())
    problem = Problem(given.terms, free)
    weights = learn_weights(
        problem, solution.x, solution.sigmas, np.asarray(solution.free), WeightOptions()
    )
    narrow = {k: v for k, v in weights.priors.items() if v.contradicted and v.value > 1}
    if not narrow:
        return (), ()
    sentence = (
        "The priors are fixed (fixed: true), but the errors of the arm are larger than they state: "
        f"{_listed(narrow)} times. The part that the priors do not allow stays in the residuals, "
        "and no ± includes it. State wider priors, or leave out fixed: true."
    )
    # Factor on held priors from which on the answer is wrong: simulated arms were then off by more
    # than five of their standard deviations.
    if max(factor.value for factor in narrow.values()) > 4.0:
        return (sentence,), ()
    return (), (sentence,)


def _listed(factors: Mapping[str, Learned]) -> str:
    """Each group with its factor and where that is with 95 %."""
    return ", ".join(
        f"{group} {learned.value:.1f} ({learned.interval[0]:.1f} to {learned.interval[1]:.1f})"
        for group, learned in factors.items()
    )
