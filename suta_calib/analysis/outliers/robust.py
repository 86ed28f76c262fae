"""Robust linear least squares of residual vectors, with priors on the parameters."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.stats import chi2

from suta_calib.arrays import FloatArray
from suta_calib.solver.losses import huber_threshold

# Residual, in standard deviations of a component, from which on a touch loses weight: Huber's while
# the fit settles, then Tukey's, which ignores gross touches altogether.
TUKEY: Final = 6.0
SETTLING: Final = 8
ROUNDS: Final = 30
SAME: Final = 1e-3
# Lengths, m, that are rounding.
FINEST: Final = 1e-9
# Share of the data that a fit must leave for its scatter to be noise.
LEAST_LEFT: Final = 0.3


class RobustLinearFit:
    """Robust linear least squares of residual vectors, with priors.

    Args:
        jacobian: (n d, p), m per unit of parameter.
        residual: (n, d) where it was linearised, m.
        precision: (p,) of the priors.
        deviation: (p,) from the priors' centres, where it was linearised.
    """

    def __init__(
        self,
        jacobian: FloatArray,
        residual: FloatArray,
        precision: FloatArray,
        deviation: FloatArray,
    ) -> None:
        self.jacobian, self.residual = jacobian, residual
        self._precision, self._deviation = precision, deviation
        # Whether the last fit took up so much that what it leaves is no noise.
        self.saturated = False

    def solve(self, shift: FloatArray) -> tuple[FloatArray, float, FloatArray]:
        """Rest (n, d), scatter of one of its components, and the coefficients of ``shift``.

        Args:
            shift: (n d, s) further columns, without priors.
        """
        (n, size), extra = self.residual.shape, shift.shape[1]
        a = np.hstack([self.jacobian, shift])
        precision, deviation = (
            np.concatenate([v, np.zeros(extra)]) for v in (self._precision, self._deviation)
        )
        weight, sigma, rest = np.ones(n), scatter(self.residual), self.residual
        step = np.zeros(a.shape[1])
        for k in range(ROUNDS):
            step, used = _weighted_step(a, self.residual, weight / sigma**2, precision, deviation)
            rest = (self.residual.reshape(-1) + a @ step).reshape(n, size)
            freedom = max(n * size - used, 0.1 * n * size)
            found = max(scatter(rest) * np.sqrt(n * size / freedom), FINEST)
            length = np.linalg.norm(rest, axis=1) / found
            weight = _huber(length, huber_threshold(size)) if k < SETTLING else _tukey(length)
            if k > SETTLING and abs(found - sigma) < SAME * sigma:
                break
            sigma = found
        self.saturated = used > (1.0 - LEAST_LEFT) * n * size
        return rest, sigma, step[a.shape[1] - extra :]


def _weighted_step(
    a: FloatArray,
    rest: FloatArray,
    weight: FloatArray,
    precision: FloatArray,
    deviation: FloatArray,
) -> tuple[FloatArray, float]:
    """Least-squares step, and how many parameters the data have determined by it."""
    weighed = a * np.repeat(weight, rest.shape[1])[:, None]
    data = weighed.T @ a
    scale = np.sqrt(np.maximum(np.diag(data) + precision, 1e-12))
    outer = np.outer(scale, scale)
    inverse = np.linalg.pinv((data + np.diag(precision)) / outer, 1e-12, True) / outer
    gradient = weighed.T @ rest.reshape(-1) + precision * deviation
    return -inverse @ gradient, float(np.sum(inverse * data))


def scatter(vectors: FloatArray) -> float:
    """Standard deviation of one component, from the median length."""
    length = float(np.median(np.linalg.norm(vectors, axis=1)))
    return length / float(np.sqrt(chi2.ppf(0.5, vectors.shape[1])))


def _huber(length: FloatArray, threshold: float) -> FloatArray:
    return np.minimum(1.0, threshold / np.maximum(length, threshold))


def _tukey(length: FloatArray) -> FloatArray:
    return np.maximum(1.0 - (length / TUKEY) ** 2, 0.0) ** 2
