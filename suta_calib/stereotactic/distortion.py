"""Correction of an electromagnetic tracker's distortion.

Metal bends the field of an EM tracker, so that it sees a point at p + d(p). The displacement that
takes this back is a polynomial of the measured position, fitted to points whose place is known
otherwise (Ikits et al. 2001, An improved calibration framework for electromagnetic tracking
devices, IEEE Virtual Reality), in the Bernstein basis: a tensor product, one degree in every axis.

Where nothing was measured a polynomial of high degree is arbitrary. Outside the box of the
measured points the displacement is that of the nearest point of the box, and every point outside
their convex hull is told apart by `DistortionCorrection.inside`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.special import comb
from scipy.stats import chi2

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rms_length
from suta_calib.pose_calibration.consensus import DIMENSION, outlier_limit

# Beyond this the basis is worse conditioned than the data are good: (7 + 1)³ gives 1e8.
DEGREES: Final = tuple(range(7))
# Enough to see that there is something to correct.
COARSE: Final = (1, 2, 3)
# Combinations of coefficients seen less than this, relative to the best seen, are left at zero.
RCOND: Final = 1e-6
# Left-out points that the other frames do not determine: leverage this close to one.
UNDETERMINED: Final = 1e-9
MAX_ROUNDS: Final = 10
# Times the limit for normal errors: what a polynomial cannot follow is no outlier.
GROSS: Final = 3.0
# m, error of an EM reading that is none: a tenth of what such trackers promise.
HARMLESS: Final = 1e-4
INVERSIONS: Final = 4


@dataclass(frozen=True, eq=False)
class DistortionCorrection:
    """A fitted correction.

    Attributes:
        degree: of the polynomial in every axis; 0 where no correction is better than any.
        lower: (3,) corner of the box of the measured points, m.
        upper: (3,) opposite corner, m.
        coefficients: ((degree + 1)³, 3) displacements at the control points, m.
        hull: (facets, 4) outward normals and offsets of the convex hull of the measured points.
        cross_validation: 3-D RMS error of left-out frames by degree, m; only degrees that the data
            support.
        residuals: (N_frames, n, 3) corrected minus expected, of the fitted points, m.
    """

    degree: int
    lower: FloatArray
    upper: FloatArray
    coefficients: FloatArray
    hull: FloatArray
    cross_validation: Mapping[int, float]
    residuals: FloatArray

    @property
    def rms(self) -> float:
        """3-D RMS of the fitted points after correction, m."""
        return rms_length(self.residuals)

    def displacement(self, points: FloatArray) -> FloatArray:
        """What is added to measured points: (..., 3) → (..., 3), m."""
        points = np.asarray(points, dtype=float)
        if self.degree == 0:
            return np.zeros_like(points)
        basis = _basis(points.reshape(-1, 3), self.lower, self.upper, self.degree)
        return np.asarray((basis @ self.coefficients).reshape(points.shape))

    def correct(self, points: FloatArray) -> FloatArray:
        """Corrected positions of measured points: (..., 3) → (..., 3), m."""
        return np.asarray(points, dtype=float) + self.displacement(points)

    def inside(self, points: FloatArray) -> BoolArray:
        """Whether measured points lie in what the calibration covered: (..., 3) → (...).

        That is the convex hull of the measured points, which may leave corners of their box out.
        """
        return _in_hull(np.asarray(points, dtype=float), self.hull)


def fit_distortion(
    measured: FloatArray, expected: FloatArray, degrees: Sequence[int] = DEGREES
) -> DistortionCorrection:
    """Fit the correction; cross-validation over frames chooses the degree.

    Frames are left out whole, one after the other, because the points of one frame share the
    errors of its pose. A left-out point counts where the other frames surround it. Of the degrees
    that are as good as the best within the standard error of the difference, the lowest is taken
    (Breiman et al. 1984), and no correction at all counts as degree 0: noise is not corrected.

    Args:
        measured: (N_frames, n, 3) points as the EM tracker saw them, m.
        expected: (N_frames, n, 3) where they were, m.
        degrees: to choose from, 0 or more.

    Raises:
        SamplesError: fewer than two frames, or all measured points in one plane.
    """
    if len(measured) < 2:
        raise SamplesError(
            f"{len(measured)} frame of calibration readings",
            "two or more to correct distortion, so that one can test what the others say",
        )
    measured, expected = np.asarray(measured, dtype=float), np.asarray(expected, dtype=float)
    points = measured.reshape(-1, 3)
    hull, corners = _hull(points), (points.min(axis=0), points.max(axis=0))
    known = _surrounded(measured)
    fits = {
        degree: fit
        for degree in sorted({0, *degrees})
        if (fit := _fit(degree, measured, expected, corners)) is not None
    }
    # Sum of squared errors of each frame's points that count, (N_frames,).
    errors = {
        degree: np.sum(np.sum(fit.left_out**2, axis=-1) * known, axis=-1)
        for degree, fit in fits.items()
    }
    best = min(errors, key=lambda degree: float(errors[degree].sum()))
    # The lowest degree that is not worse than the best; the best itself is not.
    for degree in errors:
        worse = errors[degree] - errors[best]
        if worse.mean() <= worse.std(ddof=1) / np.sqrt(len(worse)):
            break
    return DistortionCorrection(
        degree,
        *corners,
        fits[degree].coefficients,
        hull,
        {d: float(np.sqrt(e.sum() / known.sum())) for d, e in errors.items()},
        fits[degree].residuals,
    )


def is_distorted(measured: FloatArray, expected: FloatArray) -> bool:
    """Whether a correction would take more than a third off the error of left-out frames."""
    try:
        fit = fit_distortion(measured, expected, COARSE)
    except SamplesError:
        return False
    return fit.cross_validation[fit.degree] < 2 / 3 * fit.cross_validation[0]


@dataclass(frozen=True, eq=False)
class _PolynomialFit:
    """One degree: coefficients, and (N_frames, n, 3) errors of fitted and of left-out points."""

    coefficients: FloatArray
    residuals: FloatArray
    left_out: FloatArray


def _fit(
    degree: int, measured: FloatArray, expected: FloatArray, corners: tuple[FloatArray, FloatArray]
) -> _PolynomialFit | None:
    """Least squares of one degree; None where the data do not support it."""
    frames, n = measured.shape[:2]
    off = (measured - expected).reshape(-1, 3)
    if degree == 0:
        return _PolynomialFit(np.zeros((1, 3)), measured - expected, measured - expected)
    if 2 * (degree + 1) ** 3 > len(off):
        return None
    basis = _basis(measured.reshape(-1, 3), *corners, degree)
    u, s, vt = np.linalg.svd(basis, full_matrices=False)
    seen = s > RCOND * s[0]
    u, s, vt = u[:, seen], s[seen], vt[seen]
    coefficients = -(vt.T / s) @ (u.T @ off)
    residuals = (off + basis @ coefficients).reshape(frames, n, 3)
    left_out = _left_out(u.reshape(frames, n, -1), residuals)
    return None if left_out is None else _PolynomialFit(coefficients, residuals, left_out)


def _left_out(u: FloatArray, residuals: FloatArray) -> FloatArray | None:
    """Errors each frame would have if it were not fitted, without fitting again.

    (I − H_gg)⁻¹ e_g with the hat matrix H = U Uᵀ: Cook, Weisberg (1982), Residuals and Influence
    in Regression, 2.2. None where the other frames would leave the polynomial undetermined.
    """
    kept = np.eye(u.shape[1]) - u @ np.swapaxes(u, 1, 2)
    if np.linalg.eigvalsh(kept).min() < UNDETERMINED:
        return None
    return np.asarray(np.linalg.solve(kept, residuals))


def _surrounded(measured: FloatArray) -> BoolArray:
    """(N_frames, n) points within the hull of the other frames' points; all where none are."""
    known = np.zeros(measured.shape[:2], dtype=bool)
    for frame, points in enumerate(measured):
        others = np.delete(measured, frame, axis=0).reshape(-1, 3)
        known[frame] = _in_hull(points, _hull(others))
    return known if known.any() else ~known


def _hull(points: FloatArray) -> FloatArray:
    try:
        return np.asarray(ConvexHull(points).equations)
    except QhullError:
        raise SamplesError(
            f"{len(points)} calibration points in one plane",
            "points that fill a volume, or a correction for it cannot be found",
            hint="move the calibration object in all three directions",
        ) from None


def _in_hull(points: FloatArray, hull: FloatArray) -> BoolArray:
    # Corners of the hull itself miss its facets by rounding.
    tolerance = 1e-9 * max(1.0, float(np.abs(hull[:, 3]).max()))
    return np.asarray((points @ hull[:, :3].T + hull[:, 3]).max(axis=-1) <= tolerance)


def _basis(points: FloatArray, lower: FloatArray, upper: FloatArray, degree: int) -> FloatArray:
    """Bernstein polynomials at the nearest points of a box: (N, 3) → (N, (degree + 1)³)."""
    k = np.arange(degree + 1)
    at = np.clip((points - lower) / (upper - lower), 0.0, 1.0)[..., None]
    x, y, z = np.swapaxes(comb(degree, k) * at**k * (1.0 - at) ** (degree - k), 0, 1)
    return np.asarray(np.einsum("ni,nj,nk->nijk", x, y, z).reshape(len(points), -1))


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
        # Where the tracker would see the points if the fit is right: the correction's inverse.
        seen = expected
        for _ in range(INVERSIONS):
            seen = expected - fit.displacement(seen)
        believed = np.where(again[..., None], seen, measured)
        wrong, degree = again, fit.degree
    return replace(fit, residuals=residuals), wrong


def _far(errors: FloatArray) -> BoolArray:
    """Errors far too large for a normal scatter of the median's size, (N_frames, n)."""
    sizes = np.linalg.norm(errors, axis=-1)
    sigma = float(np.median(sizes)) / np.sqrt(chi2.ppf(0.5, DIMENSION))
    limit = GROSS * np.sqrt(outlier_limit(sizes.size, 1))
    return np.asarray(sizes > limit * sigma + HARMLESS)
