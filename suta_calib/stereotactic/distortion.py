"""Correction of an electromagnetic tracker's distortion.

Metal bends the field of an EM tracker, so that it sees a point at p + d(p). The displacement that
takes this back is a polynomial of the measured position, fitted to points whose place is known
otherwise (Ikits et al. 2001, An improved calibration framework for electromagnetic tracking
devices, IEEE Virtual Reality), in the Bernstein basis: a tensor product, one degree in every axis.

Where nothing was measured a polynomial of high degree is arbitrary. Beyond the box of the measured
points the displacement f goes on by what a polynomial g of a lower degree (or the same, or none)
changes from the nearest point c of the box: f(c) + g(x) - g(c), without a step at the border. Which
degree, and how fast the error grows, is told by a layer at each side of the box that is left out
and predicted from the rest, as thick as the points to be corrected lie outside.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.special import chdtri, comb

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rms_length
from suta_calib.pose_calibration.consensus import DIMENSION, outlier_limit
from suta_calib.stereotactic.left_out import robust_predicts_better
from suta_calib.threads import single_threaded

# Beyond 6 the basis is worse conditioned than the data are good: (7 + 1)³ gives 1e8.
DEGREES: Final = tuple(range(7))
# Combinations of coefficients seen less than this, relative to the best seen, are left at zero.
RCOND: Final = 1e-6
# Left-out points that the other frames do not determine: leverage this close to one.
UNDETERMINED: Final = 1e-9
# Thickness of the layers left out at each side, as part of the box: at most, and where nobody says
# what is to be corrected.
THICKEST: Final = 0.2
# m, error of an EM reading that is none: a tenth of what such trackers promise.
HARMLESS: Final = 1e-4


@dataclass(frozen=True, eq=False)
class DistortionCorrection(Displayable):
    """A fitted correction.

    Attributes:
        degree: of the polynomial in every axis; 0 where no correction is better than any.
        lower: (3,) corner of the box of the measured points, m.
        upper: (3,) opposite corner, m.
        coefficients: ((degree + 1)³, 3) displacements at the control points, m.
        continuation: degree by which it goes on outside; 0 where it stays as at the border.
        continued: ((continuation + 1)³, 3) control points of that.
        reach: how far it goes on, as part of the box.
        growth: 3-D RMS error to expect outside beyond that inside, m per m from the border.
        hull: (facets, 4) outward normals and offsets of the convex hull of the measured points.
        common: correlation of the errors of a frame's points when the frame is left out, 0 to 1.
        cross_validation: 3-D RMS error of left-out frames by degree, m; only degrees that the data
            support.
        residuals: (N_frames, n, 3) corrected minus expected, of the fitted points, m.
    """

    degree: int
    lower: FloatArray
    upper: FloatArray
    coefficients: FloatArray
    continuation: int
    continued: FloatArray
    reach: float
    growth: float
    hull: FloatArray
    common: float
    cross_validation: Mapping[int, float]
    residuals: FloatArray

    @property
    def rms(self) -> float:
        """3-D RMS of the fitted points after correction, m."""
        return rms_length(self.residuals)

    def displacement(self, points: FloatArray) -> FloatArray:
        """What is added to measured points: (..., 3) → (..., 3), m."""
        at = self._in_box(points)
        # No farther than what was tested.
        reached = np.clip(at, -self.reach, 1.0 + self.reach)
        return _displacement(reached, np.clip(at, 0.0, 1.0), self.coefficients, self.continued)

    def _in_box(self, points: FloatArray) -> FloatArray:
        """Points in units of the box, 0 to 1 inside."""
        return (np.asarray(points, dtype=float) - self.lower) / (self.upper - self.lower)

    def farthest(self, points: FloatArray) -> float:
        """How far outside the box the farthest of points (..., 3) lies, as part of the box."""
        at = self._in_box(points)
        return float(np.maximum(-at, at - 1.0).max(initial=0.0))

    def correct(self, points: FloatArray) -> FloatArray:
        """Corrected positions of measured points: (..., 3) → (..., 3), m."""
        return np.asarray(points, dtype=float) + self.displacement(points)

    def outside(self, points: FloatArray) -> FloatArray:
        """How far points lie outside the convex hull of the measured ones: (..., 3) → (...), m."""
        distance = _signed_distance(np.asarray(points, dtype=float), self.hull)
        return np.asarray(np.where(self.inside(points), 0.0, distance))

    def inside(self, points: FloatArray) -> BoolArray:
        """Whether measured points lie in the calibrated volume: (..., 3) → (...)."""
        return _in_hull(np.asarray(points, dtype=float), self.hull)

    def body_error(self, frames: FloatArray) -> FloatArray:
        """3-D RMS error (N_frames,), m, that a body's fit to markers (N_frames, n, 3) keeps.

        It averages what each marker errs for itself. What neighbours share, and all that is
        extrapolated, it does not: then they are as good as one.
        """
        inside = self.cross_validation[self.degree] ** 2
        single = inside * ((1.0 - self.common) / frames.shape[1] + self.common)
        beyond = np.array([self.extrapolation_error(frame) for frame in frames])
        return np.asarray(np.sqrt(single + beyond**2))

    def extrapolation_error(self, points: FloatArray) -> float:
        """3-D RMS error to expect of corrected points (..., 3) for lying outside, m."""
        return self.growth * float(np.sqrt(np.mean(self.outside(points) ** 2)))


def fit_distortion(
    measured: FloatArray,
    expected: FloatArray,
    degrees: Sequence[int] = DEGREES,
    corrected: FloatArray | None = None,
) -> DistortionCorrection:
    """Fit the correction; cross-validation chooses its degree, and how it continues outside.

    Frames are left out whole, one after the other, because the points of one frame share the
    errors of its pose. A left-out point counts where the other frames surround it. Of the degrees
    that are as good as the best within the standard error of the difference, the lowest is taken
    (Breiman et al. 1984), and no correction at all counts as degree 0: noise is not corrected.

    Args:
        measured: (N_frames, n, 3) points as the EM tracker saw them, m.
        expected: (N_frames, n, 3) where they were, m.
        degrees: to choose from, 0 or more.
        corrected: (..., 3) points as the tracker saw them that are to be corrected, m: they say how
            far outside it must be right.

    Raises:
        SamplesError: fewer than two frames, or all measured points in one plane.
    """
    return _continued(*_fit_inside(measured, expected, degrees), corrected)


@single_threaded
def _fit_inside(
    measured: FloatArray, expected: FloatArray, degrees: Sequence[int] = DEGREES
) -> tuple[DistortionCorrection, dict[int, _PolynomialFit]]:
    """The correction, constant outside from the border on, and the fits of all degrees."""
    if len(measured) < 2:
        raise SamplesError(
            f"{len(measured)} frame of calibration readings",
            "two or more to correct distortion, so that each can be checked by the others",
        )
    measured, expected = np.asarray(measured, dtype=float), np.asarray(expected, dtype=float)
    hull, lower, upper = _hull(measured), measured.min(axis=(0, 1)), measured.max(axis=(0, 1))
    inside = _surrounded(measured, hull)
    at, off = (measured - lower) / (upper - lower), measured - expected
    fits = {d: fit for d in sorted({0, *degrees}) if (fit := _fit(d, at, off)) is not None}
    # Sum of squared errors of each frame's points that count, (N_frames,).
    errors = {d: np.sum(np.sum(f.left_out**2, axis=-1) * inside, axis=1) for d, f in fits.items()}
    degree = _lowest_as_good(errors)
    validation = {d: float(np.sqrt(e.sum() / inside.sum())) for d, e in errors.items()}
    chosen = fits[degree]
    correction = DistortionCorrection(
        degree=degree,
        lower=lower,
        upper=upper,
        coefficients=chosen.coefficients,
        continuation=0,
        continued=np.zeros((1, 3)),
        reach=THICKEST,
        growth=0.0,
        hull=hull,
        common=_intraclass(chosen.left_out),
        cross_validation=validation,
        residuals=chosen.residuals,
    )
    return correction, fits


@single_threaded
def _continued(
    correction: DistortionCorrection,
    fits: Mapping[int, _PolynomialFit],
    corrected: FloatArray | None,
) -> DistortionCorrection:
    """The correction with the continuation that best predicts the frames at the border."""
    degree, size = correction.degree, correction.upper - correction.lower
    farthest = THICKEST if corrected is None else correction.farthest(corrected)
    # In a thinner layer hardly a marker is.
    reach = float(np.clip(farthest, 0.03, THICKEST))
    at, corrections = fits[degree].at, fits[degree].target
    frames = np.repeat(np.arange(len(correction.residuals)), correction.residuals.shape[1])
    # Squared errors by frame, for a frame's points err together; and what is usual inside.
    squared = {k: np.zeros(len(correction.residuals)) for k in fits if k <= degree}
    distance, inside = 0.0, 0.0
    for rows in (side for axis in at.T for side in (axis < reach, axis > 1.0 - reach)):
        rest = at[~rows]
        if not rows.any() or not len(rest):
            continue
        nearest = np.clip(at[rows], rest.min(axis=0), rest.max(axis=0))
        fitted = {k: fits[k].without(rows) for k in squared}
        inside += float(rows.sum()) * correction.cross_validation[degree] ** 2
        distance += float(np.sum(((at[rows] - nearest) * size) ** 2))
        for k, sums in squared.items():
            error = _displacement(at[rows], nearest, fitted[degree], fitted[k]) - corrections[rows]
            np.add.at(sums, frames[rows], np.sum(error**2, axis=-1))
    at_border = {k: sums[squared[0] > 0] for k, sums in squared.items()}
    chosen = _lowest_as_good(at_border) if len(at_border[0]) > 1 else 0
    total = {k: float(sums.sum()) for k, sums in squared.items()}
    # Going on must leave so little of the squared error of staying as at the border; less where
    # readings lie farther out than any layer.
    if total[chosen] > (0.25 if farthest > THICKEST else 0.8) * total[0]:
        chosen = 0
    excess = total[chosen] - inside
    # Of the mean square error inside half is more than chance.
    grows = excess > 0.5 * inside and distance > 0.0
    growth = float(np.sqrt(excess / distance)) if grows else 0.0
    continued = fits[chosen].coefficients
    return replace(correction, continuation=chosen, continued=continued, reach=reach, growth=growth)


def smooth_distortion(measured: FloatArray, expected: FloatArray) -> DistortionCorrection:
    """A correction of low degree, to test with left-out frames whether one is needed."""
    return _fit_inside(measured, expected, (1, 2, 3))[0]


def is_distorted(measured: FloatArray, expected: FloatArray) -> bool:
    """Whether a correction reduces the error of left-out frames by more than a third."""
    try:
        fit = smooth_distortion(measured, expected)
    except SamplesError:
        return False
    return fit.cross_validation[fit.degree] < 2 / 3 * fit.cross_validation[0]


@dataclass(frozen=True, eq=False)
class _PolynomialFit:
    """One degree, least squares: errors of points that are fitted, and whose frame is left out."""

    coefficients: FloatArray
    residuals: FloatArray
    left_out: FloatArray
    # Orthonormal (N, r) basis of the points, and (.., r) from it to coefficients.
    u: FloatArray
    back: FloatArray
    # (N, 3) the points in their box, 0 to 1, and what should be added to them, m.
    at: FloatArray
    target: FloatArray

    def without(self, rows: BoolArray) -> FloatArray:
        """Coefficients of a fit without some of the points (N,)."""
        u, corrections = self.u[rows], self.target[rows]
        information = (1.0 + UNDETERMINED) * np.eye(u.shape[1]) - u.T @ u
        pull = self.u.T @ self.target - u.T @ corrections
        return np.asarray(self.back @ np.linalg.solve(information, pull))


def _fit(degree: int, at: FloatArray, off: FloatArray) -> _PolynomialFit | None:
    """Least squares of one degree; None where the data do not support it."""
    frames, n = at.shape[:2]
    places, corrections = at.reshape(-1, 3), -off.reshape(-1, 3)
    if degree == 0:
        u, back = np.zeros((len(corrections), 0)), np.zeros((1, 0))
        return _PolynomialFit(np.zeros((1, 3)), off, off, u, back, places, corrections)
    if 2 * (degree + 1) ** 3 > len(corrections):
        return None
    basis = _basis(places, degree)
    u, back = _orthonormal(basis)
    coefficients = back @ (u.T @ corrections)
    residuals = (basis @ coefficients - corrections).reshape(frames, n, 3)
    # Errors each frame would have if it were not fitted, without fitting again: (I − H_gg)⁻¹ e_g
    # with the hat matrix H = U Uᵀ (Cook, Weisberg 1982, Residuals and Influence, section 2.2).
    by_frame = u.reshape(frames, n, -1)
    leftover = np.eye(n) - by_frame @ np.swapaxes(by_frame, 1, 2)
    if np.linalg.eigvalsh(leftover).min() < UNDETERMINED:
        return None
    left_out = np.asarray(np.linalg.solve(leftover, residuals), dtype=float)
    return _PolynomialFit(coefficients, residuals, left_out, u, back, places, corrections)


def _orthonormal(basis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orthonormal (N, r) basis of what the columns (N, c) span, and (c, r) from it to them.

    By the eigenvectors of the Gram matrix; what its squared condition number costs a Cholesky
    factor makes good, as in CholeskyQR2 (Yamamoto et al. 2015, ETNA 44).
    """
    squared, vectors = np.linalg.eigh(basis.T @ basis)
    determined = squared > RCOND**2 * squared[-1]
    back = vectors[:, determined] / np.sqrt(squared[determined])
    u = basis @ back
    inverse = np.linalg.inv(np.linalg.cholesky(u.T @ u)).T
    return u @ inverse, back @ inverse


def _intraclass(errors: FloatArray) -> float:
    """Correlation, 0 to 1, of the errors (N_frames, n, 3) of two points of one frame."""
    n, power = errors.shape[1], float(np.mean(np.sum(errors**2, axis=-1)))
    if n < 2 or power == 0.0:
        return 0.0
    together = float(np.mean(np.sum(errors.mean(axis=1) ** 2, axis=-1)))
    return float(np.clip((n * together / power - 1.0) / (n - 1), 0.0, 1.0))


def _lowest_as_good(errors: Mapping[int, FloatArray]) -> int:
    """The lowest degree whose errors (n,) are not significantly worse than the best's."""
    best = min(errors, key=lambda degree: float(errors[degree].sum()))
    for degree in sorted(errors):
        worse = errors[degree] - errors[best]
        if worse.mean() <= worse.std(ddof=1) / np.sqrt(len(worse)):
            return degree
    return best


def _surrounded(measured: FloatArray, hull: FloatArray) -> BoolArray:
    """(N_frames, n) points within the hull of the other frames' points; all where none are."""
    inside = np.ones(measured.shape[:2], dtype=bool)
    # A frame of which no point is on the hull of all changes nothing in it.
    on_hull = _signed_distance(measured, hull) > -_tolerance(hull)
    for frame in np.flatnonzero(on_hull.any(axis=1)):
        other_frames = np.delete(measured, frame, axis=0)
        inside[frame] = _in_hull(measured[frame], _hull(other_frames))
    return inside if inside.any() else ~inside


def _hull(points: FloatArray) -> FloatArray:
    points = points.reshape(-1, 3)
    try:
        return np.asarray(ConvexHull(points).equations)
    except QhullError:
        raise SamplesError(
            f"{len(points)} calibration points in one plane",
            "points that fill a volume, or a correction for it cannot be found",
            hint="move the calibration object in all three directions",
        ) from None


def _signed_distance(points: FloatArray, hull: FloatArray) -> FloatArray:
    """Distance (...) of points from a hull, m; negative inside."""
    return np.asarray((points @ hull[:, :3].T + hull[:, 3]).max(axis=-1))


def _tolerance(hull: FloatArray) -> float:
    """By how much corners of a hull miss its facets by rounding, m."""
    return 1e-9 * max(1.0, float(np.abs(hull[:, 3]).max()))


def _in_hull(points: FloatArray, hull: FloatArray) -> BoolArray:
    return np.asarray(_signed_distance(points, hull) <= _tolerance(hull))


def _displacement(
    at: FloatArray, nearest: FloatArray, inner: FloatArray, outer: FloatArray
) -> FloatArray:
    """Polynomial at the nearest points of the box, and what another one changes from there on."""
    inside = nearest.reshape(-1, 3)
    inner_degree, outer_degree = (round(len(part) ** (1 / 3)) - 1 for part in (inner, outer))
    displacement = _basis(inside, inner_degree) @ inner
    if outer_degree:
        step = _basis(at.reshape(-1, 3), outer_degree) - _basis(inside, outer_degree)
        displacement = displacement + step @ outer
    return np.asarray(displacement.reshape(at.shape))


def _basis(at: FloatArray, degree: int) -> FloatArray:
    """Bernstein polynomials over the unit cube: (N, 3) → (N, (degree + 1)³)."""
    k, at = np.arange(degree + 1), at[..., None]
    x, y, z = np.swapaxes(comb(degree, k) * at**k * (1.0 - at) ** (degree - k), 0, 1)
    return np.asarray(np.einsum("ni,nj,nk->nijk", x, y, z).reshape(len(at), -1))


def fit_distortion_robustly(
    measured: FloatArray,
    expected: FloatArray,
    corrected: FloatArray | None = None,
    *,
    robust: bool | None = True,
) -> tuple[DistortionCorrection, BoolArray]:
    """`fit_distortion` without readings that do not fit the others.

    Readings far off where they are expected are set aside first, for a wild one would be met
    exactly by the polynomial; then the fit judges all of them until nothing changes. One that is
    set aside is put where the fit would have it: then it says nothing. Arguments are those of
    `fit_distortion`; without ``robust`` none is set aside, or (None) only where that predicts
    left-out frames better.

    Returns:
        the correction, whose residuals are those of all readings; (N_frames, n) readings set aside.
    """
    if not robust:
        plain, fits = _fit_inside(measured, expected)
        far = far_off(plain.residuals) | far_off(measured - expected)
        nothing = np.zeros(measured.shape[:2], dtype=np.bool_)
        if robust is False or not far.any():
            return _continued(plain, fits, corrected), nothing
    fit, robust_fits, residuals, wrong = _robustly(measured, expected)
    if robust is None:

        def left_out(errors: FloatArray) -> FloatArray:
            """RMS (N_frames,) over the readings that both believe, of the frame left out."""
            squares = np.sum(errors**2, axis=-1) * ~wrong
            return np.asarray(np.sqrt(squares.sum(axis=1) / np.maximum((~wrong).sum(axis=1), 1)))

        errors = fits[plain.degree].left_out, robust_fits[fit.degree].left_out
        # Where nothing is corrected either way, what is set aside would only widen the ±.
        corrects = plain.degree or fit.degree
        if corrects and not robust_predicts_better(*map(left_out, errors)):
            return _continued(plain, fits, corrected), nothing
    return replace(_continued(fit, robust_fits, corrected), residuals=residuals), wrong


def _robustly(
    measured: FloatArray, expected: FloatArray
) -> tuple[DistortionCorrection, dict[int, _PolynomialFit], FloatArray, BoolArray]:
    """The fit and those of all degrees, residuals of all readings, and those set aside."""
    wrong, degree = far_off(measured - expected), -1
    believed = np.where(wrong[..., None], expected, measured)
    for _ in range(10):
        fit, fits = _fit_inside(believed, expected)
        residuals = fit.correct(measured) - expected
        again = far_off(residuals)
        if np.array_equal(again, wrong) and fit.degree == degree:
            break
        # Where the tracker would see the points if the fit is right: the correction's inverse.
        by_tracker = expected
        for _ in range(4):
            by_tracker = expected - fit.displacement(by_tracker)
        believed = np.where(again[..., None], by_tracker, measured)
        wrong, degree = again, fit.degree
    return fit, fits, residuals, wrong


def far_off(errors: FloatArray) -> BoolArray:
    """Errors (N_frames, n, 3), m, that are far too large compared with the median."""
    sizes = np.linalg.norm(errors, axis=-1)
    sigma = float(np.median(sizes)) / np.sqrt(chdtri(DIMENSION, 0.5))
    # Times the limit for normal errors: what a polynomial cannot follow is no outlier.
    limit = 3.0 * np.sqrt(outlier_limit(sizes.size, 1))
    return np.asarray(sizes > limit * sigma + HARMLESS)
