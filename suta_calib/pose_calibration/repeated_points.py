"""Fiducials that occur more than once: rows that are copies, points that were touched again.

What the touches of one point have in common, such as an error of where it is in a plan, does not
average: a fourth touch of it says little that the third did not. A reading that was written four
times, each with other digits at its end, says nothing at all that it did not say once. How much
they have in common is asked of the residuals, by an analysis of variance between points and within.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.pose_calibration.consensus import DIMENSION
from suta_calib.units import mm


@dataclass(frozen=True, eq=False)
class RepeatedPoints:
    """Rows that are the same points, and have most of their error in common.

    Attributes:
        point: (n,) number of the point of each row, from 0, by first appearance.
        within: scatter of one component of a row about the mean of its point's, m.
        between: the same of these means about the fit, m.
    """

    point: IntArray
    within: float
    between: float

    @property
    def count(self) -> int:
        """How many rows repeat another."""
        return len(self.point) - 1 - int(self.point.max())

    def chosen(self, inliers: BoolArray) -> IntArray:
        """(k,) first row of each point, of those that agree where some do."""
        first = np.unique(self.point, return_index=True)[1]
        touched, agreeing = np.unique(self.point[inliers], return_index=True)
        first[touched] = np.flatnonzero(inliers)[agreeing]
        return np.asarray(first, dtype=np.intp)

    @property
    def note(self) -> str:
        """What a reader is told where they are no touches; nothing where they are."""
        # Scatter of the touches of one point, in units of that between points, below which none was
        # made for itself.
        if self.within > 0.05 * self.between:
            return ""
        rows = "1 row repeats" if self.count == 1 else f"{self.count} rows repeat"
        return (
            f"{rows} another but for {mm(self.within):.1g} mm, where the points scatter by "
            f"{mm(self.between):.2g} mm: no measurement of its own, counted once."
        )

    @property
    def counted(self) -> str:
        """How they count, as the end of a sentence."""
        return f", counted as {len(self.point) - self.count}: repeats of one point err alike"

    def means(self, rows: FloatArray, inliers: BoolArray) -> FloatArray:
        """(k, 3) mean of each point's rows (n, 3): of those that agree, of all where none does."""
        counted = inliers.astype(float)
        counted[~np.isin(self.point, self.point[inliers])] = 1.0
        counts = np.bincount(self.point, counted)
        sums = [np.bincount(self.point, counted * column) for column in rows.T]
        return np.asarray(np.stack(sums, axis=1) / counts[:, None])


def repeats(
    points: Sequence[IntArray], residuals: FloatArray, inliers: BoolArray
) -> RepeatedPoints | None:
    """Rows that are the same points and err alike; None where none are.

    Args:
        points: (n,) numbers of the point that each row may be, by first appearance; as either
            frame has them.
        residuals: (n, 3) of a fit to which every row counted by itself, m; equally certain, as far
            as they are stated.
        inliers: (n,) rows that agree.
    """
    judged = [_judged(point, residuals, inliers) for point in points]
    candidates = [one for one in judged if one is not None]
    chance, likeliest = min(candidates, key=lambda pair: pair[0], default=(1.0, None))
    # Chance of touches that seem to have something in common and have not. They then count as fewer
    # than they are, which does little harm.
    return likeliest if chance < 0.05 / 2 else None


def _judged(
    point: IntArray, residuals: FloatArray, inliers: BoolArray
) -> tuple[float, RepeatedPoints] | None:
    """How likely the rows of a point would err so much alike if each erred for itself."""
    mine, index = np.unique(point[inliers], return_inverse=True)
    inlying, count = residuals[inliers], len(mine)
    # Unknowns of a rigid transform.
    inside, freedom = DIMENSION * (len(inlying) - count), DIMENSION * count - 6
    if not inside or freedom < 1:
        return None
    counts = np.bincount(index)
    sums = [np.bincount(index, column) for column in inlying.T]
    means = np.stack(sums, axis=1) / counts[:, None]
    squares = float(np.sum((inlying - means[index]) ** 2))
    pooled = float(np.sum(counts[:, None] * means**2)) / freedom
    within = squares / inside
    chance = fdtrc(freedom, inside, pooled / max(within, 1e-300))
    between = float(np.sum(means**2)) / freedom
    return float(chance), RepeatedPoints(point, float(np.sqrt(within)), float(np.sqrt(between)))
