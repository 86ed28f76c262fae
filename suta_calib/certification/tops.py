"""Five touches on a pillar's top: are they one flat top, and which is wrong if not.

A plane leaves two of five touches' freedom, and a wrong corner looks just like a wrong opposite
corner. Of the touches whose removal mends the plane, that is taken which leaves the top most level:
a slip of the probe is likelier than a pillar that leans by just as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import chi2, f

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.certification.plane import FINEST

# Chance that any top of an artefact with nothing wrong is called uneven.
FALSE_ALARM: Final = 0.01


@dataclass(frozen=True, eq=False)
class Top:
    """One top against a plane.

    Attributes:
        inliers: (k,) touches that are used.
        residuals: (k,) of all touches from the plane through those used, m.
        squared: sum of squared residuals of those used, m².
        freedom: used touches less three.
        even: whether those used are a plane within the noise.
    """

    inliers: BoolArray
    residuals: FloatArray
    squared: float
    freedom: int
    even: bool = True


def judge_tops(tops: Sequence[FloatArray], noise: float | None, fallback: float) -> tuple[Top, ...]:
    """Every top with its wrong touch, if it has one.

    Args:
        tops: touches (k, 3) of each top in the ground's frame, m.
        noise: standard deviation of a touch, m, if it is stated.
        fallback: what to take for it where the tops cannot tell: the scatter of the ground, m.
    """
    fits = [_fit(points, np.ones(len(points), dtype=np.bool_)) for points in tops]
    level, freedom = _typical(fits)
    if not freedom:
        level, freedom = fallback, len(tops)
    scale = max(level, noise or 0.0, FINEST)
    known = noise is not None and scale == noise
    return tuple(
        _judge(points, fit, scale, None if known else freedom, len(tops))
        for points, fit in zip(tops, fits, strict=True)
    )


def _typical(fits: Sequence[Top]) -> tuple[float, int]:
    """Scatter of a touch from the median top, which no few bad ones can move, and its freedom."""
    judged = [fit for fit in fits if fit.freedom > 0]
    if len(judged) < 3:
        return 0.0, 0
    variances = [fit.squared / chi2.median(fit.freedom) for fit in judged]
    # A median of tops is worth about half of them.
    return float(np.sqrt(np.median(variances))), sum(fit.freedom for fit in judged) // 2


def _judge(points: FloatArray, fit: Top, scale: float, freedom: int | None, count: int) -> Top:
    def even(top: Top) -> bool:
        if not top.freedom:
            return True
        statistic, chance = top.squared / scale**2, FALSE_ALARM / count
        if freedom is None:
            return bool(statistic <= chi2.isf(chance, top.freedom))
        return bool(statistic / top.freedom <= f.isf(chance, top.freedom, freedom))

    if even(fit):
        return fit
    k = len(points)
    without = [_fit(points, np.arange(k) != each) for each in range(k)] if k > 4 else []
    mended = [top for top in without if even(top)]
    if mended:
        return min(mended, key=lambda top: _lean(points[top.inliers]))
    return Top(fit.inliers, fit.residuals, fit.squared, fit.freedom, even=False)


def _fit(points: FloatArray, used: BoolArray) -> Top:
    coefficients = _plane(points[used])
    residuals = points[:, 2] - _design(points, points[used]) @ coefficients
    squared = float(np.sum(residuals[used] ** 2))
    return Top(used, residuals, squared, max(int(used.sum()) - 3, 0))


def _design(points: FloatArray, about: FloatArray) -> FloatArray:
    return np.column_stack([np.ones(len(points)), points[:, :2] - about[:, :2].mean(axis=0)])


def _plane(points: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.lstsq(_design(points, points), points[:, 2], rcond=None)[0])


def _lean(points: FloatArray) -> float:
    return float(np.hypot(*_plane(points)[1:]))
