"""A converged fit, linear about its solution: what else may be asked of it is asked here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import coo_array

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.solver.information import Rows, scaled_inverse
from suta_calib.solver.losses import huber, huber_weight
from suta_calib.terms.block import grouped_rows


@dataclass(frozen=True, eq=False)
class LinearFit(Displayable):
    """A converged fit, linear about its solution.

    Only `jacobian` and `residual` are needed. The rest are options.

    Attributes:
        jacobian: (m, p) of the whitened residuals, per unit of each parameter.
        residual: (m,) whitened: in units of one standard deviation of the noise. The unit of the
            noise cancels out, only the ratios between rows matter.
        prior_precision: (p,) 1/σ² of each parameter's prior; 0 where it has none.
        from_prior: (p,) how far each parameter is from its prior's mean.
        weight: (m,) robust weights between 0 and 1.
        clusters: (m, c) numbers, from 0, of the independent touches that each row looks at; -1
            fills unused places. Rows with a common touch share its error.
        independent_rows: how many of the m rows are independent. Distances between all pairs of n
            touches are n(n-1)/2 rows, and only as many independent ones as coordinates were
            measured.
        rows_per_independent_row: 2.0 where neighbouring rows are so correlated that every two
            count as one.
        row: (m,) number of the row that each component is in, from 0 on, for `robust`.
        threshold: (rows,) of Huber's loss, in units of the noise, for `robust`.
        chain: (m,) number of the chain of a robot that each row is of, from 0; None of one arm.
        noise_freedom: degrees of freedom of a noise that is one, because other rows told it; None
            where these rows tell it themselves.
    """

    jacobian: FloatArray
    residual: FloatArray
    prior_precision: FloatArray | None = None
    from_prior: FloatArray | None = None
    weight: FloatArray | None = None
    clusters: IntArray | None = None
    independent_rows: float | None = None
    rows_per_independent_row: float = 1.0
    row: IntArray | None = None
    threshold: FloatArray | None = None
    chain: IntArray | None = None
    noise_freedom: float | None = None

    @classmethod
    def of_rows(
        cls, rows: Sequence[Rows], prior: FloatArray, away: FloatArray, **more: Any
    ) -> LinearFit:
        """Of whitened rows, weighed as they are: `prior_precision`, `from_prior`, and ``more``."""
        size = np.concatenate([np.full(*r.line.residual.shape) for r in rows])
        row = np.repeat(np.arange(len(size)), size)
        return cls(
            rows[0].jacobian if len(rows) == 1 else np.vstack([r.jacobian for r in rows]),
            np.concatenate([(r.line.residual / r.line.sigma[:, None]).ravel() for r in rows]),
            prior,
            away,
            np.concatenate([r.line.weight for r in rows])[row],
            row=row,
            threshold=np.concatenate([r.line.view.threshold / r.line.sigma for r in rows]),
            **more,
        )

    @cached_property
    def prior(self) -> FloatArray:
        """(p,) precision that each parameter has beforehand."""
        none = np.zeros(self.jacobian.shape[1])
        return none if self.prior_precision is None else self.prior_precision

    @cached_property
    def away(self) -> FloatArray:
        """(p,) how far each parameter is from its prior's mean."""
        none = np.zeros(self.jacobian.shape[1])
        return none if self.from_prior is None else self.from_prior

    @cached_property
    def weights(self) -> FloatArray:
        """(m,) robust weights."""
        return np.ones(len(self.residual)) if self.weight is None else self.weight

    @cached_property
    def _weighted(self) -> FloatArray:
        """(m, p) the Jacobian, each row times its weight."""
        return self.jacobian if self.weight is None else self.jacobian * self.weight[:, None]

    @cached_property
    def information(self) -> FloatArray:
        """(p, p) from the rows alone."""
        return np.asarray(self._weighted.T @ self.jacobian)

    @cached_property
    def inverse(self) -> FloatArray:
        """(p, p) of the information with the priors."""
        return scaled_inverse(self.information + np.diag(self.prior))

    @cached_property
    def settled(self) -> FloatArray:
        """(m,) the residuals after one more step of all parameters.

        Zero step for parameters that were fitted. Parameters that were held move now.
        """
        return self.residual + self.jacobian @ self.step

    @cached_property
    def step(self) -> FloatArray:
        """(p,) to the minimum of the linear fit."""
        slope = self._weighted.T @ self.residual + self.prior * self.away
        return -self.inverse @ slope

    @cached_property
    def squares(self) -> float:
        """Weighted squares of the settled residuals, and of the pulls of the priors there."""
        pulls = self.prior * (self.away + self.step) ** 2
        return float(self.weights @ self.settled**2 + np.sum(pulls))

    def squares_where(self, columns: FloatArray) -> float:
        """`squares` without the rows of chains in which columns (m, k) change nothing.

        What happens to one arm of two explains nothing of the other's rows.
        """
        if self.chain is None:
            return self.squares
        touched = np.bincount(self.chain, np.any(columns, axis=1)) > 0
        untouched = ~touched[self.chain]
        return self.squares - float(self.weights[untouched] @ self.settled[untouched] ** 2)

    @cached_property
    def spent(self) -> float:
        """How many unknowns the rows determine: the trace of the hat matrix."""
        return float(np.sum(self.inverse * self.information))

    @cached_property
    def rows(self) -> float:
        """How many rows count as independent."""
        rows = len(self.residual) if self.independent_rows is None else self.independent_rows
        return rows / self.rows_per_independent_row

    def beside(self, columns: FloatArray, precision: FloatArray | float = 0.0) -> LinearFit:
        """The same with more unknowns, of which so much is known beforehand."""
        more = np.broadcast_to(precision, columns.shape[1])
        return replace(
            self,
            jacobian=np.hstack([self.jacobian, columns]),
            prior_precision=np.concatenate([self.prior, more]),
            from_prior=np.concatenate([self.away, np.zeros(len(more))]),
        )

    @cached_property
    def firsts(self) -> IntArray:
        """(rows,) number of the first component of each row."""
        assert self.row is not None
        return np.flatnonzero(np.diff(self.row, prepend=-1))

    def row_squares(self, residual: FloatArray) -> FloatArray:
        """(rows,) squared norms of residuals (m,)."""
        return np.asarray(np.add.reduceat(residual**2, self.firsts))

    def costs(self, residual: FloatArray) -> FloatArray:
        """(rows,) Huber's loss of residuals (m,)."""
        assert self.threshold is not None
        return huber(self.row_squares(residual), self.threshold)

    @cached_property
    def robust(self) -> RobustStep:
        """To the minimum of Huber's loss: rows are weighed by what is left of them."""
        assert self.row is not None
        assert self.threshold is not None
        # Of the cost, below which a round of re-weighing changes nothing, and rounds at most.
        settled = 1e-6
        rounds = 20
        count = len(self.prior)
        # Hardly any row is beyond its threshold: what those lack is taken from the sum over all.
        everything = np.diag(self.prior) + self.jacobian.T @ self.jacobian
        step, residual, weight = np.zeros(count), self.residual, self.weights
        inverse, least, scatter, spent = np.zeros((count, count)), math.inf, math.inf, 0.0
        for _ in range(rounds):
            cost = float(np.sum(self.costs(residual)))
            both = cost + float(self.prior @ (self.away + step) ** 2)
            weight = huber_weight(self.row_squares(residual), self.threshold)[self.row]
            if both > (1.0 - settled) * least:
                break
            beyond = np.flatnonzero(weight < 1.0)
            lost = self.jacobian[beyond] * np.sqrt(1.0 - weight[beyond])[:, None]
            matrix = everything - lost.T @ lost
            inverse, least, scatter = scaled_inverse(matrix), both, cost
            # Of the determined directions, without the priors.
            spent = float(np.sum(inverse * matrix)) - float(self.prior @ inverse.diagonal())
            step = -inverse @ ((self.residual * weight) @ self.jacobian + self.prior * self.away)
            residual = self.residual + self.jacobian @ step
        fit = replace(self, residual=residual, from_prior=self.away + step, weight=weight)
        return RobustStep(fit, step, inverse, least, scatter, spent)

    def only(self, parameters: IntArray) -> LinearFit:
        """The same with some of the parameters (k,); the others stay."""
        if np.array_equal(parameters, np.arange(self.jacobian.shape[1])):
            return self  # as large as all rows are, it is not copied
        return replace(
            self,
            jacobian=self.jacobian[:, parameters],
            prior_precision=self.prior[parameters],
            from_prior=self.away[parameters],
        )

    def followed(self, columns: FloatArray) -> FloatArray:
        """(m, k) what is left of columns when all parameters have followed them."""
        return columns + self.jacobian @ self.moves(columns)

    def curvature(self, columns: FloatArray) -> FloatArray:
        """(k, k) of the squares by the size of columns (m, k) that all parameters follow."""
        moves = self.moves(columns)
        left = columns + self.jacobian @ moves
        by_rows = (left * self.weights[:, None]).T @ left
        return np.asarray(by_rows + moves.T @ (self.prior[:, None] * moves))

    def moves(self, columns: FloatArray) -> FloatArray:
        """(p, k) how far all parameters move per unit when they follow columns (m, k)."""
        return np.asarray(-self.inverse @ (self._weighted.T @ columns))

    def scores(self, columns: FloatArray, residual: FloatArray) -> FloatArray:
        """(m, k) products of columns with the weighted residuals (m,)."""
        return columns * (self.weights * residual)[:, None]

    def score_variance(self, columns: FloatArray, residual: FloatArray) -> FloatArray:
        """(k, k) variance of the summed scores, rows with a common touch together.

        Args:
            columns: (m, k) that the parameters have followed.
            residual: (m,) that are left.
        """
        scores = self.scores(columns, residual)
        if self.clusters is None:
            return np.asarray(scores.T @ scores)
        variance = np.zeros((scores.shape[1],) * 2)
        for factor, matrix in self._touches:
            together = scores if matrix is None else np.asarray(matrix @ scores)
            variance += factor * (together.T @ together)
        return variance

    @cached_property
    def _touches(self) -> list[tuple[int, Any]]:
        """Matrices (·, m) that sum what rows with a common touch share, and how often each counts.

        None for rows that have nothing in common.
        """
        assert self.clusters is not None
        rows, members = np.arange(len(self.clusters)), self.clusters
        row, place = np.nonzero(members >= 0)
        found: list[tuple[int, Any]] = [(1, _summing(members[row, place], row, len(rows)))]
        shared = np.sum(members >= 0, axis=1)
        # A row of two touches was counted at both (Cameron, Gelbach and Miller).
        for size in np.unique(shared[shared > 1]).tolist():
            grouped = rows[shared == size]
            pair, sizes = grouped_rows(members[grouped])
            apart = len(sizes) == len(rows)
            found.append((1 - size, None if apart else _summing(pair, grouped, len(rows))))
        return found

    @cached_property
    def cluster_count(self) -> int:
        """How many independent touches there are."""
        if self.clusters is None:
            return len(self.residual)
        return len(np.unique(self.clusters[self.clusters >= 0]))


def _summing(group: IntArray, row: IntArray, count: int) -> Any:
    """Sparse matrix (groups, count) that sums rows by their groups (k,)."""
    ones, size = np.ones(len(row)), int(group.max(initial=-1)) + 1
    return coo_array((ones, (group, row)), (size, count)).tocsr()


@dataclass(frozen=True, eq=False)
class RobustStep(Displayable):
    """To the minimum of a robust loss.

    Attributes:
        fit: about that minimum, weighed by what it leaves.
        step: (p,) to it.
        inverse: (p, p) of the curvature.
        cost: that is left, of rows and priors.
        scatter: that of the rows.
        spent: how many unknowns the data have told.
    """

    fit: LinearFit
    step: FloatArray
    inverse: FloatArray
    cost: float
    scatter: float
    spent: float

    @property
    def noise(self) -> float:
        """Variance of one row: rows that share touches say less than their number."""
        return self.scatter / max(self.fit.rows - self.spent, 1.0)
