"""What is refused before and after a registration: too few points, lines, mirrors, strangers."""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.pose_calibration.consensus import Consensus
from suta_calib.pose_calibration.robust_fit import ROUNDING, RobustFit

LEAST_POINTS: Final = 3
# Second singular value of centred points, relative to the first, of points on a line.
ON_A_LINE: Final = 1e-6
# A reflection that fits so many times better than any rotation is what the data are.
MIRRORED: Final = 3.0
# Scatter of the residuals, in units of the points' extent, that unrelated points have.
UNRELATED: Final = 0.25
# Extent across a line, in units of the scatter, from which on it is more than noise.
OFF_LINE: Final = 2.5
_NOT_ON_A_LINE: Final = "at least three points that are not on one line"


def check_points(a: FloatArray, b: FloatArray) -> None:
    """Refuse sets that no data could register: sizes, too few, one point, one line."""
    if a.shape != b.shape:
        raise SamplesError(
            f"{len(a)} points and {len(b)} points", "as many of each, row for row the same"
        )
    if len(a) < LEAST_POINTS:
        raise SamplesError(f"{len(a)} points", f"at least {LEAST_POINTS}, not on one line")
    for points, which in ((a, "first"), (b, "second")):
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[0] <= 1e-12 * np.abs(points).max():
            raise SamplesError(f"the same point in every row of the {which} set", _NOT_ON_A_LINE)
        if spread[1] < ON_A_LINE * spread[0]:
            raise SamplesError(f"points on a line in the {which} set", _NOT_ON_A_LINE)


def check_handedness(start: Consensus, mirrored: Consensus, extent: float) -> None:
    """Refuse mirror images: Arun's third case, unless noise may be what turned the sign."""
    found, reflected = float(start.sigmas[0]), float(mirrored.sigmas[0])
    if found > MIRRORED * reflected and found > ROUNDING * extent:
        raise SamplesError(
            "points that are the mirror image of each other",
            "two right-handed frames",
            hint="swap two axes or turn the sign of one in one of the files",
        )


def check_correspondence(fit: RobustFit, length: float) -> None:
    """Refuse points that do not lie on each other whatever the transform."""
    if fit.sigmas[0] > UNRELATED:
        raise SamplesError(
            f"points that stay {1e3 * length * fit.sigmas[0]:.1f} mm per axis apart when they are "
            f"laid over each other, which themselves lie {1e3 * length:.1f} mm about their middle",
            "the same points, row for row",
            hint="is the order of the rows the same, and the unit?",
        )


def check_line(moved: FloatArray, fit: RobustFit) -> None:
    """Points off a line by no more than noise do not tell the turn about it."""
    centred = moved - moved.mean(axis=0)
    off_line = np.linalg.svd(centred, compute_uv=False)[1] / np.sqrt(len(moved))
    if off_line < OFF_LINE * fit.sigmas[0] or len(fit.solution.identification.fixed):
        raise SamplesError(
            "points that hardly differ from a line, given how they scatter: the turn about it "
            "is not determined",
            _NOT_ON_A_LINE,
        )
