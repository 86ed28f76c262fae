"""What is wrong with data that contradict themselves: the same data, read in another way.

A sign, a swap, a shift by rows, another unit, an instrument that was moved: each is one change to
the samples. The change that makes them agree far better with the arm is named as the cause. First
every change is tried on the nominal arm with only what is external registered, which costs
milliseconds; the few best are then fitted like the job itself, so that what is named has been
seen to explain the data.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.diagnostics.held_out import robust_level
from suta_calib.diagnostics.other_depths import other_depths
from suta_calib.diagnostics.other_readings import (
    ReadingOptions,
    elsewhere,
    moved_half_way,
    on_unknown_mounts,
    other_readings,
    other_units,
)
from suta_calib.diagnostics.other_steps import other_steps
from suta_calib.errors import SutaCalibError
from suta_calib.geometry.numbers import extent
from suta_calib.model.parameters import Parameter, ParameterSet
from suta_calib.solver.kernel import TermErrors
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.terms import Term

# A score beyond all others but infinity.
_UNRANKED: Final = 1e300
# How a reading is fitted.
FEW: Final = SolverOptions(starts=1, max_iterations=25, weights=None, confirm=False)
# Misfit of the nominal arm over that of the data as they are, from which on a reading changes it.
SOME: Final = 0.999


@dataclass(frozen=True)
class CauseOptions:
    """How hard to look, and what counts as found.

    Attributes:
        readings: which are tried.
        fitted: alternatives, best first, that are fitted like the job.
        far_better: a reading is the cause where its fit leaves so many times less; chance and a
            few more unknowns do not do that.
        explained: a reading explains the data if it leaves at most so many times the noise that is
            stated or assumed, or one in so many of what was left: what is merely less wrong is no
            cause.
        alike: fits that are so many times the best one at most are as good.
        cap: residuals count as so many times their robust level at most: two of fifteen landmarks
            exchanged must still be seen, a few gross rows must not decide.
    """

    readings: ReadingOptions = field(default_factory=ReadingOptions)
    fitted: int = 4
    far_better: float = 2.0
    explained: tuple[float, float] = (3.0, 20.0)
    alike: float = 1.2
    cap: float = 10.0


@dataclass(frozen=True)
class Cause:
    """A reading of the data under which they agree.

    Attributes:
        sentence: what would have to be so, as the end of "the data agree if …".
        before: `misfit` of the job's own fit, in the unit of the first block.
        after: the same of the data read in the other way, fitted likewise.
    """

    sentence: str
    before: float
    after: float


def find_cause(solution: Solution, options: CauseOptions = CauseOptions()) -> Cause | None:
    """The one change to the samples under which they agree far better with the arm.

    Args:
        solution: the job's own fit, of terms over one arm.
        options: how hard to look.

    Returns:
        Of the readings that agree best with the nominal arm, the one whose fit is best and far
        better than the present one; the simplest of several; None where there is none.
    """
    if solution.problem.arm is None:
        return None
    # Readings are told apart by what the job gives: wrong ones widen priors until they fit.
    problem = solution.problem.as_given()
    cap = options.cap * _level(problem, solution.x)
    present = misfit(problem, solution.x, cap, len(solution.free))
    times, one_in = options.explained
    small = max(times * problem.assumed_sigmas()[0], present / one_in)
    explained = min(present / options.far_better, small)
    # The nominal arm is far coarser than any fit: there residuals are capped by its own level.
    nominal = Problem(problem.terms)
    registered = nominal.start()
    coarse = options.cap * _level(nominal, registered)
    limit = misfit(nominal, registered, coarse, len(nominal.names))
    readings = [*other_readings(problem.terms, options.readings)]
    readings += _in_another_unit(problem.terms, coarse, options)
    scores = np.array([_registered(terms, coarse) for _, terms in readings])
    # A reading explains only the rows that it keeps.
    scores /= [_kept(terms, problem.terms) for _, terms in readings]
    # What leaves the nominal arm as it is (a turn of the base) is a convention and no cause.
    ranked = [k for k in np.argsort(scores, kind="stable") if scores[k] < SOME * limit]
    # What the nominal arm is too coarse to rank: what stands elsewhere, is farther off, or has
    # slipped; and only where that is no cause, for it leaves more open, what was moved.
    tried = chain(
        ((*readings[k], float(scores[k])) for k in ranked[: options.fitted]),
        ((*each, _UNRANKED) for each in elsewhere(problem.terms)),
        ((*each, _UNRANKED) for each in other_depths(solution, FEW)),
        ((*each, _UNRANKED) for each in other_steps(problem.terms)),
        ((*each, _UNRANKED) for each in on_unknown_mounts(problem.terms)),
        ((*each, math.inf) for each in moved_half_way(problem.terms)),
    )

    def left(terms: Sequence[Term]) -> float:
        """Misfit of the terms once they are fitted like the job, by all rows of the job."""
        with suppress(SutaCalibError):
            again = solve(Problem(terms, _about(terms, problem)), FEW)
            after = misfit(again.problem, again.x, cap, len(again.free))
            # An arm that hardly moves agrees with anything.
            after *= max(_travel(problem.terms) / _travel(terms), 1.0)
            return after / _kept(terms, problem.terms)
        return math.inf

    causes, worst = list[tuple[float, Cause]](), math.inf
    order = [sentence for sentence, _ in readings]
    for sentence, terms, score in tried:
        if causes and score > worst:
            break
        order.append(sentence)
        after = left(terms)
        if after < explained:
            causes.append((_kept(terms, problem.terms), Cause(sentence, present, after)))
            worst = min(worst, options.alike * score)
    # Labels that return make several shifts do: that of most rows, and what was tried first, is
    # the simplest.
    best = options.alike * min((cause.after for _, cause in causes), default=0.0)
    alike = [
        (-kept, order.index(cause.sentence), cause) for kept, cause in causes if cause.after < best
    ]
    # Nothing need be otherwise where the fit that is to be explained was not the best one.
    if not alike or left(problem.terms) < best:
        return None
    return min(alike)[-1]


def _in_another_unit(
    terms: Sequence[Term], cap: float, options: CauseOptions
) -> Iterator[tuple[str, tuple[Term, ...]]]:
    """The unit of each length of the arm with which the nominal arm agrees far better than others.

    A length that hardly matters, or had better be none, does as well in the next smaller one.
    """
    for units in other_units(terms):
        scores = [_registered(read, cap) for _, read in units]
        first, *others = sorted(range(len(units)), key=lambda k: scores[k])
        if all(scores[first] * options.far_better < scores[k] for k in others):
            yield units[first]


def misfit(problem: Problem, x: FloatArray, cap: float, fitted: int = 0) -> float:
    """Root mean square of a residual component, priors counted with it, in the first block's unit.

    Blocks count in units of their noise, those of the first block being the yardstick. Norms count
    as ``cap`` at most, so that a few gross rows do not decide which reading is right; a parameter
    counts as so many noise levels as it is prior standard deviations off.

    Args:
        problem: terms and parameters.
        x: (n,) where.
        cap: as many times the first block's unit.
        fitted: how many parameters followed these residuals.
    """
    return _misfit(problem, x, _alike(problem, x), cap, fitted)


def _misfit(
    problem: Problem, x: FloatArray, residuals: Sequence[FloatArray], cap: float, fitted: int
) -> float:
    """`misfit` of these residuals, which are `_alike`."""
    squared = [np.minimum(np.einsum("nd,nd->n", r, r), r.shape[1] * cap**2) for r in residuals]
    pulls = (x - problem.parameters.array("nominal")) ** 2 * problem.prior_precision()
    known = float(pulls.sum()) * problem.assumed_sigmas()[0] ** 2
    count = sum(r.size for r in residuals)
    return math.sqrt((sum(s.sum() for s in squared) + known) / max(count - fitted, count / 10))


def _level(problem: Problem, x: FloatArray) -> float:
    return float(np.sqrt(np.mean([robust_level(r) ** 2 for r in _alike(problem, x)])))


def _alike(problem: Problem, x: FloatArray) -> list[FloatArray]:
    """Residuals of every block, in the first one's unit by their noise."""
    sigmas = problem.assumed_sigmas()
    lines = problem.linearise(x, sigmas)
    return [line.residual * (sigmas[0] / s) for line, s in zip(lines, sigmas, strict=True)]


def _registered(terms: Sequence[Term], cap: float) -> float:
    """Misfit with the nominal arm, and what is external at its closed-form start."""
    with suppress(SutaCalibError):
        problem = Problem(terms)
        x, sigmas = problem.start(), problem.assumed_sigmas()
        # Without derivatives: hundreds of readings are asked once each.
        errors = chain(*(TermErrors(term, ())(problem.values(x)) for term in terms))
        residuals = [
            error / block.relative * (sigmas[0] / s)
            for block, error, s in zip(problem.blocks, errors, sigmas, strict=True)
        ]
        return _misfit(problem, x, residuals, cap, len(x))
    return math.inf


def _about(terms: Sequence[Term], given: Problem) -> ParameterSet:
    """The arm's parameters, as far from the arm of the terms as they may be from the given one."""
    (before, after), found = (given.arm, Problem(terms).arm), list[Parameter]()
    assert before is not None
    assert after is not None
    for name, p in given.arm_parameters.items():
        by = after.offered[name].nominal - before.offered[name].nominal
        moved = replace(p, nominal=p.nominal + by, lower=p.lower + by, upper=p.upper + by)
        found.append(moved if by else p)
    return ParameterSet(found)


def _kept(terms: Sequence[Term], given: Sequence[Term]) -> float:
    """Share of the rows that have a partner."""
    return sum(len(term.poses) for term in terms) / sum(len(term.poses) for term in given)


def _travel(terms: Sequence[Term]) -> float:
    """How far the nominal arm moves its tip, m."""
    return max(extent(np.vstack([term.poses.at({})[1] for term in terms])), 1e-9)
