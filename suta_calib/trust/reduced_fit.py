"""A fit that everything follows: what is left of the data where all of an arm may be off.

Whether something else explains the data is asked beside all of the geometry, linear about the
answer but robust, so that nothing is solved anew. Distances are looked at touch by touch: a touch
that is off across them changes no distance at first, and all of the touches beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.model.parameters import COUPLING, Family
from suta_calib.solver.information import Rows, whitened_rows
from suta_calib.solver.losses import huber_threshold
from suta_calib.solver.problem import Problem
from suta_calib.terms.term import Term
from suta_calib.trust.examination import (
    Examination,
    by_motion,
    chain_of_rows,
    clusters_of_rows,
    samples_of,
)
from suta_calib.trust.extended_problem import known_beforehand, offered_beside
from suta_calib.trust.held_out import robust_level
from suta_calib.trust.linear_fit import LinearFit, RobustStep


@dataclass(frozen=True, eq=False)
class ReducedFit:
    """A problem with all of the geometry unknown, where that has followed the data.

    Attributes:
        problem: with what a model may lack among its parameters.
        rows: of it.
        jacobian: (m, n) whitened, by all parameters.
        lacking: indices of what a model may lack, by joint and family.
        linear: of all that follows, as weighed. Rows count by their weights alone: that bounds what
            a step of a robust fit gains from below, and rows that are far off still tell what
            would bring them back.
        spent: how many unknowns the data have told.
    """

    problem: Problem
    rows: Sequence[Rows]
    jacobian: FloatArray
    lacking: dict[tuple[str, Family], IntArray]
    linear: LinearFit
    spent: float

    def columns(self, velocity: FloatArray) -> FloatArray:
        """(m, k) how whitened rows change with velocities (6·samples, k) of the tips."""
        return by_motion(self.rows, velocity)

    def followed(self, velocity: FloatArray) -> RobustStep:
        """Everything follows what moves the tips so (6·samples, k)."""
        return self.linear.beside(self.columns(velocity)).robust

    def gained(self, done: RobustStep, velocity: FloatArray) -> FloatArray:
        """(samples,) how much less each costs if its tip has moved so, in whatever samples it did.

        Args:
            done: what followed the ``velocity`` in some samples.
            velocity: (6·samples, k) of every tip.
        """
        more = velocity.shape[1]
        before = self.linear.residual + self.linear.jacobian @ done.step[:-more]
        after = before + self.columns(velocity) @ done.step[-more:]
        costs = [self.linear.costs(residual) for residual in (before, after)]
        gain, sample = np.zeros(len(velocity) // 6), samples_of(self.rows)
        np.add.at(gain, sample[self.linear.firsts], costs[0] - costs[1])
        return gain


def everything_follows(answer: Examination) -> ReducedFit:
    """What is left of an answer's data once all of the geometry has followed, within reason."""
    solution = answer.solution
    problem, x, sigmas = _touch_by_touch(answer)
    arm = problem.arm
    assert arm is not None
    place = {name: k for k, name in enumerate(problem.names)}
    offered = {
        key: np.array([place[n] for n in names if n not in solution.problem.parameters], np.intp)
        for key, names in offered_beside(problem).items()
    }
    stays = np.concatenate([*offered.values(), np.zeros(0, dtype=np.intp)])
    follows = np.setdiff1d(np.arange(len(x)), stays)
    # A gain is the travel of an encoder, which is looked for as such. Couplings of neighbours are
    # a cause of their own (`trust.hypotheses.coupling`).
    elsewhere = ("gain", COUPLING, "cable")
    lacking = {key: at for key, at in offered.items() if len(at) and key[1] not in elsewhere}
    # The job's priors pull where the job's fit has ended.
    away = np.where(problem.prior_precision() > 0, x - problem.parameters.array("nominal"), 0.0)
    rows = whitened_rows(problem, x, sigmas)
    equations = sum(term.equations() for term in problem.terms)
    prior, chain = known_beforehand(problem), chain_of_rows(problem, rows)
    err_alike = any(len(np.unique(t.clusters)) < len(t.poses) for t in problem.terms)
    clusters = clusters_of_rows(problem, rows) if err_alike else None
    fit = LinearFit.of_rows(
        rows, prior, away, independent_rows=equations, chain=chain, clusters=clusters
    )
    settled = fit.only(follows).robust
    return ReducedFit(problem, rows, fit.jacobian, lacking, settled.fit, settled.spent)


def _touch_by_touch(answer: Examination) -> tuple[Problem, FloatArray, Sequence[float]]:
    """The problem beside a solution, its point and noise levels, of single touches throughout."""
    solution, problem, x = answer.solution, answer.problem, answer.x
    singles = [_single_touches(term) for term in problem.terms]
    if all(a is b for a, b in zip(singles, problem.terms, strict=True)):
        return problem, x, solution.sigmas
    other = Problem(singles, problem.arm_parameters)
    # The arm as the solution has it, whose kinematics are there already.
    values, arm_values = problem.values(x), solution.values
    for term in singles:
        values = term.start_values(arm_values) | values
    there = np.array([values[name] for name in other.names])
    levels_of = {
        id(view.block): (sigma, view.threshold)
        for view, sigma in zip(problem.evaluation.views, solution.sigmas, strict=True)
    }
    levels, limits = list[float](), list[float]()
    for line in other.linearise(there, other.assumed_sigmas()):
        block = line.view.block
        level = max(robust_level(line.residual), 1e-9)
        sigma, limit = levels_of.get(id(block), (level, level * huber_threshold(block.size)))
        levels.append(sigma)
        limits.append(limit)
    return other.with_thresholds(limits), there, levels


def _single_touches(term: Term) -> Term:
    """Those of a term; of very many, those at some of the places, evenly chosen."""
    # Touches of distances that are looked at one by one: each set of them has a pose of its own.
    most_touches = 1_500
    single = term.single_touches()
    if single is term or len(single.poses) <= most_touches:
        return single
    _, place = single.places
    return single.take(place % -(-len(place) // most_touches) == 0)
