"""Which other reading of the data makes them agree: the mechanism behind `Reinterpretation`.

A sign, a swap, a shift by rows, another unit, an instrument that was moved: each is one change to
the samples or the terms. First every reading is tried on the nominal arm, of which only what is
external is registered: that costs milliseconds. The few best are then fitted like the job itself.
A reading is named only if this fit leaves `Rule.far_better` times less misfit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import SutaCalibError
from suta_calib.geometry.numbers import extent
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.compiled_residual import TermErrors
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.terms import Term
from suta_calib.trust.held_out import robust_level
from suta_calib.trust.hypothesis import Reinterpretation, known_hypotheses
from suta_calib.trust.rule import Rule
from suta_calib.units import Unit

# How a reading is fitted.
QUICK_FIT: Final = SolverOptions(starts=1, max_iterations=25, weights=None, confirm=False)
# Score of a reading that the nominal arm cannot rank: beyond all others but infinity.
UNRANKED: Final = 1e300
# Residuals count as so many times their robust level at most: two of fifteen landmarks exchanged
# must still show, a few gross rows must not decide.
CAP: Final = 10.0


@dataclass(frozen=True)
class Rereading(Displayable):
    """A reading of the data under which they agree.

    Attributes:
        hypothesis: that yielded it.
        description: what would have to be so, as the end of "the data agree if …".
        before: `misfit` of the job's own fit, in the unit of the first block.
        after: the same of the data read in the other way, fitted likewise.
        unit: of both.
    """

    hypothesis: Reinterpretation
    description: str
    before: float
    after: float
    unit: Unit

    @property
    def sentence(self) -> str:
        """What explains the data, and how much better they agree then."""
        return self.hypothesis.sentence(self)


def explaining_reading(solution: Solution, rule: Rule = Rule()) -> Rereading | None:
    """The one change to the data under which they agree far better with the arm.

    Args:
        solution: the job's own fit, of terms over one arm.
        rule: how much better is far better.

    Returns:
        Of the readings that agree best with the nominal arm, the one whose fit is best and far
        better than the present one; of several that are as good, the one that keeps most rows,
        then the simplest. None where there is none.
    """
    if solution.problem.arm is None:
        return None
    # Readings are told apart by what the job gives: wrong ones widen priors until they fit.
    problem = solution.problem.as_given()
    cap = CAP * _level(problem, solution.x)
    present = misfit(problem, solution.x, cap, len(solution.free))
    # What leaves more than three times the noise, and a twentieth of the misfit, is but less wrong.
    small = max(3.0 * problem.assumed_sigmas()[0], 0.05 * present)
    explained = min(present / rule.far_better, small)

    def fitted_misfit(terms: Sequence[Term]) -> float:
        """Misfit of the terms once they are fitted like the job, by all rows of the job."""
        with suppress(SutaCalibError):
            refit = solve(Problem(terms, shifted_parameters(terms, problem)), QUICK_FIT)
            left = misfit(refit.problem, refit.x, cap, len(refit.free))
            # An arm that hardly moves agrees with anything.
            left *= max(_travel(problem.terms) / _travel(terms), 1.0)
            return left / _share_of_rows(terms, problem.terms)
        return math.inf

    causes, worst = list[tuple[float, float, int, Rereading]](), math.inf
    # Fits that are so many times the best one at most are as good.
    equal = 1.2
    for place, candidate in enumerate(_candidates(problem, rule)):
        if causes and candidate.score > worst:
            break
        after = fitted_misfit(candidate.terms)
        if after < explained:
            unit = problem.blocks[0].unit
            cause = Rereading(candidate.hypothesis, candidate.description, present, after, unit)
            listed = UNRANKED if candidate.listed is None else candidate.listed
            share = _share_of_rows(candidate.terms, problem.terms)
            causes.append((-share, listed, place, cause))
            worst = min(worst, equal * candidate.score)
    # Labels that return make several shifts do: that of most rows, and of these the first that
    # is listed, is the simplest.
    best = equal * min((cause.after for *_, cause in causes), default=0.0)
    equals = [cause for cause in causes if cause[-1].after < best]
    # Nothing need be otherwise where the fit that is to be explained was not the best one.
    if not equals or fitted_misfit(problem.terms) < best:
        return None
    return min(equals, key=lambda cause: cause[:3])[-1]


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A reading that is to be fitted.

    Attributes:
        hypothesis, description, terms: what it is.
        score: misfit with the nominal arm, where that can rank it.
        listed: its number among all that are ranked.
    """

    hypothesis: Reinterpretation
    description: str
    terms: Sequence[Term]
    score: float
    listed: float | None = None


def _candidates(problem: Problem, rule: Rule) -> Iterator[_Candidate]:
    """Readings in the order in which they are fitted: `Reinterpretation.tried` says which."""
    ranked = [
        (hypothesis, description, terms)
        for hypothesis in _hypotheses(problem, "ranked")
        for description, terms in hypothesis.readings_by(problem, rule)
    ]
    nominal = Problem(problem.terms)
    registered, cap = nominal.start(), nominal_cap(problem.terms)
    limit = misfit(nominal, registered, cap, len(nominal.names))
    scores = np.array([nominal_misfit(terms, cap) for *_, terms in ranked])
    # A reading explains only the rows that it keeps.
    scores /= [_share_of_rows(terms, problem.terms) for *_, terms in ranked]
    order = np.argsort(scores, kind="stable").tolist()
    # What changes the nominal misfit by less is a convention and no cause, such as a turn of the
    # base. The best few are fitted.
    for k in [k for k in order if scores[k] < 0.999 * limit][:4]:
        hypothesis, description, terms = ranked[k]
        yield _Candidate(hypothesis, description, terms, float(scores[k]), k)
    for tried, score in (("fitted", UNRANKED), ("last", math.inf)):
        for hypothesis in _hypotheses(problem, tried):
            for description, terms in hypothesis.readings_by(problem, rule):
                yield _Candidate(hypothesis, description, terms, score)


def _hypotheses(problem: Problem, tried: str) -> list[Reinterpretation]:
    chosen = [
        h
        for h in known_hypotheses().values()
        if isinstance(h, Reinterpretation) and h.tried == tried and h.applies(problem)
    ]
    return sorted(chosen, key=lambda h: (h.precedence, h.name))


def misfit(problem: Problem, x: FloatArray, cap: float, fitted: int = 0) -> float:
    """Root mean square of a residual component, priors counted with it, in the first block's unit.

    Blocks count in units of their noise, those of the first block being the yardstick. Norms count
    as ``cap`` at most, so that a few gross rows do not decide which reading is right; a parameter
    counts as so many noise levels as it is prior standard deviations off. So many parameters that
    were ``fitted`` followed these residuals.
    """
    return _misfit(problem, x, _scaled_residuals(problem, x), cap, fitted)


def nominal_misfit(terms: Sequence[Term], cap: float) -> float:
    """`misfit` of the nominal arm, with what is external at its closed-form start.

    Infinite where the terms allow no start.
    """
    with suppress(SutaCalibError):
        problem = Problem(terms)
        x, sigmas = problem.start(), problem.assumed_sigmas()
        # Without derivatives: hundreds of readings are asked once each.
        errors = chain(*(TermErrors(term, ())(problem.values(x)) for term in terms))
        residuals = [
            error / block.relative * (sigmas[0] / sigma)
            for block, error, sigma in zip(problem.blocks, errors, sigmas, strict=True)
        ]
        return _misfit(problem, x, residuals, cap, len(x))
    return math.inf


def nominal_cap(terms: Sequence[Term]) -> float:
    """Cap of residuals with the nominal arm, which is far coarser than any fit."""
    nominal = Problem(terms)
    return CAP * _level(nominal, nominal.start())


def _misfit(
    problem: Problem, x: FloatArray, residuals: Sequence[FloatArray], cap: float, fitted: int
) -> float:
    """`misfit` of these residuals, all in the first block's unit."""
    squared = [np.minimum(np.einsum("nd,nd->n", r, r), r.shape[1] * cap**2) for r in residuals]
    pulls = (x - problem.parameters.array("nominal")) ** 2 * problem.prior_precision()
    of_priors = float(pulls.sum()) * problem.assumed_sigmas()[0] ** 2
    count = sum(r.size for r in residuals)
    return math.sqrt((sum(s.sum() for s in squared) + of_priors) / max(count - fitted, count / 10))


def _level(problem: Problem, x: FloatArray) -> float:
    levels = [robust_level(r) ** 2 for r in _scaled_residuals(problem, x)]
    return float(np.sqrt(np.mean(levels)))


def _scaled_residuals(problem: Problem, x: FloatArray) -> list[FloatArray]:
    """Residuals of every block, in the first one's unit by their noise."""
    sigmas = problem.assumed_sigmas()
    lines = problem.linearise(x, sigmas)
    return [line.residual * (sigmas[0] / s) for line, s in zip(lines, sigmas, strict=True)]


def shifted_parameters(terms: Sequence[Term], given: Problem) -> ParameterSet:
    """The arm's parameters, as far from the arm of the terms as they may be from the given one."""
    before, after = given.arm, Problem(terms).arm
    if before is None or after is None:
        return given.arm_parameters
    parameters = []
    for name, p in given.arm_parameters.items():
        by = after.offered[name].nominal - before.offered[name].nominal
        moved = replace(p, nominal=p.nominal + by, lower=p.lower + by, upper=p.upper + by)
        parameters.append(moved if by else p)
    return ParameterSet(parameters)


def _share_of_rows(terms: Sequence[Term], given: Sequence[Term]) -> float:
    """Share of the rows that have a partner."""
    return sum(len(term.poses) for term in terms) / sum(len(term.poses) for term in given)


def _travel(terms: Sequence[Term]) -> float:
    """How far the nominal arm moves its tip, m."""
    return max(extent(np.vstack([term.poses.at({})[1] for term in terms])), 1e-9)
