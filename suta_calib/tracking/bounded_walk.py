"""A Kalman filter over unknowns that stay, and others that drift but never beyond their prior.

What drifts is a bounded random walk (Ornstein and Uhlenbeck 1930, doi:10.1103/PhysRev.36.823):

    x(t + dt) = a x(t) + w,   a = exp(-dt / τ),   w ~ N(0, (1 - a²) S).

Without observations its variance returns to S, the prior, and grows no further. With linear
observations the estimate is the batch maximum a posteriori over all times, at the latest one
(Kalman 1960, doi:10.1115/1.3662552).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincc

from suta_calib.arrays import FloatArray


@dataclass(frozen=True)
class Innovation:
    """How far an observation was from what was expected.

    Attributes:
        size: squared distance, in units of the expected covariance.
        p: chance of an observation so far off.
    """

    size: float
    p: float


class BoundedWalk:
    """Mean and covariance of the unknowns at the latest time.

    Args:
        prior: (n, n) covariance at the beginning; the mean is zero.
        drifting: (n,) standard deviations that the unknowns have as far as they drift; zero for
            those that stay.
        time_constant: τ of those that drift, s.

    Attributes:
        mean: (n,).
        covariance: (n, n).
    """

    def __init__(self, prior: FloatArray, drifting: FloatArray, time_constant: float) -> None:
        self.mean, self.covariance = np.zeros(len(prior)), np.array(prior, dtype=float)
        self._drifting, self._time_constant = np.array(drifting, dtype=float), time_constant

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        decay = math.exp(-max(seconds, 0.0) / self._time_constant)
        factor = np.where(self._drifting > 0.0, decay, 1.0)
        self.mean = factor * self.mean
        grown = (1.0 - decay**2) * self._drifting**2
        self.covariance = factor[:, None] * self.covariance * factor + np.diag(grown)

    def expected(
        self, slope: FloatArray, residual: FloatArray, noise: FloatArray
    ) -> tuple[Innovation, FloatArray]:
        """How far off an observation would be, and the covariance (d, d) of that.

        Args:
            slope: (d, n) of what is observed, by the unknowns.
            residual: (d,) observed less computed where the unknowns are zero.
            noise: (d, d) covariance.
        """
        spread = slope @ self.covariance @ slope.T + noise
        away = residual - slope @ self.mean
        size = float(away @ np.linalg.solve(spread, away))
        return Innovation(size, float(gammaincc(0.5 * len(away), 0.5 * size))), spread

    def update(self, slope: FloatArray, residual: FloatArray, noise: FloatArray) -> None:
        """Take an observation in; arguments as of `expected`."""
        _, spread = self.expected(slope, residual, noise)
        gain = np.linalg.solve(spread, slope @ self.covariance).T
        self.mean = self.mean + gain @ (residual - slope @ self.mean)
        # Joseph's form stays symmetric and positive.
        left = np.eye(len(self.mean)) - gain @ slope
        self.covariance = left @ self.covariance @ left.T + gain @ noise @ gain.T
