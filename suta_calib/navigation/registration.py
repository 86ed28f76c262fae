"""Rigid registration of corresponding points: fiducials, markers, landmarks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.errors import SamplesError
from suta_calib.geometry import (
    FloatArray,
    homogeneous,
    register_points,
    rotation_from_vector,
    skew,
)
from suta_calib.measurements.samples import Samples
from suta_calib.navigation.arrays import checked_points
from suta_calib.navigation.consensus import (
    BoolArray,
    Consensus,
    find_consensus,
    minimal_samples,
)
from suta_calib.navigation.robust_fit import ROUNDING, RobustFit, robust_fit
from suta_calib.navigation.rotation_covariance import tangent_of_vector
from suta_calib.solver.solution import Solution
from suta_calib.terms.poses import MeasuredPoses
from suta_calib.terms.term import IntArray, Noise
from suta_calib.terms.tracked_point import TrackedPoint
from suta_calib.verdict import Verdict, verdict_of

LEAST_POINTS: Final = 3
# Points from which on one that does not fit can be told from the others.
ENOUGH_TO_JUDGE: Final = 5
# Second singular value of centred points, relative to the first, of points on a line.
ON_A_LINE: Final = 1e-6
# A reflection that fits so many times better than any rotation is what the data are.
MIRRORED: Final = 3.0
MANY_OUTLIERS: Final = 0.4
# Standard deviations, m and rad, that deserve a word.
UNSURE: Final = 1e-3
UNSURE_TURN: Final = float(np.radians(1.0))
# Difference in scale that is worth a word where the scatter does not explain it.
OTHER_SCALE: Final = 0.02
# Scatter of the residuals, in units of the points' extent, that unrelated points have.
UNRELATED: Final = 0.25
# Extent across a line, in units of the scatter, from which on it is more than noise.
OFF_LINE: Final = 2.5


@dataclass(frozen=True, eq=False)
class Registration:
    """``T_b_a``, which takes points in frame a (the source) to frame b (the target).

    Attributes:
        rotation: (3, 3).
        position: (3,), m.
        covariance: (6, 6) of a small displacement (m) and turn (rad) of the moved points about
            `centre`, in the axes of frame b.
        centre: (3,) middle of the fitted points in frame b, m.
        residuals: (n, 3), ``R a_i + p - b_i``, in frame b, m.
        inliers: (n,) points that were fitted.
        sigma: scatter of one component of an inlier's residual, m.
        scale: how many times larger the fitted points are in the target than in the source, which
            a rigid transform cannot make up for.
        scale_std: standard deviation of that, as far as the scatter makes it.
        solution: of the solver.
    """

    rotation: FloatArray
    position: FloatArray
    covariance: FloatArray
    centre: FloatArray
    residuals: FloatArray
    inliers: BoolArray
    sigma: float
    scale: float
    scale_std: float
    solution: Solution

    @property
    def matrix(self) -> FloatArray:
        """``T_b_a`` as a 4x4 matrix, m."""
        return homogeneous(self.rotation, self.position)

    def act(self, points: ArrayLike) -> FloatArray:
        """Points (..., 3) of frame a in frame b, m."""
        return np.asarray(np.asarray(points, dtype=float) @ self.rotation.T + self.position)

    def target_covariance(self, points: ArrayLike) -> FloatArray:
        """Covariance (n, 3, 3), m², of where points (n, 3) of frame a come to lie in frame b.

        The target registration error of Fitzpatrick, West, Maurer (1998, doi:10.1109/42.736021),
        with the scatter that the residuals show instead of one that is given.
        """
        lever = self.act(np.atleast_2d(np.asarray(points, dtype=float))) - self.centre
        by_motion = np.concatenate([np.tile(np.eye(3), (len(lever), 1, 1)), -skew(lever)], axis=2)
        return np.asarray(by_motion @ self.covariance @ np.swapaxes(by_motion, 1, 2))

    def target_error(self, points: ArrayLike) -> FloatArray:
        """Expected root mean square target registration error (n,), m, at points of frame a."""
        return np.asarray(np.sqrt(np.trace(self.target_covariance(points), axis1=1, axis2=2)))

    @property
    def rms(self) -> float:
        """Fiducial registration error: root mean square length of the inliers' residuals, m."""
        return float(np.sqrt(np.mean(np.sum(self.residuals[self.inliers] ** 2, axis=1))))

    @property
    def outliers(self) -> tuple[int, ...]:
        """Points judged outliers, from 0."""
        return tuple(int(row) for row in np.flatnonzero(~self.inliers))

    @property
    def verdict(self) -> Verdict:
        """How far to trust it."""
        bad, caution = list[str](), list[str]()
        if not self.solution.converged:
            bad.append(f"The solver did not converge: {self.solution.verdict}.")
        share = 1.0 - float(self.inliers.mean())
        if share > MANY_OUTLIERS:
            bad.append(f"{share:.0%} of the points do not agree with the rest.")
        if abs(self.scale - 1.0) > max(OTHER_SCALE, 3.0 * self.scale_std):
            caution.append(
                f"The points are {self.scale:.3f} times as far apart in the second set as in the "
                "first: look for a scale or a unit."
            )
        if np.sum(self.inliers) <= LEAST_POINTS + 1:
            count = int(np.sum(self.inliers))
            caution.append(f"{count} points leave few residuals: an error in one may not show.")
        unsure = float(np.sqrt(np.trace(self.covariance[:3, :3])))
        turned = float(np.sqrt(np.trace(self.covariance[3:, 3:])))
        if unsure > UNSURE or turned > UNSURE_TURN:
            caution.append(
                f"The points' middle is known to ± {1e3 * unsure:.2f} mm and the turn to "
                f"± {np.degrees(turned):.2f}° only (one sigma)."
            )
        return verdict_of(bad, caution)


def register(
    source: ArrayLike, target: ArrayLike, *, robust: bool = True, seed: int = 0
) -> Registration:
    """Least-squares rigid transform between corresponding points, robustly.

    Arun, Huang, Blostein (1987, doi:10.1109/TPAMI.1987.4767965) from a consensus of the points,
    then with Huber's loss on those that agree. Coplanar points have one proper rotation and are
    fine; where a reflection is what fits, the data are refused, as that paper says.

    Args:
        source: (n, 3) points in frame a, m.
        target: (n, 3) the same points in frame b, m.
        robust: False for plain least squares over all points.
        seed: of the minimal samples.

    Raises:
        SamplesError: numbers of points that differ, fewer than three, points on a line, points
            that coincide, or the mirror image of each other.
    """
    a, b = checked_points(source, "source"), checked_points(target, "target")
    _check_points(a, b)
    judge = robust and len(a) >= ENOUGH_TO_JUDGE
    start, mirrored = (
        _start(points, b, seed) if judge else _everything(points, b) for points in (a, -a)
    )
    _check_handedness(start, mirrored, float(np.ptp(b)))
    from_centre, to_centre = a[start.inliers].mean(axis=0), b[start.inliers].mean(axis=0)
    length = _extent(b) or 1.0
    moved, fixed = (a - from_centre) / length, (b - to_centre) / length

    def make(rows: IntArray, noises: Sequence[Noise]) -> TrackedPoint:
        return _term(moved[rows], fixed[rows], noises[0])

    scaled = Consensus(start.inliers, start.sigmas / length)
    fit = robust_fit(make, scaled, robust=robust)
    _check_correspondence(fit, length)
    _check_line(moved[fit.inliers], fit)
    return _result(fit, a, b, (from_centre, to_centre), length)


def _result(
    fit: RobustFit,
    a: FloatArray,
    b: FloatArray,
    centres: tuple[FloatArray, FloatArray],
    length: float,
) -> Registration:
    x = fit.solution.x
    R, middle = rotation_from_vector(x[3:6]), centres[1] + length * x[:3]
    position = middle - R @ centres[0]
    unit = np.repeat([length, 1.0], 3)
    to_tangent = np.eye(6)
    to_tangent[3:, 3:] = R @ tangent_of_vector(x[3:6])
    jacobian = np.diag(unit) @ to_tangent
    return Registration(
        rotation=R,
        position=position,
        covariance=jacobian @ fit.covariance @ jacobian.T,
        centre=middle,
        residuals=a @ R.T + position - b,
        inliers=fit.inliers,
        sigma=fit.sigmas[0] * length,
        scale=_extent(b[fit.inliers]) / _extent(a[fit.inliers]),
        scale_std=fit.sigmas[0] * length / _extent(b[fit.inliers]) / np.sqrt(fit.inliers.sum()),
        solution=fit.solution,
    )


def _extent(points: FloatArray) -> float:
    """Root mean square distance from the middle, m."""
    return float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))


def _term(a: FloatArray, b: FloatArray, noise: Noise) -> TrackedPoint:
    samples = Samples.from_arrays([], np.zeros((len(a), 0)), position=b)
    upright = np.tile(np.eye(3), (len(a), 1, 1))
    return TrackedPoint(MeasuredPoses(upright, a, samples, exact=True), noise)


def _start(a: FloatArray, b: FloatArray, seed: int) -> Consensus:
    def propose(rows: IntArray) -> tuple[FloatArray, FloatArray]:
        return kabsch(a[rows], b[rows])

    def residuals(model: tuple[FloatArray, FloatArray]) -> FloatArray:
        R, p = model
        error = np.einsum("mij,nj->mni", R, a) + p[:, None, :] - b
        return np.asarray(np.linalg.norm(error, axis=2)[..., None])

    everyone = np.zeros(len(a), dtype=np.intp)
    samples = minimal_samples(everyone, LEAST_POINTS, seed)
    return find_consensus(samples, propose, residuals, LEAST_POINTS)


def kabsch(source: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray]:
    """`geometry.register_points` for many small sets at once: (m, k, 3) → (m, 3, 3), (m, 3)."""
    from_centre, to_centre = source.mean(axis=1), target.mean(axis=1)
    moment = np.einsum("mki,mkj->mij", target - to_centre[:, None], source - from_centre[:, None])
    u, _, v = np.linalg.svd(moment)
    u[..., 2] *= np.linalg.det(u @ v)[:, None]
    R = u @ v
    return R, to_centre - np.einsum("mij,mj->mi", R, from_centre)


def _everything(a: FloatArray, b: FloatArray) -> Consensus:
    R, p = register_points(a, b)
    sigma = np.sqrt(np.mean((a @ R.T + p - b) ** 2))
    return Consensus(np.ones(len(a), dtype=np.bool_), np.array([sigma]))


def _check_points(a: FloatArray, b: FloatArray) -> None:
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


_NOT_ON_A_LINE: Final = "at least three points that are not on one line"


def _check_handedness(start: Consensus, mirrored: Consensus, extent: float) -> None:
    """Refuse mirror images: Arun's third case, unless noise may be what turned the sign."""
    found, reflected = float(start.sigmas[0]), float(mirrored.sigmas[0])
    if found > MIRRORED * reflected and found > ROUNDING * extent:
        raise SamplesError(
            "points that are the mirror image of each other",
            "two right-handed frames",
            hint="swap two axes or turn the sign of one in one of the files",
        )


def _check_correspondence(fit: RobustFit, length: float) -> None:
    if fit.sigmas[0] > UNRELATED:
        raise SamplesError(
            f"points that stay {1e3 * length * fit.sigmas[0]:.1f} mm per axis apart when they are "
            f"laid over each other, which themselves lie {1e3 * length:.1f} mm about their middle",
            "the same points, row for row",
            hint="is the order of the rows the same, and the unit?",
        )


def _check_line(moved: FloatArray, fit: RobustFit) -> None:
    """Points off a line by no more than noise do not tell the turn about it."""
    centred = moved - moved.mean(axis=0)
    off_line = np.linalg.svd(centred, compute_uv=False)[1] / np.sqrt(len(moved))
    if off_line < OFF_LINE * fit.sigmas[0] or len(fit.solution.identification.held):
        raise SamplesError(
            "points that hardly differ from a line, given how they scatter: the turn about it "
            "is not determined",
            _NOT_ON_A_LINE,
        )
