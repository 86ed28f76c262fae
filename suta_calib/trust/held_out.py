"""Held-out errors against what noise and the parameters' covariance make one expect of them.

For a held-out row with residual r, derivative J by what the calibration estimated and U by what the
held-out rows alone must tell (a new placement's pose),

    r' = S r,  S = I - U U⁺,     Cov(r') = S (σ² I + J C Jᵀ) Sᵀ

with C the covariance of the estimates, and σ what the fitted residuals scatter: noise and what the
model lacks at the postures that were fitted. Errors far beyond it are not chance: the instrument
was moved, it is another unit or another day, or the fit explains its own rows by parameters that
are wrong.

What a model lacks is in the residuals of the fitted rows only as far as these show it. Rows that
were held out, of other postures or another day, err by more: then the covariance of the estimates
is too small to predict them. It is multiplied by one factor, squared, such that the held-out errors
are as large as it predicts, noise taken off (an overdispersion factor; McCullagh and Nelder,
Generalized Linear Models, section 4.5).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import chdtri

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.solver.information import Rows, whitened_rows
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms import Term
from suta_calib.terms.block import Block, grouped
from suta_calib.trust.accuracy import Accuracy, fit_own
from suta_calib.trust.extended_problem import effective_unknowns
from suta_calib.units import Unit

# Intervals whose coverage is reported.
PROBABILITIES: Final = (0.68, 0.95)


def robust_level(residual: FloatArray, share: float = 0.5) -> float:
    """Standard deviation of one component of residuals (n, d) by a quantile of their norms.

    By the median, half of the rows may be grossly wrong: the ``share`` of smaller ones is believed.
    NaN without rows.
    """
    if not len(residual):
        return math.nan
    squared = np.quantile(np.einsum("nd,nd->n", residual, residual), share)
    return float(np.sqrt(squared / normal_squared(residual.shape[1], share)))


def normal_squared(size: int, probability: float = 0.5) -> float:
    """Quantile of the squared norm of ``size`` standard normal components."""
    return float(chdtri(size, 1.0 - probability))


@dataclass(frozen=True)
class Coverage:
    """How many held-out errors are within their predicted intervals.

    Attributes:
        probability: of the intervals.
        share: of the errors that are within, 0 to 1.
        std: its standard error; errors at one place share what is wrong there, and its pose.
    """

    probability: float
    share: float
    std: float


@dataclass(frozen=True, eq=False)
class HeldOutErrors:
    """One block of a held-out term.

    Attributes:
        term: held out.
        name, unit: of the block.
        residual: (n, d) with the calibrated arm, what the rows alone must tell fitted, m or rad.
        predicted: (n,) standard deviation of one component of each: noise, what the model lacks,
            and covariance of the parameters.
        by_parameters: (n,) part of it that is the parameters'.
        fitted: standard deviation of one component of the fitted residuals of the same kind;
            NaN where none was fitted.
        places: (n,) numbers of the places where they were met, whose errors go together.
        clusters: rows that are not repeats of one another.
        placed_anew: `robust_level` of the residuals once everything external (instrument,
            placement, point) is fitted to the held-out rows too.
    """

    term: Term
    name: str
    unit: Unit
    residual: FloatArray
    predicted: FloatArray
    by_parameters: FloatArray
    fitted: float
    places: IntArray
    clusters: int
    placed_anew: float

    @property
    def level(self) -> float:
        """Standard deviation of one component of the held-out residuals, by the median."""
        return robust_level(self.residual)

    @property
    def by_noise(self) -> float:
        """What noise alone makes of a component, by the median, without the parameters."""
        squared = np.maximum(self.predicted**2 - self.by_parameters**2, 0.0)
        return float(np.sqrt(np.median(squared)))

    @property
    def normalised(self) -> FloatArray:
        """Norms (n,) in units of what is predicted."""
        return np.asarray(np.linalg.norm(self.residual, axis=1) / self.predicted)

    @property
    def ratio(self) -> float:
        """How many times the errors are what is predicted, by the median."""
        size = self.residual.shape[1]
        return float(np.sqrt(np.median(self.normalised**2) / normal_squared(size)))

    def ratio_by_joint_noise(self, solution: Solution) -> float:
        """The ratio if what scatters is the joint readings: noise then grows with the reach.

        Args:
            solution: of the fitted terms.
        """
        fitted = [
            reach
            for term, block, reach in _reaches(solution, solution.problem.terms)
            if (term.kind, block.name) == (self.term.kind, self.name)
        ]
        (here,) = (r for _, b, r in _reaches(solution, [self.term]) if b.name == self.name)
        level = float(np.mean(np.concatenate([*fitted]) ** 2)) if fitted else 0.0
        if level == 0.0:
            return self.ratio
        noise = np.maximum(self.predicted**2 - self.by_parameters**2, 0.0)
        predicted = self.by_parameters**2 + noise * here**2 / level
        squared = np.einsum("nd,nd->n", self.residual, self.residual) / predicted
        return float(np.sqrt(np.median(squared) / normal_squared(self.residual.shape[1])))

    @property
    def ratio_std(self) -> float:
        """Relative standard error of the ratio: that of a median over the clusters."""
        return 1.25 / math.sqrt(2.0 * self.clusters * self.residual.shape[1])

    def coverage(self, probability: float) -> Coverage:
        """Of the intervals of that probability."""
        within = self.normalised**2 <= normal_squared(self.residual.shape[1], probability)
        share = float(np.mean(within))
        # The share that was hoped for scatters; the one that was found may do so by chance less.
        off = np.bincount(self.places, within - probability)
        count = np.bincount(self.places)
        independent = probability * (1.0 - probability) * len(within)
        together = float(np.sum((off - count * (share - probability)) ** 2))
        std = math.sqrt(max(independent, together)) / len(within)
        return Coverage(probability, share, std)


def held_out_errors(solution: Solution, accuracy: Accuracy) -> tuple[HeldOutErrors, ...]:
    """Every block of the held-out terms against its prediction.

    Args:
        solution: of the fitted terms.
        accuracy: its errors, held-out ones among them (`assess`).
    """
    validation = [errors.term for errors in accuracy.validation]
    if not validation:
        return ()
    arm = solution.problem.arm_parameters
    held_out = Problem(validation, arm)
    x = np.array([accuracy.held_out_values[name] for name in held_out.names])
    fitted = fitted_levels(solution)
    sorts = [sort_of(term, block) for term in held_out.terms for block in term.blocks]
    assumed = zip(held_out.blocks, sorts, held_out.assumed_sigmas(), strict=True)
    sigmas = [fitted[s] * scatter_unit(b) if s in fitted else sigma for b, s, sigma in assumed]
    rows = whitened_rows(held_out, x, sigmas)
    predicted = iter(_predicted(solution, held_out, rows))
    # With everything external fitted to these rows too.
    arm_values = {name: solution.values[name] for name in arm}
    anew = fit_own(validation, arm, arm_values)
    moved = np.array([anew[name] for name in held_out.names])
    lines = held_out.linearise(moved, sigmas)
    levels = iter([robust_level(r.residual * r.view.block.relative) for r in lines])
    answer = []
    for errors in accuracy.validation:
        term = errors.term
        labels = term.poses.samples.labels
        place = (
            grouped(labels[term.place])[1] if term.place in labels else np.arange(len(term.poses))
        )
        clusters = len(np.unique(term.clusters))
        for block, of in zip(errors.blocks, term.blocks, strict=True):
            deviation, by_parameters = next(predicted)
            answer.append(
                HeldOutErrors(
                    term,
                    block.name,
                    block.unit,
                    _whitened(of, block.residual_after),
                    deviation,
                    by_parameters,
                    fitted.get(sort_of(term, of), math.nan) * scatter_unit(of),
                    place[block.rows[:, 0]],
                    min(clusters, len(block.rows)),
                    next(levels),
                )
            )
    return tuple(answer)


def _whitened(block: Block, residual: FloatArray) -> FloatArray:
    """Residuals (n, d) of a block without what the rows of a sample share."""
    return residual if block.sample_errors is None else block.sample_errors.whitened(residual)


def _reaches(solution: Solution, terms: Sequence[Term]) -> Iterator[tuple[Term, Block, FloatArray]]:
    """How far (n,) one component of each row of every block moves with all joint readings."""
    arm = solution.problem.arm
    turning = [name for name in arm.offsets if arm.offered[name].unit == "rad"] if arm else []
    if not turning or arm is None:
        return
    problem = Problem(terms, arm.select(*turning))
    at = problem.start(solution.values)
    rows = iter(whitened_rows(problem, at, [1.0] * len(problem.blocks)))
    for term in problem.terms:
        for block in term.blocks:
            of = next(rows)
            by_joints = of.jacobian[:, : len(turning)].reshape(*of.line.residual.shape, -1)
            reach = np.sqrt(np.sum(by_joints**2, axis=(1, 2)) / block.size)
            yield term, block, of.line.sigma * reach


def sort_of(term: Term, block: Block) -> tuple[str, str, bool]:
    """What blocks must have in common to scatter alike: rows that state how they do, or do not."""
    return term.kind, block.name, block.relative.size > 1 or block.sample_errors is not None


def scatter_unit(block: Block) -> float:
    """In which blocks of one `sort_of` scatter alike: what rows state, or a pixel of the camera.

    A pixel is a length at the typical distance of the board, which differs from set to set.
    """
    return block.typical * (block.pixel or 1.0)


def fitted_levels(solution: Solution) -> dict[tuple[str, str, bool], float]:
    """What fitted residuals scatter by `sort_of`, what the fit took from them given back.

    Where rows state what they scatter, a factor on that.

    A root mean square, because intervals must hold for tails too; but no row counts as more than
    `FARTHEST` robust levels.
    """
    problem = solution.problem
    lines = iter(problem.linearise(solution.x, solution.sigmas))
    together: dict[tuple[str, str, bool], list[FloatArray]] = {}
    for term in problem.terms:
        for block in term.blocks:
            residual = next(lines).residual / scatter_unit(block)
            together.setdefault(sort_of(term, block), []).append(residual)
    rows = sum(r.size for parts in together.values() for r in parts)
    left = max(rows - effective_unknowns(solution), rows / 10) / rows
    levels = {}
    for sort, parts in together.items():
        residual = np.concatenate(parts)
        # Robust levels beyond which a residual counts no further in the scatter: normal noise has
        # none.
        farthest = residual.shape[1] * (4.0 * robust_level(residual)) ** 2
        squared = np.minimum(np.einsum("nd,nd->n", residual, residual), farthest)
        levels[sort] = max(math.sqrt(squared.mean() / residual.shape[1] / left), 1e-9)
    return levels


def _predicted(
    solution: Solution, held_out: Problem, rows: Sequence[Rows]
) -> list[tuple[FloatArray, FloatArray]]:
    """Of one component of every row of each block (n,): the whole, and the parameters' part."""
    names = solution.problem.names
    estimated = [k for k, name in enumerate(held_out.names) if name in names]
    new = [
        k for k, (name, p) in enumerate(held_out.parameters.items()) if name not in names and p.free
    ]
    at = [names.index(held_out.names[k]) for k in estimated]
    covariance = solution.covariance_seen_by(held_out.terms)[np.ix_(at, at)]
    jacobian = np.vstack([r.jacobian for r in rows])
    own_jacobian = jacobian[:, new]
    inverse = np.linalg.pinv(own_jacobian) if new else np.zeros((0, len(jacobian)))
    by_known = jacobian[:, estimated] - own_jacobian @ (inverse @ jacobian[:, estimated])
    scatter = np.maximum(1.0 - np.einsum("nk,kn->n", own_jacobian, inverse), 0.0)
    spread = np.einsum("nk,kl,nl->n", by_known, covariance, by_known)
    predictions, first = [], 0
    for r in rows:
        n, size = r.line.residual.shape
        mine = slice(first, first + n * size)
        square = r.line.view.block.relative**2
        parts = (v[mine].reshape(n, size) * square for v in (scatter + spread, spread))
        both = [v.mean(axis=1) for v in parts]
        total, part = (r.line.sigma * np.sqrt(np.maximum(v, 1e-12)) for v in both)
        predictions.append((total, part))
        first += n * size
    return predictions


# Widest factor: where it would be larger, the errors are of the held-out rows and not of the
# estimates.
MOST: Final = 5.0


def widening(held_out: Sequence[HeldOutErrors]) -> float:
    """Factor on the standard deviations of an answer that makes them predict held-out errors.

    Returns:
        1 where nothing was held out, where the errors are as predicted, or where wider standard
        deviations do not explain them.
    """
    factor = max((_factor(errors) for errors in held_out), default=1.0)
    return factor if factor <= MOST else 1.0


def _factor(errors: HeldOutErrors) -> float:
    """By which the parameters' standard deviations must be wider; 1 where they need not be."""
    # Times what is predicted from which on a model that lacks something is no explanation.
    unexplained = 3.0
    excess = math.log(max(errors.ratio, 1e-9))
    # Standard errors that held-out errors must be above what is predicted: as for a contradiction.
    if excess < 4.0 * errors.ratio_std or errors.ratio > unexplained:
        return 1.0
    # What fitting the instrument or artefact to the held-out rows removes is no error of the arm.
    if errors.placed_anew < errors.level / unexplained:
        return 1.0
    squared = np.einsum("nd,nd->n", errors.residual, errors.residual)
    by_parameters = errors.by_parameters**2
    by_noise = np.maximum(errors.predicted**2 - by_parameters, 0.0)
    expected = normal_squared(errors.residual.shape[1])

    def median(factor: float) -> float:
        return float(np.median(squared / (by_noise + factor**2 * by_parameters)))

    low, high = 1.0, MOST
    if median(high) > expected:
        return math.inf
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if median(middle) > expected else (low, middle)
    return high
