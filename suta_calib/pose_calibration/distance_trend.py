"""Hand-eye residuals that grow with the distance: a camera whose focal length errs.

Poses from a camera of which the focal length is wrong by a share are too far, or too near, by that
share. X follows most of it, and what is left scatters little: ± from the scatter alone is several
times too small. What is left shows how large the share is, and that how far X has followed.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.distributions import t
from suta_calib.pose_calibration.robust_fit import RobustFit
from suta_calib.records import dataclass
from suta_calib.solver.information import whitened_rows

# Chance that a trend is seen where there is none.
FALSE_ALARM: Final = 0.001


@dataclass(frozen=True, eq=False)
class DistanceTrend:
    """How much too far the eye sees, as a share of the distance.

    Attributes:
        share: the estimate.
        std: its standard deviation.
        significant: whether chance does not explain it.
        covariance: of the solution's parameters, for having followed it; zero where not.
    """

    share: float
    std: float
    significant: bool
    covariance: FloatArray


def distance_trend(fit: RobustFit, depth: FloatArray) -> DistanceTrend:
    """Regression of the residuals on the depth, as far as the unknowns do not follow it.

    Args:
        fit: of a `HandEye` term, whose first block is the position in the eye.
        depth: (n,) of the target in the eye, of all rows, in the fit's unit of length.
    """
    solution = fit.solution
    rows = whitened_rows(solution.problem, solution.x, fit.sigmas)
    jacobian = np.vstack([row.jacobian[:, solution.free] for row in rows])
    residual = np.concatenate(
        [(row.line.residual / sigma).ravel() for row, sigma in zip(rows, fit.sigmas, strict=True)]
    )
    trend = np.zeros((len(residual) // 3, 3))
    # Expected less seen, along the eye's axis.
    trend[: fit.inliers.sum(), 2] = -depth[fit.inliers] / fit.sigmas[0]
    followed = -np.linalg.lstsq(jacobian, trend.ravel(), rcond=None)[0]
    seen = trend.ravel() + jacobian @ followed
    power, freedom = float(seen @ seen), len(residual) - len(solution.free) - 1
    share = float(seen @ residual) / max(power, 1e-300)
    left = residual - share * seen
    std = float(np.sqrt(left @ left / max(freedom, 1) / max(power, 1e-300)))
    significant = freedom > 0 and abs(share) > t.isf(FALSE_ALARM / 2, freedom) * std
    covariance = np.zeros_like(fit.covariance)
    if significant:
        at = np.ix_(solution.free, solution.free)
        covariance[at] = (share**2 + std**2) * np.outer(followed, followed)
    return DistanceTrend(share, std, significant, covariance)
