"""Distribution of the metrics if there is only noise.

The same touches are simulated with the noise that was found (common to a cluster, and of each),
fitted by the same equations to first order, and measured in the same way. From the largest value
over all groups comes the probability that chance alone makes any of them so large: Westfall and
Young (1993), Resampling-Based Multiple Testing, single-step max T. A group's metric is compared in
standard deviations of its own, because a landmark at the edge always has more influence than one in
the middle.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib.analysis.outliers.metrics import SINGULAR, JudgedFit, shares
from suta_calib.analysis.outliers.reference import ROUNDING, Grouping, Refit, systematic
from suta_calib.analysis.outliers.result import METRICS
from suta_calib.analysis.outliers.touches import Touches
from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.solver.information import Rows, scaled_inverse, whitened_rows

_SUMS: Final = [METRICS.index("contribution"), METRICS.index("cooks_distance")]


def chance_of(observed: FloatArray, drawn: FloatArray) -> FloatArray:
    """(4, groups) probability that chance makes any metric of any group as conspicuous.

    Over the groups by the largest value of those ``drawn`` (4, draws, groups), over the four
    metrics by Bonferroni's factor; NaN where a metric does not exist.
    """
    drawn, values_observed = drawn.copy(), observed.copy()
    for values in (drawn, values_observed):
        # Roots of what is a sum of squares are closer to normal.
        values[_SUMS] = np.sqrt(np.maximum(values[_SUMS], 0.0))
    finite = np.asarray(np.isfinite(drawn).all(axis=1))
    drawn = np.where(finite[:, None], drawn, 0.0)
    mean, std = drawn.mean(axis=1), np.maximum(drawn.std(axis=1), 1e-12)
    largest = ((drawn - mean[:, None]) / std[:, None]).max(axis=2)
    z = (values_observed - mean) / std
    above = np.sum(largest[:, :, None] >= z[:, None, :], axis=1)
    p = np.minimum(len(METRICS) * (1.0 + above) / (1.0 + drawn.shape[1]), 1.0)
    return np.asarray(np.where(np.isfinite(values_observed) & finite, p, np.nan))


class Simulator:
    """Noise to put through a scene's fits, to first order.

    What was found displaced is judged in the fit that has it, all else in the fit without it.

    Args:
        scene: whose fits are imitated.
        touches: the noise.
        seed: of the random numbers.
    """

    def __init__(self, scene: JudgedFit, touches: Touches, seed: int) -> None:
        draws = 1000
        self._scene = scene
        random = np.random.default_rng([seed, scene.reference.index])
        cell = scene.reference.term.clusters
        common = random.standard_normal((draws, int(cell.max()) + 1, 3))[:, cell]
        single = random.standard_normal((draws, len(cell), 3))
        alone = np.sqrt(max(touches.sigma**2 - touches.shared**2, 0.0))
        noise = touches.shared * common + alone * single
        self._clean = _Imitation(scene, scene.clean, noise)
        same = scene.clean is scene.full_refit
        self._whole = self._clean if same else _Imitation(scene, scene.full_refit, noise)

    def metrics(self, grouping: Grouping) -> FloatArray:
        """(4, draws, groups) simulated metrics of every group of a level."""
        columns = []
        for g in range(len(grouping)):
            rows = grouping.rows(g)
            inside = self._clean if np.any(rows & self._scene.not_gross) else self._whole
            columns.append(inside.group(grouping, rows))
        return np.moveaxis(np.array(columns), 0, 2)


class _Imitation:
    """One fit to first order, and the simulated errors it leaves."""

    def __init__(self, scene: JudgedFit, fit: Refit, noise: FloatArray) -> None:
        self._scene, self._fit = scene, fit
        terms = fit.problem.terms
        index = scene.reference.index
        rows = whitened_rows(fit.problem, fit.x, scene.reference.block_sigmas(terms))
        first = sum(len(t.blocks) for t in terms[:index])
        self._mine = rows[first : first + len(terms[index].blocks)]
        names = fit.problem.names
        self._free = [k for k, n in enumerate(names) if n in scene.reference.estimated]
        self._named = [[names[k] for k in self._free].index(n) for n in scene.moved]
        prior = np.diag(fit.problem.prior_precision()[self._free])
        self._hessian = prior + sum(_square(r.jacobian[:, self._free]) for r in rows)
        self._jacobian = self._blocked(self._mine[0])
        self._shares = shares(fit.samples, scene.displaced)
        # Whitened errors (draws, rows, d) after the fit, and the registered touches.
        term, sigma = scene.reference.term, fit.sigma
        white = term.errors_of_touches(noise, fit.samples) / sigma[:, None]
        step = _by_parameter(white, self._jacobian) @ scaled_inverse(self._hessian, SINGULAR)
        flat = self._jacobian.reshape(-1, len(self._free))
        self._error = white - (step @ flat.T).reshape(white.shape)
        self._white = _RowSums(self._error, self._jacobian)
        # In units of the first row's standard deviation: mostly all rows have the same.
        self._relative = sigma / sigma[0]
        self._alike = bool(np.all(self._relative == 1.0))
        self._metric = self._white
        if not self._alike:
            by_row = self._relative[:, None]
            self._metric = _RowSums(self._error * by_row, self._jacobian * by_row[:, :, None])
        self._registered = scene.registered
        if self._registered is not None:
            self._touched = self._registered.registered(noise)

    def group(self, grouping: Grouping, rows: BoolArray) -> FloatArray:
        """(4, draws) metrics of the samples of one group."""
        inside = np.flatnonzero(rows[self._fit.samples].any(axis=1))
        gone = self._white.over(inside)
        step = self._step_without(rows, gone)
        squared = (self._relative[inside] ** 2) * np.sum(self._error[:, inside] ** 2, axis=2)
        share = np.sum((rows[self._fit.samples] * self._shares)[inside], axis=1)
        contribution = squared @ share / self._metric.squared
        n = len(self._fit.samples)
        metric_gone = gone if self._alike else self._metric.over(inside)
        left = self._metric.without(metric_gone, step) / max(n - len(inside), 1)
        fall = 1.0 - np.sqrt(left / (self._metric.squared / n))
        count = max((n - len(inside)) * self._error.shape[2], 1)
        variance = self._white.without(gone, step) / count
        # Without the group the others may be fitted exactly: nothing to measure a change by.
        exact = variance * count < ROUNDING * self._white.squared
        fall[exact] = np.nan
        cook = self._scene.influence.distance(step[:, self._named])
        cook = np.divide(cook, variance, out=np.full_like(cook, np.nan), where=~exact)
        if self._registered is None:
            bias = self._fit.sigma[0] * np.sqrt(squared.mean(axis=1))
        else:
            touched = rows & self._fit.used
            bias = systematic(self._touched, touched, grouping.name, self._registered)
        return np.array([contribution, cook, fall, bias])

    def _step_without(self, rows: BoolArray, gone: _RowSums) -> FloatArray:
        """(draws, free) change of the parameters when a group is left out."""
        rest, gradient = self._hessian - gone.quadratic, gone.linear
        rows_used = np.flatnonzero(self._fit.used)
        for block in self._mine[1:]:
            touched = rows[rows_used[block.line.view.block.samples]]
            rest = rest - _square(self._blocked(block)[touched.any(axis=1)])
        # What only the group determined goes with it: its placement's pose, its point.
        left = np.flatnonzero(np.diag(rest) > ROUNDING * np.diag(self._hessian))
        step = np.zeros_like(gradient)
        step[:, left] = gradient[:, left] @ scaled_inverse(rest[np.ix_(left, left)], SINGULAR)
        return step

    def _blocked(self, rows: Rows) -> FloatArray:
        size = rows.line.view.block.size
        jacobian = rows.jacobian[:, self._free]
        return np.asarray(jacobian.reshape(-1, size, len(self._free)))


class _RowSums:
    """Sums over rows of errors (draws, n, d) and of their Jacobian (n, d, p).

    Attributes:
        squared: (draws,) Σ e².
        linear: (draws, p) Σ Jᵀ e.
        quadratic: (p, p) Σ Jᵀ J.
    """

    def __init__(self, error: FloatArray, jacobian: FloatArray) -> None:
        self._error, self._jacobian = error, jacobian
        self.squared = np.einsum("knd,knd->k", error, error)
        self.linear, self.quadratic = _by_parameter(error, jacobian), _square(jacobian)

    def over(self, rows: IntArray) -> _RowSums:
        """The same over some rows alone."""
        return _RowSums(self._error[:, rows], self._jacobian[rows])

    def without(self, gone: _RowSums, step: FloatArray) -> FloatArray:
        """(draws,) Σ (e + J step)² over the rows that are not ``gone``."""
        linear, quadratic = self.linear - gone.linear, self.quadratic - gone.quadratic
        squares = (
            self.squared - gone.squared + np.sum((2 * linear + step @ quadratic) * step, axis=1)
        )
        return np.asarray(np.maximum(squares, 0.0))


def _by_parameter(error: FloatArray, jacobian: FloatArray) -> FloatArray:
    """(draws, p) Σ Jᵀ e."""
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    return np.asarray(error.reshape(len(error), -1) @ flat)


def _square(jacobian: FloatArray) -> FloatArray:
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    return np.asarray(flat.T @ flat)
