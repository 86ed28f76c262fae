"""Least squares through touches, some of which may be wrong.

Five touches on a pillar's top: are they one flat top, and which is wrong if not.

A plane leaves two of five touches' freedom, and a wrong corner looks just like a wrong opposite
corner. Of the touches whose removal mends the plane, that is taken which leaves the top most level:
a slip of the probe is likelier than a pillar that leans by just as much.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import chdtri, ndtri

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.certification.scatter import FINEST, Scatter, deviates
from suta_calib.geometry.numbers import right_singular

# From MAD to standard deviation of a normal distribution.
MAD: Final = float(1.0 / ndtri(0.75))


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane through points by orthogonal least squares."""

    centre: FloatArray  # (3,) mean of the points used, m
    axes: FloatArray  # (3, 3) rows: the plane's principal directions, then its normal
    inliers: BoolArray  # (n,) points used
    residuals: FloatArray  # (n,) signed distances of all points, along the normal, m

    @property
    def scatter(self) -> Scatter:
        """Of the points used; three make the plane."""
        used = self.residuals[self.inliers]
        return Scatter(float(np.sum(used**2)), max(len(used) - 3, 0))


def fit_plane(points: FloatArray, noise: float | None = None) -> Plane:
    """Orthogonal least squares over (n, 3), m, without touches that the others refute.

    Where the ``noise`` of a touch is known (m), a larger scatter of the touches counts instead of
    it, because a surface is not flat to the instrument's noise.
    """

    def line_up(rows: BoolArray) -> tuple[FloatArray, FloatArray]:
        centre, axes = _principal(points[rows])
        local = (points - centre) @ axes.T
        return local[:, 2], np.column_stack([np.ones(len(points)), local[:, :2]])

    inliers = agreeing(line_up, len(points), 3, noise)
    centre, axes = _principal(points[inliers])
    return Plane(centre, axes, inliers, (points - centre) @ axes[2])


def on_a_line(points: FloatArray, noise: float) -> bool:
    """Whether the points do not say how a plane through them turns about their line."""
    singular = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(singular[1] < max(1e-3 * singular[0], 5.0 * noise))


def agreeing(
    fit: Callable[[BoolArray], tuple[FloatArray, FloatArray]],
    count: int,
    parameters: int,
    noise: float | None,
) -> BoolArray:
    """Points, ``count`` of them, that a linear fit may use: without those that the rest refute.

    Generalised extreme studentised deviates (Rosner 1983, doi:10.1080/00401706.1983.10487848): the
    worst goes, again and again, and wrong are all up to the last that stood out. Two wrong touches
    hide each other from a test that stops at the first. ``fit`` makes of points in use residuals
    (n,) and design matrix (n, parameters) of all; ``noise`` is as for `fit_plane`.
    """
    used = np.ones(count, dtype=np.bool_)
    inliers = used.copy()
    # No more of a feature's touches than this can be wrong.
    while count - used.sum() < int(0.3 * count) and used.sum() >= parameters + 3:
        residual, design = fit(used)
        ratio, scale_known = _studentised(residual[used], design[used], noise)
        worst = int(np.argmax(ratio))
        freedom = int(used.sum()) - parameters - 1
        # Chance that any touch of a feature without a wrong one is called wrong.
        chance = 0.001 / int(used.sum()) / 2
        limit = deviates(chance, np.inf if scale_known else freedom)
        used[np.flatnonzero(used)[worst]] = False
        if ratio[worst] > limit:
            inliers = used.copy()
    return inliers


def _studentised(
    residual: FloatArray, design: FloatArray, noise: float | None
) -> tuple[FloatArray, bool]:
    """Residuals in units of what they may scatter, each judged by the scatter of the others."""
    q = np.linalg.qr(design)[0]
    free = np.maximum(1.0 - np.sum(q**2, axis=1), 1e-6)
    freedom = len(residual) - design.shape[1]
    total = float(np.sum(residual**2))
    variance_without = np.maximum(total - residual**2 / free, 0.0) / max(freedom - 1, 1)
    scale = np.sqrt(variance_without)
    least = FINEST if noise is None else max(noise, FINEST)
    noise_used = bool(noise is not None and np.median(scale) <= least)
    return np.abs(residual) / np.sqrt(free) / np.maximum(scale, least), noise_used


def _principal(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    centre = points.mean(axis=0)
    axes = right_singular(points - centre)[1]
    axes[2] *= np.linalg.det(axes)
    return centre, axes


@dataclass(frozen=True, eq=False)
class Top:
    """One top against a plane."""

    inliers: BoolArray  # (k,) touches that are used
    residuals: FloatArray  # (k,) of all touches from the plane through those used, m
    scatter: Scatter  # of those used; three make the plane
    even: bool = True  # whether those used are a plane within the noise


def judge_tops(tops: Sequence[FloatArray], noise: float | None, fallback: float) -> tuple[Top, ...]:
    """Every top (k, 3), m, in the ground's frame with its wrong touch, if it has one.

    The ``noise`` of a touch, m, may be stated; ``fallback`` is that of the ground, for where the
    tops cannot tell it.
    """
    fits = [_fit(points, np.ones(len(points), dtype=np.bool_)) for points in tops]
    level, freedom = fallback, float(len(tops))
    free = [fit.scatter for fit in fits if fit.scatter.freedom > 0]
    if len(free) >= 3:
        # The median top, which no few bad ones can move; it is worth about half of the tops.
        usual = np.median([top.squared / chdtri(top.freedom, 0.5) for top in free])
        level, freedom = float(np.sqrt(usual)), float(sum(top.freedom for top in free) // 2)
    scale = max(level, noise or 0.0, FINEST)
    if noise is not None and scale == noise:
        freedom = np.inf
    return tuple(
        _judge(points, fit, scale, freedom, len(tops))
        for points, fit in zip(tops, fits, strict=True)
    )


def _judge(points: FloatArray, fit: Top, scale: float, freedom: float, count: int) -> Top:
    def even(top: Top) -> bool:
        # Chance that any top of an artefact with nothing wrong is called uneven.
        return not top.scatter.exceeds(scale, freedom, 0.01 / count)

    if even(fit):
        return fit
    k = len(points)
    without = [_fit(points, np.arange(k) != touch) for touch in range(k)] if k > 4 else []
    mended = [top for top in without if even(top)]
    if mended:
        return min(mended, key=lambda top: float(np.hypot(*_plane(points[top.inliers])[1:])))
    return replace(fit, even=False)


def _fit(points: FloatArray, used: BoolArray) -> Top:
    coefficients = _plane(points[used])
    residuals = points[:, 2] - _design(points, points[used]) @ coefficients
    scatter = Scatter(float(np.sum(residuals[used] ** 2)), max(int(used.sum()) - 3, 0))
    return Top(used, residuals, scatter)


def _design(points: FloatArray, about: FloatArray) -> FloatArray:
    return np.column_stack([np.ones(len(points)), points[:, :2] - about[:, :2].mean(axis=0)])


def _plane(points: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.lstsq(_design(points, points), points[:, 2], rcond=None)[0])
