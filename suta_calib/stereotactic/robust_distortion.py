"""Distortion correction from calibration readings of which some are wrong."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from scipy.stats import chi2

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.pose_calibration.consensus import DIMENSION, outlier_limit
from suta_calib.stereotactic.distortion import DistortionCorrection, fit_distortion

MAX_ROUNDS: Final = 10
# Times the limit for normal errors: what a polynomial cannot follow is no outlier.
GROSS: Final = 3.0
# m, error of an EM reading that is none: a tenth of what such trackers promise.
HARMLESS: Final = 1e-4
INVERSIONS: Final = 4


def fit_distortion_robustly(
    measured: FloatArray, expected: FloatArray
) -> tuple[DistortionCorrection, BoolArray]:
    """`fit_distortion` without readings that do not fit the others.

    Readings far off where they are expected are set aside first, for a wild one would be met
    exactly by the polynomial; then the fit judges all of them until nothing changes. One that is
    set aside is put where the fit would have it: then it says nothing.

    Args:
        measured: (N_frames, n, 3) points as the EM tracker saw them, m.
        expected: (N_frames, n, 3) where they were, m.

    Returns:
        the correction, whose residuals are those of all readings; (N_frames, n) readings set aside.

    Raises:
        SamplesError: as of `fit_distortion`.
    """
    wrong, degree = _far(measured - expected), -1
    believed = np.where(wrong[..., None], expected, measured)
    for _ in range(MAX_ROUNDS):
        fit = fit_distortion(believed, expected)
        residuals = fit.correct(measured) - expected
        again = _far(residuals)
        if np.array_equal(again, wrong) and fit.degree == degree:
            break
        believed = np.where(again[..., None], _distorted(fit, expected), measured)
        wrong, degree = again, fit.degree
    return replace(fit, residuals=residuals), wrong


def _distorted(fit: DistortionCorrection, points: FloatArray) -> FloatArray:
    """Where the tracker would see points, if the fit is right: the correction's inverse, m."""
    seen = points
    for _ in range(INVERSIONS):
        seen = points - fit.displacement(seen)
    return seen


def _far(errors: FloatArray) -> BoolArray:
    """Errors far too large for a normal scatter of the median's size, (N_frames, n)."""
    sizes = np.linalg.norm(errors, axis=-1)
    sigma = float(np.median(sizes)) / np.sqrt(chi2.ppf(0.5, DIMENSION))
    limit = GROSS * np.sqrt(outlier_limit(sizes.size, 1))
    return np.asarray(sizes > limit * sigma + HARMLESS)
