"""Rigid registration of corresponding points: fiducials, markers, landmarks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.assessment import Assessment, Level
from suta_calib.distributions import t
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import (
    extent,
    homogeneous,
    register_points,
    rms_length,
    rotation_from_vector,
    skew,
    tangent_of_vector,
)
from suta_calib.measurements.pose_files import Points
from suta_calib.measurements.samples import Samples
from suta_calib.pose_calibration.consensus import (
    DIMENSION,
    Consensus,
    find_consensus,
    minimal_samples,
)
from suta_calib.pose_calibration.deformation import UNKNOWNS, Strain, common_scale, strain
from suta_calib.pose_calibration.inputs import checked_points, checked_sigmas, error_context
from suta_calib.pose_calibration.robust_answer import RobustAnswer
from suta_calib.pose_calibration.robust_fit import ROUNDING, RobustFit, parts_of, robust_fit
from suta_calib.pose_calibration.stated import Agreement, StatedSpread
from suta_calib.pose_calibration.weighed_point import WeighedPoint
from suta_calib.showing import Shown
from suta_calib.terms.block import Noise
from suta_calib.terms.outside import pose_named
from suta_calib.terms.poses import MeasuredPoses
from suta_calib.terms.tracked_point import TrackedPoint
from suta_calib.units import deg, from_deg, mm, text

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
# Points from which on one that does not fit can be told from the others.
ENOUGH_TO_JUDGE: Final = 5
# Standard deviations, m and rad, that deserve a word.
UNSURE: Final = 1e-3
UNSURE_TURN: Final = from_deg(1.0)
# Difference in scale that no temperature makes.
OTHER_SCALE: Final = 0.005
# Chance that a scale, or a strain, is seen where there is none; and what one displaces the points
# by, in units of their scatter, to be worth a word however many points tell it.
FALSE_ALARM: Final = 1e-4
NOTICEABLE: Final = 0.3


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Registration(Shown, RobustAnswer):
    """``T_b_a``, which takes points in frame a (the source) to frame b (the target).

    The covariance (6, 6) is of a small displacement (m) and turn (rad) of the moved points about
    `centre`, in the axes of frame b; residuals are ``R a_i + p - b_i``, the fiducial registration
    error.

    Attributes:
        rotation: (3, 3).
        position: (3,), m.
        centre: (3,) middle of the fitted points in frame b, m.
        distinct: (n,) points that are not copies of one before. Copies count once, except where all
            points are believed.
        sigma: scatter of one component of an inlier's residual, m.
        scale: how many times larger the fitted points are in the target than in the source, which
            a rigid transform cannot make up for.
        scale_std: standard deviation of that.
        scale_rms: what `rms` would be with that scale, m.
        strain: the same with a scale of its own along every direction; None where too few points
            tell it.
        extent: of the fitted points, root mean square from their middle, m.
        stated: standard deviation of one component of a typical residual as instruments state it,
            m; None where they state nothing. Then `sigma` is of such a residual too.
        agreement: of the residuals with what is stated; None likewise.
    """

    rotation: FloatArray
    position: FloatArray
    centre: FloatArray
    distinct: BoolArray
    sigma: float
    scale: float
    scale_std: float
    scale_rms: float
    strain: Strain | None
    extent: float
    stated: float | None = None
    agreement: Agreement | None = None

    @property
    def in_a_line(self) -> str:
        """How well the points agree."""
        return f"RMS {text(self.rms, 'm')} mm over {int(self.inliers.sum())} points"

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
    def origin_std(self) -> FloatArray:
        """Of ``T_b_a``, standard deviations (6,): position, m, and a turn about b's axes, rad."""
        position = self.target_covariance(np.zeros((1, 3)))[0]
        return np.asarray(np.sqrt([*np.diag(position), *np.diag(self.covariance)[3:]]))

    @property
    def assessment(self) -> Assessment:
        """How far to trust it."""
        caution, inliers = list[str](), self.inliers[self.distinct]
        bad = self.objections("points", inliers, self.extent)
        bad += self.deformed("bad")
        caution += self.deformed("care")
        if self.agreement is not None and self.agreement.contradicted:
            caution.append(self.agreement.note)
        if copies := int(np.sum(~self.distinct)):
            rows = "1 row repeats" if copies == 1 else f"{copies} rows repeat"
            caution.append(f"{rows} another exactly in both sets: no measurement, counted once.")
        if np.sum(inliers) <= LEAST_POINTS + 1:
            count = int(np.sum(inliers))
            caution.append(f"{count} points leave few residuals: an error in one may not show.")
        unsure = float(np.sqrt(np.trace(self.covariance[:3, :3])))
        turned = float(np.sqrt(np.trace(self.covariance[3:, 3:])))
        if unsure > UNSURE or turned > UNSURE_TURN:
            caution.append(
                f"The points' middle is known to ± {mm(unsure):.2f} mm and the turn to "
                f"± {deg(turned):.2f}° only (one sigma)."
            )
        known = (
            f"the middle of the points is known to ± {text(unsure, 'm', with_unit=True)} and the "
            f"turn to ± {deg(turned):.3f}° (one sigma, 3-D)"
        )
        return Assessment.of(
            "" if bad else f"{known}; {self.agreed('points')}",
            bad=bad,
            care=[*caution, *self.kept("points"), *self.notes],
        )

    def deformed(self, level: Level) -> list[str]:
        """What is said, at this level, of a scale or a strain that no rigid transform has."""
        scaled, strained, found = self.scaled, self.strained, list[str]()
        if self.strain is not None and strained == level:
            found.append(self.strain.note)
        # A strain has a mean, which says no more than it does.
        if scaled == level and (strained == "good" or (scaled, strained) == ("bad", "care")):
            found.append(self.scale_note)
        return found

    @property
    def scaled(self) -> Level:
        """Whether one common scale explains what no rigid transform can: ``good`` if not.

        ``bad`` where it explains most of the residuals and is more than temperature makes.
        """
        freedom = DIMENSION * int(self.inliers[self.distinct].sum()) - UNKNOWNS
        off = abs(self.scale - 1.0)
        if freedom < 1 or off <= t.isf(FALSE_ALARM / 2, freedom) * self.scale_std:
            return "good"
        return self._worth(off, off * self.extent, self.scale_rms)

    @property
    def strained(self) -> Level:
        """Likewise whether scales along some directions do."""
        if self.strain is None or self.strain.chance > FALSE_ALARM:
            return "good"
        return self._worth(self.strain.size, self.strain.displaced, self.strain.rms)

    def _worth(self, size: float, displaced: float, left: float) -> Level:
        """What is said of a deformation of this size that is no chance (lengths in m)."""
        dominates = left < self.rms / 2
        if displaced < NOTICEABLE * left and not dominates:
            return "good"
        return "bad" if dominates and size > OTHER_SCALE else "care"

    @property
    def scale_note(self) -> str:
        """What a reader is told of the scale."""
        return (
            f"The points are {self.scale:.6g} ± {self.scale_std:.1g} times as far apart in the "
            f"second set as in the first: look for a scale or a unit. With it the rms would be "
            f"{text(self.scale_rms, 'm', with_unit=True)}."
        )


def register(
    source: ArrayLike,
    target: ArrayLike,
    *,
    source_sigma: ArrayLike | None = None,
    target_sigma: ArrayLike | None = None,
    robust: bool = True,
    seed: int = 0,
) -> Registration:
    """Least-squares rigid transform between corresponding points, robustly.

    Arun, Huang, Blostein (1987, doi:10.1109/TPAMI.1987.4767965) from a consensus of the points,
    then with Huber's loss on those that agree. Rows that are the same in both frames are one
    measurement; a fiducial that was touched more than once is not several fiducials. Coplanar
    points have one proper rotation and are fine; where a reflection is what fits, the data are
    refused, as that paper says.

    Where standard deviations are stated, points and directions weigh by them: the residuals are
    whitened by the covariance of both points in frame b. The covariance of the answer is then what
    is stated, unless the residuals contradict it.

    Args:
        source: (n, 3) points in frame a, m.
        target: (n, 3) the same points in frame b, m.
        source_sigma: (n, 3) standard deviations of the source along the axes of a, m; None takes it
            for exact where those of the target are given.
        target_sigma: (n, 3) of the target along the axes of b, m; None likewise.
        robust: False for plain least squares over all points.
        seed: of the minimal samples.

    Raises:
        SamplesError: numbers of points that differ, fewer than three, points on a line, points
            that coincide, or the mirror image of each other.
    """
    a, b = checked_points(source, "source"), checked_points(target, "target")
    _check_points(a, b)
    spread = StatedSpread.of(
        checked_sigmas(source_sigma, len(a), "source_sigma"),
        checked_sigmas(target_sigma, len(b), "target_sigma"),
    )
    first, like = distinct_rows(a, b)
    distinct = np.isin(np.arange(len(a)), first)
    if robust:
        a, b = a[first], b[first]
        spread = None if spread is None else spread.take(first)
    else:
        like = np.arange(len(a))
    judged = seed if robust and len(a) >= ENOUGH_TO_JUDGE else None
    relative = np.ones(len(a)) if spread is None else spread.each / spread.typical
    start, mirrored = _start(a, b, judged, relative), _start(-a, b, judged, relative)
    # Mirror images are Arun's third case, unless noise may be what turned the sign.
    apart = float(start.sigmas[0])
    if apart > MIRRORED * float(mirrored.sigmas[0]) and apart > ROUNDING * float(np.ptp(b)):
        raise SamplesError(
            "points that are the mirror image of each other",
            "two right-handed frames",
            hint="swap two axes or turn the sign of one in one of the files",
        )
    from_centre, to_centre = a[start.inliers].mean(axis=0), b[start.inliers].mean(axis=0)
    length = extent(b) or 1.0
    moved, fixed = (a - from_centre) / length, (b - to_centre) / length
    # In which directions of b the points of a are uncertain.
    turned = register_points(a[start.inliers], b[start.inliers])[0]
    samples = Samples.from_arrays([], np.zeros((len(a), 0)), position=fixed)
    upright = np.tile(np.eye(3), (len(a), 1, 1))
    some_poses = parts_of(MeasuredPoses(upright, moved, samples, exact=True))

    def make(rows: IntArray, noises: Sequence[Noise]) -> TrackedPoint:
        poses = some_poses(rows)
        if spread is None:
            return TrackedPoint(poses, noises[0])
        return WeighedPoint(poses, noises[0], whitening=spread.take(rows).whitening(turned))

    def revise(values: Mapping[str, float], inliers: BoolArray) -> None:
        del inliers
        nonlocal turned
        turned = pose_named(values, TrackedPoint.frames[0].own)[0]

    fit = robust_fit(
        make,
        Consensus(start.inliers, start.sigmas / length),
        robust=robust,
        revise=None if spread is None else revise,
        stated=None if spread is None else spread.typical / length,
    )
    sigma = fit.sigmas[0] * length
    _check_fit(fit, moved[fit.inliers], length)
    x = fit.solution.x
    R, middle = rotation_from_vector(x[3:6]), to_centre + length * x[:3]
    position = middle - R @ from_centre
    jacobian = length * np.eye(6)
    jacobian[3:, 3:] = R @ tangent_of_vector(x[3:6])
    placed, seen = (a @ R.T)[fit.inliers], b[fit.inliers]
    weight = 1.0 / relative[fit.inliers] ** 2
    scale, scale_std, scale_rms = common_scale(placed, seen, weight)
    return Registration(
        rotation=R,
        position=position,
        covariance=jacobian @ fit.covariance @ jacobian.T,
        centre=middle,
        residuals=(a @ R.T + position - b)[like],
        inliers=fit.inliers[like],
        suspects=fit.suspects[like],
        distinct=distinct,
        sigma=sigma,
        scale=scale,
        scale_std=scale_std,
        scale_rms=scale_rms,
        strain=strain(placed, seen, weight, R),
        extent=rms_length(placed - placed.mean(axis=0)),
        stated=None if spread is None else spread.typical,
        agreement=fit.agreement,
        solution=fit.solution,
    )


def registration_from_points(
    a: Points, b: Points, targets: Points | None = None, *, robust: bool = True, seed: int = 0
) -> Registration:
    """`register` of two files: errors name them, the assessment knows what was found in them.

    ``targets`` are points in frame a at which the error to expect will be asked for.
    """
    with error_context(a.path, f"registered to {b.path}"):
        found = register(
            a.position,
            b.position,
            source_sigma=a.sigma,
            target_sigma=b.sigma,
            robust=robust,
            seed=seed,
        )
    files = (a, b) if targets is None else (a, b, targets)
    return replace(found, notes=tuple(note for file in files for note in file.unit_notes))


def _start(a: FloatArray, b: FloatArray, seed: int | None, relative: FloatArray) -> Consensus:
    """What most points agree on; all of them without a seed. ``relative`` as `agreeing_points`."""
    if seed is not None:
        return agreeing_points(a, b, seed, determining_rows(a, b), relative)
    R, p = register_points(a, b)
    off = (a @ R.T + p - b) / relative[:, None]
    return Consensus.of_all(len(a), float(np.sqrt(np.mean(off**2))))


def agreeing_points(
    a: FloatArray, b: FloatArray, seed: int, needed: int, relative: FloatArray | None = None
) -> Consensus:
    """The points (n, 3) that most agree on how ``a`` lies on ``b``.

    Args:
        a: points in one frame, m.
        b: the same in the other, m.
        seed: of the minimal samples.
        needed: points that determine the answer.
        relative: (n,) how much each scatters in units of a typical one; all alike by default.
    """
    each = np.ones(len(a)) if relative is None else relative

    def residuals(model: tuple[FloatArray, FloatArray], rows: IntArray) -> FloatArray:
        R, p = model
        error = a[rows] @ np.swapaxes(R, 1, 2) + p[:, None, :] - b[rows]
        return np.asarray((np.linalg.norm(error, axis=2) / each[rows])[..., None])

    samples = minimal_samples(np.zeros(len(a), dtype=np.intp), LEAST_POINTS, seed)
    return find_consensus(
        len(a), samples, lambda rows: register_points(a[rows], b[rows]), residuals, needed
    )


def _check_points(a: FloatArray, b: FloatArray) -> None:
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


def _check_fit(fit: RobustFit, moved: FloatArray, length: float) -> None:
    """Refuse points that do not lie on each other whatever the transform, or on a line.

    Points off a line by no more than noise do not tell the turn about it.
    """
    sigma = fit.sigmas[0]
    if sigma > UNRELATED:
        raise SamplesError(
            f"points that stay {mm(length * sigma):.1f} mm per axis apart when they are "
            f"laid over each other, which themselves lie {mm(length):.1f} mm about their middle",
            "the same points, row for row",
            hint="is the order of the rows the same, and the unit?",
        )
    spread = np.linalg.svd(moved - moved.mean(axis=0), compute_uv=False)
    held = len(fit.solution.identification.fixed)
    if held or spread[1] / np.sqrt(len(moved)) < OFF_LINE * sigma:
        raise SamplesError(
            "points that hardly differ from a line, given how they scatter: the turn about it "
            "is not determined",
            _NOT_ON_A_LINE,
        )


def distinct_rows(a: FloatArray, b: FloatArray) -> tuple[IntArray, IntArray]:
    """Pairs of points (n, 3) without their exact copies.

    Returns:
        (k,) rows that are not copies of one before, in their order; and (n,) for every row the
        index of its like among them.
    """
    _, first, copies = np.unique(np.hstack([a, b]), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.argsort(order)
    return first[order], rank[copies.reshape(-1)]


def determining_rows(a: FloatArray, b: FloatArray) -> int:
    """Rows (n, 3) of which every choice has three different points, as long as some have.

    Two points fit any pair of their like: where the two that occur most are many rows, what most
    rows agree on says nothing of the turn about them. In the words of robust regression, the rows
    are not in general position (Rousseeuw and Leroy 1987, section 3.4). Three where no point
    occurs twice in either frame.
    """
    counts = [np.unique(points, axis=0, return_counts=True)[1] for points in (a, b)]
    return 1 + max(int(np.sort(c)[-2:].sum()) for c in counts)
