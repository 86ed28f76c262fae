"""A fit that everything follows: what is left of the data where all of an arm may be off.

Whether something else explains the data is asked beside all of the geometry, linear about the
answer but robust, so that nothing is solved anew. Distances are looked at touch by touch: a touch
that is off across them changes no distance at first, and all of the touches beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.model.parameters import COUPLING, Family
from suta_calib.solver.information import Rows, scaled_inverse, whitened_rows
from suta_calib.solver.losses import huber, huber_threshold, huber_weight
from suta_calib.solver.problem import Problem
from suta_calib.terms.term import Term
from suta_calib.trust.evidence import LinearFit
from suta_calib.trust.examination import Examination
from suta_calib.trust.extended_problem import known_beforehand, offered_names
from suta_calib.trust.held_out import robust_level
from suta_calib.trust.in_time import columns_of


@dataclass(frozen=True, eq=False)
class ReducedFit:
    """A problem with all of the geometry unknown, where that has followed the data.

    Attributes:
        problem: with what a model may lack among its parameters.
        rows: of it, residuals and weights as all of the geometry leaves them.
        prior: (n,) information that all parameters have beforehand.
        away: (n,) from where that says they are.
        lacking: indices of what a model may lack, by joint and family.
        known: (k,) indices of all that is no geometry: it stays out of the fit.
        spent: how many unknowns the data have told.
    """

    problem: Problem
    rows: Sequence[Rows]
    prior: FloatArray
    away: FloatArray
    lacking: dict[tuple[str, Family], IntArray]
    offered: IntArray
    spent: float

    @property
    def equations(self) -> int:
        """Independent ones."""
        return sum(term.equations() for term in self.problem.terms)

    @property
    def free(self) -> IntArray:
        """(p,) indices of all that follows."""
        return np.setdiff1d(np.arange(len(self.problem.names)), self.offered)

    @cached_property
    def linear(self) -> LinearFit:
        """Of all that follows, as weighed.

        Rows count by their weights alone: that bounds what a step of a robust fit gains from
        below, and rows that are far off still tell what would bring them back.
        """
        sizes = [r.line.residual.shape[1] for r in self.rows]
        weight = [np.repeat(r.line.weight, n) for r, n in zip(self.rows, sizes, strict=True)]
        return LinearFit(
            np.vstack([r.jacobian[:, self.free] for r in self.rows]),
            np.concatenate([whitened(r).reshape(-1) for r in self.rows]),
            self.prior[self.free],
            self.away[self.free],
            np.concatenate(weight),
            independent_rows=self.equations,
        )

    def beside(self, lacking: IntArray, share: float) -> ReducedFit:
        """The same where more of what a model may lack follows, by a share of what is plausible."""
        prior = self.prior.copy()
        prior[lacking] = (share * self.problem.parameters.array("plausible")[lacking]) ** -2.0
        return replace(self, prior=prior, offered=np.setdiff1d(self.offered, lacking))


def everything_follows(answer: Examination) -> ReducedFit:
    """What is left of an answer's data once all of the geometry has followed, within reason.

    Args:
        answer: a converged one, of terms over an arm.
    """
    solution = answer.solution
    problem, x, sigmas = _touch_by_touch(answer)
    arm = problem.arm
    assert arm is not None
    place = {name: k for k, name in enumerate(problem.names)}
    offered = {
        key: np.array([place[n] for n in names if n not in solution.problem.parameters], np.intp)
        for key, names in offered_names(arm).items()
    }
    stays = np.concatenate([*offered.values(), np.zeros(0, dtype=np.intp)])
    # A gain is the travel of an encoder, which is looked for as such. Couplings of neighbours are
    # a cause of their own (`trust.hypotheses.coupling`).
    elsewhere = ("gain", COUPLING)
    lacking = {key: at for key, at in offered.items() if len(at) and key[1] not in elsewhere}
    # The job's priors pull where the job's fit has ended.
    away = np.where(problem.prior_precision() > 0, x - problem.parameters.array("nominal"), 0.0)
    rows = whitened_rows(problem, x, sigmas)
    fit = ReducedFit(problem, rows, known_beforehand(problem), away, lacking, stays, 0.0)
    moved = followed(fit)
    away[moved.free] += moved.step
    return replace(fit, rows=_moved(rows, moved), away=away, spent=moved.spent)


def _moved(rows: Sequence[Rows], by: Followed) -> list[Rows]:
    """Rows with the residuals and weights that a step leaves."""
    moved_rows = []
    for r in rows:
        n, size = r.line.residual.shape
        change = (r.jacobian[:, by.free] @ by.step).reshape(n, size)
        residual = r.line.residual + change * r.line.sigma[:, None]
        squared = np.einsum("nd,nd->n", residual, residual) / r.line.sigma**2
        weight = huber_weight(squared, r.line.view.threshold / r.line.sigma)
        moved_rows.append(replace(r, line=replace(r.line, residual=residual, weight=weight)))
    return moved_rows


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


def widened(rows: Sequence[Rows], velocity: FloatArray) -> list[Rows]:
    """The rows with a column for each of the velocities (6·samples, k) of the tips."""
    return [replace(r, jacobian=np.hstack([r.jacobian, columns_of(r, velocity)])) for r in rows]


def whitened(rows: Rows) -> FloatArray:
    """Residuals (n, d) in units of their noise."""
    return np.asarray(rows.line.residual / rows.line.sigma[:, None])


@dataclass(frozen=True, eq=False)
class Followed:
    """A fit of everything, linear but robust.

    Attributes:
        free: (p,) columns that follow.
        step: (p,) by how much.
        inverse: (p, p) of the curvature.
        left: cost that is left, of rows and priors.
        scatter: that of the rows.
        spent: how many unknowns the data have told.
    """

    free: IntArray
    step: FloatArray
    inverse: FloatArray
    left: float
    scatter: float
    spent: float

    def size(self, fit: ReducedFit, *, turn: bool = False) -> tuple[float, float]:
        """Of what else there was a column for, and its standard deviation.

        Args:
            fit: where it began.
            turn: of six, the length of the last three; else that of the first three, or the number.
        """
        beyond = self.free >= len(fit.problem.names)
        # Rows that share touches say less than their number.
        variance = self.scatter / max(fit.equations - self.spent, 1.0)
        size_of, covariance = self.step[beyond], variance * self.inverse[np.ix_(beyond, beyond)]
        if len(size_of) == 1:
            return float(size_of[0]), float(np.sqrt(covariance[0, 0]))
        part = slice(3, 6) if turn else slice(0, 3)
        size = float(np.linalg.norm(size_of[part]))
        along = size_of[part] / max(size, 1e-300)
        return size, float(np.sqrt(along @ covariance[part, part] @ along))


def followed(fit: ReducedFit, velocity: FloatArray | None = None) -> Followed:
    """Everything follows, with it what moves the tips so; rows are weighed by what is left of them.

    Args:
        fit: where it begins.
        velocity: (6·samples, k) of the tips; None for the geometry alone.
    """
    # Of the cost, below which a round of re-weighing changes nothing, and rounds at most.
    settled = 1e-6
    rounds = 20
    count, more = len(fit.problem.names), 0 if velocity is None else velocity.shape[1]
    wide = fit.rows if velocity is None else widened(fit.rows, velocity)
    free = np.concatenate([fit.free, np.arange(count, count + more)])
    prior, away = (np.concatenate([v, np.zeros(more)])[free] for v in (fit.prior, fit.away))
    rows = [(r.jacobian[:, free], whitened(r), r.line.view.threshold / r.line.sigma) for r in wide]
    # Hardly any row is beyond its threshold: what those lack is taken from the sum over all.
    all_believed = np.diag(prior) + sum(jacobian.T @ jacobian for jacobian, *_ in rows)
    step, left, spent, inverse = np.zeros(len(free)), np.inf, 0.0, np.zeros((len(free),) * 2)
    scatter = np.inf
    for _ in range(rounds):
        matrix, gradient, cost = all_believed.copy(), prior * away, 0.0
        for jacobian, residual, threshold in rows:
            squared = np.sum((residual + (jacobian @ step).reshape(residual.shape)) ** 2, axis=1)
            cost += float(np.sum(huber(squared, threshold)))
            weight = huber_weight(squared, threshold)
            gradient += (residual * weight[:, None]).reshape(-1) @ jacobian
            lost = np.repeat(1.0 - weight, residual.shape[1])
            beyond = np.flatnonzero(lost)
            outer = jacobian[beyond] * np.sqrt(lost[beyond])[:, None]
            matrix -= outer.T @ outer
        pulled = float(prior @ (away + step) ** 2)
        if cost + pulled > (1.0 - settled) * left:
            break
        inverse, left, scatter = scaled_inverse(matrix), cost + pulled, cost
        # Of what is told, without the priors.
        spent = float(np.sum(inverse * matrix)) - float(prior @ inverse.diagonal())
        step = -inverse @ gradient
    return Followed(free, step, inverse, left, scatter, spent)


def gained(fit: ReducedFit, done: Followed, motion: FloatArray) -> FloatArray:
    """(samples,) how much less each costs if its tip has moved so, whether or not it was said to.

    Args:
        fit: where it began.
        done: what followed ``motion`` in some samples.
        motion: (6·samples, k) velocity of every tip.
    """
    beyond = done.free >= len(fit.problem.names)
    gain = np.zeros(len(motion) // 6)
    for r in fit.rows:
        shape = r.line.residual.shape
        by_pose = r.line.by_pose / r.line.sigma[:, None, None]
        columns = r.line.pattern.by_parameters(by_pose, motion)
        before = whitened(r) + (r.jacobian[:, done.free[~beyond]] @ done.step[~beyond]).reshape(
            shape
        )
        after = before + (columns @ done.step[beyond]).reshape(shape)
        threshold = r.line.view.threshold / r.line.sigma
        cost = [huber(np.sum(residual**2, axis=1), threshold) for residual in (before, after)]
        sample = r.line.view.block.samples[:, 0] + r.line.view.first_sample
        np.add.at(gain, sample, cost[0] - cost[1])
    return gain
