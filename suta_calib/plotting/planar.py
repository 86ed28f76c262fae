"""An arm seen from a side, and the outlines of what stands about it, mm in a plane."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from scipy.spatial import ConvexHull

from suta_calib.arrays import FloatArray


def draw_arm(axes: Axes, points: FloatArray, label: str = "arm") -> None:
    """The arm's links as a line in a plane, (n, 2) points in mm."""
    axes.plot(*points.T, "-", color="black", lw=2.6, solid_capstyle="round", zorder=5, label=label)
    axes.plot(*points[:-1].T, "o", color="black", mfc="white", ms=5, mew=1.2, zorder=6)
    axes.plot(*points[0], "s", color="black", ms=8, zorder=6)


def outline(points: FloatArray) -> FloatArray:
    """(m, 2) convex hull of points (n, 2) in order; the points themselves where they are flat."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(points) < 3 or spread[1] < 1e-6 * spread[0]:
        return points
    return np.asarray(points[ConvexHull(points).vertices])
