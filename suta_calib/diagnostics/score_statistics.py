"""What the residuals say of columns that were not fitted: scores, their variance, one step.

The mathematics of `residual_tests`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.solver.information import Rows, robust_jacobian
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution

# Predicted standard deviation over what is plausible up to which a parameter is worth a test.
TELLING: Final = 0.25
# Information, relative to the largest, that is rounding.
ROUNDING: Final = 1e-12


@dataclass(frozen=True, eq=False)
class Scores:
    """What is left of the candidates' columns.

    Attributes:
        score: (k,) S.
        curvature: (k, k) Z̃ᵀZ̃.
        variance: (k, k) V.
        telling: (k,) whether the data would tell each of them well enough.
        touches: number of clusters.
        squares: sum of the whitened squares, robust.
    """

    score: FloatArray
    curvature: FloatArray
    variance: FloatArray
    telling: NDArray[np.bool_]
    touches: int
    squares: float

    def statistic(self, chosen: IntArray) -> float:
        """F of some columns together."""
        part = self.score[chosen]
        pushed = np.linalg.pinv(self.variance[np.ix_(chosen, chosen)], hermitian=True) @ part
        return float(part @ pushed) / len(chosen)

    def step(self, chosen: IntArray) -> FloatArray:
        """What one step of Gauss and Newton makes of some columns together."""
        curvature = self.curvature[np.ix_(chosen, chosen)]
        return _solved(curvature, self.score[chosen][:, None])[:, 0]

    def p_variance(self, chosen: IntArray, solution: Solution) -> float:
        """Chance of so much variance explained, by the F test of nested models."""
        equations = sum(t.equations() for t in solution.problem.terms)
        freedom = equations - len(solution.free) - len(chosen)
        lowered = float(self.score[chosen] @ self.step(chosen))
        if freedom < 1 or not 0 < lowered < self.squares:
            return 1.0
        ratio = lowered / (self.squares - lowered) * freedom / len(chosen)
        return float(fdtrc(len(chosen), freedom, ratio))

    def gain(self, chosen: IntArray, solution: Solution) -> float:
        """How much that step lowers twice the cost, in units of what noise alone would.

        Rows that share touches repeat each other: what they count is what their touches do.
        """
        terms = solution.problem.terms
        rows = sum(len(b) * b.size for t in terms for b in t.blocks)
        level = np.mean(
            [(n / s) ** 2 for n, s in zip(solution.noise, solution.sigmas, strict=True)]
        )
        lowered = float(self.score[chosen] @ self.step(chosen)) / float(level)
        return lowered * sum(t.equations() for t in terms) / rows


def scores_of(problem: Problem, rows: Sequence[Rows], columns: IntArray, known: IntArray) -> Scores:
    """Of ``columns``, with every other parameter free to follow but the ``known`` ones."""
    others = np.setdiff1d(np.arange(len(problem.names)), np.concatenate([columns, known]))
    curvature = sum(j.T @ j for j in map(robust_jacobian, rows))
    curvature = np.asarray(curvature + np.diag(problem.prior_precision()))
    follow = _solved(curvature[np.ix_(others, others)], curvature[np.ix_(others, columns)])
    left = np.zeros((len(problem.names), len(columns)))
    left[columns, np.arange(len(columns))] = 1.0
    left[others] = -follow
    reduced = left.T @ curvature @ left
    plausible = problem.parameters.array("plausible")[columns]
    telling = np.diag(reduced) * (TELLING * plausible) ** 2 > 1.0
    score, variance, touches = np.zeros(len(columns)), np.zeros_like(reduced), 0
    for term in problem.terms:
        mine = [r for r in rows if any(r.line.view.block is b for b in term.blocks)]
        touch = term.repeats()
        total, spread = _by_touch(mine, touch, left)
        score, variance = score + total, variance + spread
        touches += len(np.unique(touch))
    squares = sum(float(np.sum(_robust_squares(r))) for r in rows)
    return Scores(score, reduced, variance, telling, touches, squares)


def _robust_squares(rows: Rows) -> FloatArray:
    line = rows.line
    return np.asarray(np.sum(line.residual**2, axis=1) * line.weight / line.sigma**2)


def _by_touch(
    rows: Sequence[Rows], touch: IntArray, left: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Sum of the scores of one term's rows, and its variance by touch (see `covariance`)."""
    width = left.shape[1]
    total, twice = np.zeros(width), np.zeros((width, width))
    by_touch = np.zeros((int(touch.max()) + 1, width))
    for r in rows:
        line = r.line
        n, size = line.residual.shape
        columns = (r.jacobian @ left).reshape(n, size, width)
        score = np.einsum("ndp,nd,n->np", columns, line.residual, line.weight / line.sigma)
        total -= score.sum(axis=0)
        members = touch[line.view.block.samples]
        for k in range(members.shape[1]):
            np.add.at(by_touch, members[:, k], score)
        if members.shape[1] > 1:
            _, pair = np.unique(np.sort(members, axis=1), axis=0, return_inverse=True)
            by_pair = np.zeros((int(pair.max()) + 1, width))
            np.add.at(by_pair, pair.reshape(-1), score)
            twice += (members.shape[1] - 1) * by_pair.T @ by_pair
    return total, by_touch.T @ by_touch - twice


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Least-squares solution where the matrix may be singular, scaled to unit diagonal.

    A diagonal entry that is rounding stands for a column of nothing: scaled up, it would drown all.
    """
    diagonal = np.diag(matrix)
    informed = diagonal > ROUNDING * max(float(diagonal.max(initial=0.0)), 1e-300)
    scale = np.where(informed, 1.0 / np.sqrt(np.where(informed, diagonal, 1.0)), 0.0)
    inverse = np.linalg.pinv(matrix * np.outer(scale, scale), 1e-10, True)
    return np.asarray(scale[:, None] * (inverse @ (scale[:, None] * right)))
