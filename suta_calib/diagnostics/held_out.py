"""Held-out errors against what noise and the parameters' covariance make one expect of them.

For a held-out row with residual r, derivative J by what the calibration estimated and U by what the
held-out rows alone must tell (a new placement's pose),

    r' = S r,  S = I - U U⁺,     Cov(r') = S (σ² I + J C Jᵀ) Sᵀ

with σ the noise that the fitted residuals show and C the covariance of the estimates. Errors far
beyond it are not chance: the instrument was moved, it is another unit or another day, or the fit
explains its own rows by parameters that are wrong.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from suta_calib.arrays import FloatArray
from suta_calib.diagnostics.accuracy import fit_own
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.information import Rows, whitened_rows
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms import Block, Term
from suta_calib.units import Unit


def robust_level(residual: FloatArray) -> float:
    """Standard deviation of one component of residuals (n, d) by the median of their norms.

    Half of the rows may be grossly wrong. NaN without rows.
    """
    if not len(residual):
        return math.nan
    squared = np.median(np.einsum("nd,nd->n", residual, residual))
    return float(np.sqrt(squared / median_squared(residual.shape[1])))


def median_squared(size: int) -> float:
    """Median of the squared norm of ``size`` standard normal components."""
    return float(2.0 * gammaincinv(size / 2.0, 0.5))


@dataclass(frozen=True, eq=False)
class HeldOutErrors:
    """One block of a held-out term.

    Attributes:
        term: held out.
        name, unit: of the block.
        residual: (n, d) with the calibrated arm, what the rows alone must tell fitted, m or rad.
        predicted: (n,) standard deviation of one component of each, from noise and covariance.
        fitted: standard deviation of one component of the fitted residuals of the same kind;
            NaN where none was fitted.
        witnesses: rows that are not repeats of one another.
        placed_anew: `robust_level` of the residuals once everything external (instrument,
            placement, point) is fitted to the held-out rows too.
    """

    term: Term
    name: str
    unit: Unit
    residual: FloatArray
    predicted: FloatArray
    fitted: float
    witnesses: int
    placed_anew: float

    @property
    def level(self) -> float:
        """Standard deviation of one component of the held-out residuals, by the median."""
        return robust_level(self.residual)

    @property
    def normalised(self) -> FloatArray:
        """Norms (n,) in units of what is predicted."""
        return np.asarray(np.linalg.norm(self.residual, axis=1) / self.predicted)

    @property
    def ratio(self) -> float:
        """How many times the errors are what is predicted, by the median."""
        size = self.residual.shape[1]
        return float(np.sqrt(np.median(self.normalised**2) / median_squared(size)))

    @property
    def ratio_std(self) -> float:
        """Relative standard error of the ratio: that of a median over the witnesses."""
        return 1.25 / math.sqrt(2.0 * self.witnesses * self.residual.shape[1])

    def coverage(self, probability: float) -> float:
        """Share of the rows whose error is within the predicted interval of that probability."""
        size = self.residual.shape[1]
        within = float(2.0 * gammaincinv(size / 2.0, probability))
        return float(np.mean(self.normalised**2 <= within))


def held_out_errors(solution: Solution, validation: Sequence[Term]) -> tuple[HeldOutErrors, ...]:
    """Every block of the held-out terms against its prediction.

    Args:
        solution: of the fitted terms.
        validation: terms over the same arm.
    """
    if not validation:
        return ()
    problem = solution.problem
    arm = problem.arm_parameters
    held_out = Problem(validation, arm)
    found = fit_own(validation, arm, solution.values)
    x = np.array([found[name] for name in held_out.names])
    fitted = _fitted_levels(solution)
    sigmas = [
        fitted.get(_sort(held_out, block), assumed)
        for block, assumed in zip(held_out.blocks, held_out.assumed_sigmas(), strict=True)
    ]
    rows = whitened_rows(held_out, x, sigmas)
    predicted = _predicted(solution, held_out, rows)
    anew = _placed_anew(validation, arm, solution, sigmas)
    answer = []
    for term in held_out.terms:
        witnesses = len(np.unique(term.witnesses))
        for k, block in enumerate(held_out.blocks):
            if not any(block is mine for mine in term.blocks):
                continue
            line = rows[k].line
            answer.append(
                HeldOutErrors(
                    term,
                    block.name,
                    block.unit,
                    line.residual.copy(),
                    predicted[k],
                    fitted.get(_sort(held_out, block), math.nan),
                    min(witnesses, len(block)),
                    anew[k],
                )
            )
    return tuple(answer)


def _sort(problem: Problem, block: Block) -> tuple[str, str]:
    """Kind and name of a block: what levels are compared within."""
    term = next(t for t in problem.terms if any(block is mine for mine in t.blocks))
    return term.kind, block.name


def _fitted_levels(solution: Solution) -> dict[tuple[str, str], float]:
    """What fitted residuals scatter by kind and block, what the fit took from them given back."""
    problem = solution.problem
    lines = problem.linearise(solution.x, solution.sigmas)
    together: dict[tuple[str, str], list[FloatArray]] = {}
    for line in lines:
        together.setdefault(_sort(problem, line.view.block), []).append(line.residual)
    rows = sum(line.residual.size for line in lines)
    left = max(rows - len(solution.free), rows / 10) / rows
    return {
        sort: max(robust_level(np.concatenate(parts)) / math.sqrt(left), 1e-9)
        for sort, parts in together.items()
    }


def _predicted(solution: Solution, held_out: Problem, rows: Sequence[Rows]) -> list[FloatArray]:
    """Standard deviation (n,) of one component of every row of each block."""
    names = solution.problem.names
    known = [k for k, name in enumerate(held_out.names) if name in names]
    new = [k for k, name in enumerate(held_out.names) if name not in names]
    at = [names.index(held_out.names[k]) for k in known]
    covariance = solution.covariance[np.ix_(at, at)]
    jacobian = np.vstack([r.jacobian for r in rows])
    own = jacobian[:, new]
    inverse = np.linalg.pinv(own) if new else np.zeros((0, len(jacobian)))
    by_known = jacobian[:, known] - own @ (inverse @ jacobian[:, known])
    leverage = np.einsum("nk,kn->n", own, inverse)
    spread = np.einsum("nk,kl,nl->n", by_known, covariance, by_known)
    variance = np.maximum(1.0 - leverage, 0.0) + spread
    found, first = [], 0
    for r in rows:
        n, size = r.line.residual.shape
        mine = variance[first : first + n * size].reshape(n, size).mean(axis=1)
        found.append(r.line.sigma * np.sqrt(np.maximum(mine, 1e-12)))
        first += n * size
    return found


def _placed_anew(
    validation: Sequence[Term], arm: ParameterSet, solution: Solution, sigmas: Sequence[float]
) -> list[float]:
    """`robust_level` of every block with all of the terms' own unknowns fitted to these rows."""
    known = {name: solution.values[name] for name in arm}
    found = fit_own(validation, arm, known)
    problem = Problem(validation, arm)
    x = np.array([found[name] for name in problem.names])
    return [robust_level(line.residual) for line in problem.linearise(x, sigmas)]
