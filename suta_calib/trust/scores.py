"""Scores of parameters that were not fitted, their variance by touch, and one step towards them.

See `score_tests`, whose equation these are the parts of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import fdtrc

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.solver.covariance import summed_by_member, summed_by_pair
from suta_calib.solver.information import Rows, robust_curvature
from suta_calib.solver.problem import Problem
from suta_calib.trust.extended_problem import known_beforehand

# Predicted standard deviation over what is plausible up to which a parameter is worth a test.
TELLING: Final = 0.25


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
    telling: BoolArray
    touches: int
    squares: float

    def p_by_touch(self, chosen: IntArray, freedom: int) -> float:
        """Chance of so large scores of some columns together, by their variance among touches."""
        telling = chosen[self.telling[chosen]]
        if not len(telling):
            return 1.0
        part = self.score[telling]
        pushed = np.linalg.pinv(self.variance[np.ix_(telling, telling)], hermitian=True) @ part
        return float(fdtrc(len(telling), freedom, part @ pushed / len(telling)))

    def step(self, chosen: IntArray) -> FloatArray:
        """What one step of Gauss and Newton makes of some columns together."""
        curvature = self.curvature[np.ix_(chosen, chosen)]
        return _solved(curvature, self.score[chosen][:, None])[:, 0]

    def shared(self, equations: int) -> float:
        """Times as much as if every equation erred for itself that scores vary by touch; 1 or more.

        A joint's noise turns the tip and displaces it: the components of one row err together. Over
        all candidates, because few touches do not tell it of one (Kish's design effect).
        """
        telling = self.telling & (np.diag(self.curvature) > 0)
        if not telling.any():
            return 1.0
        alone = np.diag(self.curvature)[telling] * self.squares / max(equations, 1)
        return max(1.0, float(np.mean(np.diag(self.variance)[telling] / alone)))

    def p_variance(self, chosen: IntArray, equations: int, free: int) -> float:
        """Chance of so much variance explained, by the F test of nested models."""
        freedom = equations - free - len(chosen)
        lowered = float(self.score[chosen] @ self.step(chosen))
        if freedom < 1 or not 0 < lowered < self.squares:
            return 1.0
        ratio = lowered / (self.squares - lowered) * freedom / len(chosen)
        ratio /= self.shared(equations)
        return float(fdtrc(len(chosen), freedom, ratio))


def scores_of(
    problem: Problem,
    rows: Sequence[Rows],
    columns: IntArray,
    fixed: IntArray,
    curvature: FloatArray | None = None,
) -> Scores:
    """Of ``columns``, with every other parameter free to follow but the ``fixed`` ones.

    Args:
        problem: whose rows these are.
        rows: at the fit, with a column for each parameter.
        columns: (k,) to be tested.
        fixed: that stay.
        curvature: `curvature_of` these, where it is known.
    """
    plausible = problem.parameters.array("plausible")
    followers = np.setdiff1d(np.arange(len(plausible)), np.concatenate([columns, fixed]))
    if curvature is None:
        curvature = curvature_of(problem, rows)
    follow = _solved(curvature[np.ix_(followers, followers)], curvature[np.ix_(followers, columns)])
    left = np.zeros((len(plausible), len(columns)))
    left[columns, np.arange(len(columns))] = 1.0
    left[followers] = -follow
    reduced = left.T @ curvature @ left
    plausible = plausible[columns]
    telling = np.diag(reduced) * (TELLING * plausible) ** 2 > 1.0
    score, variance, touches = np.zeros(len(columns)), np.zeros_like(reduced), 0
    for term in problem.terms:
        mine = [r for r in rows if any(r.line.view.block is b for b in term.blocks)]
        touch = term.witnesses
        total, spread = _by_touch(mine, touch, left)
        score, variance = score + total, variance + spread
        touches += len(np.unique(touch))
    squares = sum(
        float(np.sum(line.residual**2 * (line.weight / line.sigma**2)[:, None]))
        for line in (r.line for r in rows)
    )
    return Scores(score, reduced, variance, telling, touches, squares)


def curvature_of(problem: Problem, rows: Sequence[Rows]) -> FloatArray:
    """(n, n) of a robust fit's cost by all of its parameters, with what is `known_beforehand`."""
    curvature = np.asarray(sum(map(robust_curvature, rows)))
    curvature[np.diag_indices(len(curvature))] += known_beforehand(problem)
    return curvature


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
        by_touch += summed_by_member(score, members, len(by_touch))
        by_pair = summed_by_pair(score, members)
        twice += (members.shape[1] - 1) * by_pair.T @ by_pair
    return total, by_touch.T @ by_touch - twice


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Least-squares solution where the matrix may be singular, scaled to unit diagonal.

    A diagonal entry that is rounding stands for a column of nothing: scaled up, it would drown all.
    """
    diagonal = np.diag(matrix)
    # Information, relative to the largest, that is rounding.
    rounding = 1e-12
    informed = diagonal > rounding * max(float(diagonal.max(initial=0.0)), 1e-300)
    scale = np.where(informed, 1.0 / np.sqrt(np.where(informed, diagonal, 1.0)), 0.0)
    inverse = np.linalg.pinv(matrix * np.outer(scale, scale), 1e-10, True)
    return np.asarray(scale[:, None] * (inverse @ (scale[:, None] * right)))
