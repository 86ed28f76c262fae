"""Residuals that grow with the distance from the eye.

Poses from a camera of which the focal length is wrong by a share are too far, or too near, by that
share. The answer follows most of it, and what is left scatters little: ± from the scatter alone is
several times too small. What is left shows how large the error is, and that how far the answer
follows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import stdtrit

from suta_calib.arrays import FloatArray
from suta_calib.pose_calibration.robust_fit import RobustFit
from suta_calib.solver.information import whitened_rows

# Chance that a trend is seen where there is none.
FALSE_ALARM: Final = 0.001


@dataclass(frozen=True, eq=False)
class Trend:
    """How much residuals change with something that no unknown is.

    Attributes:
        share: the estimate, per unit of what they change with.
        std: its standard deviation.
        significant: whether chance does not explain it.
        covariance: of the solution's parameters, for having followed just this; zero where not.
        explained: (inliers, 3) of each block's residuals, what it explains of them; none where it
            is not significant.
    """

    share: float
    std: float
    significant: bool
    covariance: FloatArray
    explained: tuple[FloatArray, ...] = ()

    @classmethod
    def none(cls, covariance: FloatArray) -> Trend:
        """No trend beside a solution of this covariance."""
        return cls(0.0, 0.0, False, np.zeros_like(covariance))


def distance_trend(fit: RobustFit, depth: FloatArray) -> Trend:
    """How much too far an eye sees, as a share of the distance.

    Args:
        fit: of a `HandEye` term, whose first block is the position in the eye.
        depth: (n,) where the answer has the target along the eye's axis, of all rows, in the fit's
            unit of length. Not as seen: residuals would follow the noise in it.
    """
    # Expected less seen, along the eye's axis.
    return _trend(fit, -depth[:, None] * [0.0, 0.0, 1.0])


def _trend(fit: RobustFit, shape: FloatArray) -> Trend:
    """Regression of the residuals on a shape, as far as the unknowns do not follow it.

    Args:
        fit: the answer.
        shape: (n, 3) of all rows, what the first block's residuals change by for unit size.
    """
    solution = fit.solution
    rows = whitened_rows(solution.problem, solution.x, fit.sigmas)
    jacobian = np.vstack([row.jacobian[:, solution.free] for row in rows])
    residuals = [row.line.residual / s for row, s in zip(rows, fit.sigmas, strict=True)]
    residual = np.concatenate([each.ravel() for each in residuals])
    trend = np.zeros((len(residual) // 3, 3))
    trend[: fit.inliers.sum()] = shape[fit.inliers] / fit.sigmas[0]
    # Of many rows the sums take a tenth of the time of an orthogonal decomposition.
    inverse = np.linalg.pinv(jacobian.T @ jacobian, hermitian=True)
    followed = -inverse @ (jacobian.T @ trend.ravel())
    seen = trend.ravel() + jacobian @ followed
    power, freedom = float(seen @ seen), len(residual) - len(solution.free) - 1
    share = float(seen @ residual) / max(power, 1e-300)
    left = residual - share * seen
    std = float(np.sqrt(left @ left / max(freedom, 1) / max(power, 1e-300)))
    significant = freedom > 0 and abs(share) > (-stdtrit(freedom, FALSE_ALARM / 2)) * std
    covariance = np.zeros_like(fit.covariance)
    explained: tuple[FloatArray, ...] = ()
    if significant:
        at = np.ix_(solution.free, solution.free)
        covariance[at] = (share**2 + std**2) * np.outer(followed, followed)
        parts = np.split(share * seen.reshape(-1, 3), len(fit.sigmas))
        explained = tuple(s * part for s, part in zip(fit.sigmas, parts, strict=True))
    return Trend(share, std, significant, covariance, explained)
