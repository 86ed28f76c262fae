"""Rigid registration of corresponding points: fiducials, markers, landmarks.

What the touches of one point have in common, such as an error of where it is in a plan, does not
average: a fourth touch of it says little that the third did not. A reading that was written four
times, each with other digits at its end, says nothing at all that it did not say once. How much
they have in common is asked of the residuals, by an analysis of variance between points and within.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import fdtrc

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.assessment import Assessment, Level, judged
from suta_calib.display import Displayable
from suta_calib.geometry.numbers import homogeneous, rms_length, skew
from suta_calib.measurements.pose_files import PointSet
from suta_calib.measurements.scale import INSTRUMENT_PPM, PPM
from suta_calib.pose_calibration.consensus import DIMENSION
from suta_calib.pose_calibration.inputs import checked_points, checked_sigmas, error_context
from suta_calib.pose_calibration.rigid_fit import (
    LEAST_POINTS,
    RigidFit,
    check_points,
    distinct_rows,
    rigid_fit,
)
from suta_calib.pose_calibration.robust_answer import RobustAnswer, doubting, set_aside
from suta_calib.pose_calibration.robust_fit import ROUNDING
from suta_calib.pose_calibration.stated_noise import Agreement, StatedSpread
from suta_calib.terms.poses import together
from suta_calib.trust.hypotheses.scaled_points import ScaledPoints
from suta_calib.trust.hypotheses.strained_points import StrainedPoints
from suta_calib.trust.hypothesis import weigh
from suta_calib.trust.rule import Rule
from suta_calib.trust.uncertainty_budget import UncertaintyBudget, pose_budgets
from suta_calib.units import from_deg, mm, std_text, text

DEFORMED: Final = (ScaledPoints.name, StrainedPoints.name)


@dataclass(frozen=True, eq=False)
class RepeatedPoints:
    """Rows that repeat the same points and share most of their error.

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
        """A note if the repeats are copies and not touches; else empty."""
        # Scatter of the touches of one point, in units of that between points, below which none was
        # made for itself.
        if self.within > 0.05 * self.between:
            return ""
        rows = "1 row repeats" if self.count == 1 else f"{self.count} rows repeat"
        return (
            f"{rows} another but for {mm(self.within):.1g} mm, where the points scatter by "
            f"{mm(self.between):.2g} mm: no new measurement, so each point counts once."
        )

    @property
    def counted(self) -> str:
        """How they count, as the end of a sentence."""
        return (
            f", counted as {len(self.point) - self.count}: repeats of one point share their error"
        )

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


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Registration(Displayable, RobustAnswer):
    """``T_b_a``, which takes points in frame a (the source) to frame b (the target).

    The covariance (6, 6) is of a small displacement (m) and turn (rad) of the moved points about
    `centre`, in the axes of frame b; residuals are ``R a_i + p - b_i``, the fiducial registration
    error.

    Attributes:
        rotation: (3, 3).
        position: (3,), m.
        centre: (3,) middle of the fitted points in frame b, m.
        distinct: (n,) points that are not copies of one before. Copies count once, except where all
            points are believed; so do points that were touched again, where most of their error is
            common to all their touches.
        repeats: these; None where there are none.
        sigma: scatter of one component of an inlier's residual, m.
        extent: of the fitted points, root mean square from their middle, m.
        stated: standard deviation of one component of a typical residual as instruments state it,
            m; None where they state nothing. Then `sigma` is of such a residual too.
        agreement: of the residuals with what is stated; None likewise.
        scale_ppm: standard deviation of the factor between the lengths of the two sets, 1e-6, as
            stated: it moves targets in proportion to their distance from `centre`.
    """

    rotation: FloatArray
    position: FloatArray
    centre: FloatArray
    distinct: BoolArray
    sigma: float
    extent: float
    repeats: RepeatedPoints | None = None
    stated: float | None = None
    agreement: Agreement | None = None
    scale_ppm: float = 0.0

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
        with the scatter that the residuals show instead of one that is given, and `scale_spread`.
        """
        lever = self.act(np.atleast_2d(np.asarray(points, dtype=float))) - self.centre
        by_motion = np.concatenate([np.tile(np.eye(3), (len(lever), 1, 1)), -skew(lever)], axis=2)
        by_scale = self.scale_spread * lever
        common = by_scale[:, :, None] * by_scale[:, None, :]
        return np.asarray(by_motion @ self.covariance @ np.swapaxes(by_motion, 1, 2) + common)

    def target_error(self, points: ArrayLike) -> FloatArray:
        """Expected root mean square target registration error (n,), m, at points of frame a."""
        return np.asarray(np.sqrt(np.trace(self.target_covariance(points), axis1=1, axis2=2)))

    @property
    def budgets(self) -> tuple[UncertaintyBudget, ...]:
        """What the uncertainty of ``T_b_a`` is made of: the place of a's origin, and the turn."""
        lever = np.pad(self.position - self.centre, (0, 3))
        far, ppm = np.outer(lever, lever), self.scale_ppm
        stated = {f"scale between the two sets ({ppm:g} ppm)": (ppm * PPM) ** 2 * far}
        suggested = "scale between the two sets, as the points suggest it"
        shown = {suggested: (self.scale - 1.0) ** 2 * far} if self._scale_doubtful else {}
        covariance = self.covariance.copy()
        covariance[:3, :3] = self.target_covariance(np.zeros((1, 3)))[0]
        return pose_budgets("T_b_a", covariance, self.scatter, stated, shown)

    @property
    def origin_std(self) -> FloatArray:
        """Of ``T_b_a``, standard deviations (6,): position, m, and a turn about b's axes, rad."""
        position = self.target_covariance(np.zeros((1, 3)))[0]
        return np.asarray(np.sqrt([*np.diag(position), *np.diag(self.covariance)[3:]]))

    @property
    @judged
    def assessment(self) -> Assessment:
        """How far to trust it."""
        caution, inliers = list[str](), self.inliers[self.distinct]
        bad = self.objections("points", inliers, self.extent)
        bad += self.deformed("bad")
        caution += [*self.deformed("care"), *self.others_found(*DEFORMED)]
        if self.agreement is not None and self.agreement.contradicted:
            caution.append(self.agreement.note)
        if self.moved:
            caution.append(self.moved.sentence)
        again = self.repeats.count if self.repeats is not None else 0
        if copies := int(np.sum(~self.distinct)) - again:
            rows = "1 row repeats" if copies == 1 else f"{copies} rows repeat"
            caution.append(
                f"{rows} another exactly in both sets: no new measurement, so each point "
                "counts once."
            )
        if self.repeats is not None and self.repeats.note:
            caution.append(self.repeats.note)
        if np.sum(inliers) <= LEAST_POINTS + 1:
            count = int(np.sum(inliers))
            caution.append(
                f"Only {count} points: an error in one of them may stay unnoticed. Use more points."
            )
        unsure = float(np.sqrt(np.trace(self.covariance[:3, :3])))
        turned = float(np.sqrt(np.trace(self.covariance[3:, 3:])))
        # Standard deviations that are reported.
        if unsure > 1e-3 or turned > from_deg(1.0):
            caution.append(
                f"The middle of the points is known to ± {std_text(unsure, 'm')} only, and the "
                f"turn to ± {std_text(turned, 'rad')} (one standard deviation). Use more points, "
                "farther apart."
            )
        statement = (
            f"the middle of the points is known to ± {std_text(unsure, 'm')} and the "
            f"turn to ± {std_text(turned, 'rad')} (one standard deviation, 3-D)"
        )
        counted = "" if self.repeats is None else self.repeats.counted
        return Assessment.of(
            "" if bad else f"{statement}; {self.agreed('points')}{counted}",
            bad=bad,
            care=[
                *caution,
                *set_aside("points", inliers),
                *self.notes_on_rows("points"),
                *self.notes,
            ],
            facts=[self.relied_on],
        )

    def deformed(self, level: Level) -> list[str]:
        """Notes at this level on a scale or strain between the sets."""
        scaled, strained = self.finding(ScaledPoints.name), self.finding(StrainedPoints.name)
        # A strain has a mean, which says no more than it does.
        if scaled and strained and (scaled.level, strained.level) != ("bad", "care"):
            scaled = None
        return [f.sentence for f in (strained, scaled) if f is not None and f.level == level]

    @property
    def scale(self) -> float:
        """How many times larger the fitted points are in the target than in the source.

        A rigid transform cannot make up for it.
        """
        evidence = self.evidence(ScaledPoints.name)
        return 1.0 if evidence is None else 1.0 + float(evidence.size[0])

    @property
    def scale_std(self) -> float:
        """Standard deviation of `scale`."""
        evidence = self.evidence(ScaledPoints.name)
        return 0.0 if evidence is None else float(evidence.std[0])

    @property
    def scale_spread(self) -> float:
        """Standard deviation of the factor between the lengths of the two sets, as a ratio.

        As stated; and by as much as the points tell, where that is hardly chance.
        """
        stated, off = self.scale_ppm * PPM, abs(self.scale - 1.0)
        return float(np.hypot(stated, off)) if self._scale_doubtful else stated

    @property
    def _scale_doubtful(self) -> bool:
        evidence = self.evidence(ScaledPoints.name)
        # Chance of a scale below which it widens the ± of targets though it is no finding: of sound
        # sets one of 20.
        return evidence is not None and evidence.p_single < 0.05

    @property
    def relied_on(self) -> str:
        """A sentence on the scale, of which residuals hardly show an error."""
        by_points = f"the points alone give {self.scale:.5f} ± {self.scale_std:.1g}"
        if self._scale_doubtful:
            return (
                "The points suggest a scale between the two sets, and ± of targets includes it: "
                f"{by_points}."
            )
        return (
            f"± of targets assumes that the lengths of both sets agree to {self.scale_ppm:g} ppm "
            f"(--scale-ppm); {by_points}."
        )


@doubting
def register(
    source: ArrayLike,
    target: ArrayLike,
    *,
    source_sigma: ArrayLike | None = None,
    target_sigma: ArrayLike | None = None,
    robust: bool = True,
    seed: int = 0,
    scale_ppm: float = INSTRUMENT_PPM,
    rule: Rule = Rule(),
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
        scale_ppm: standard deviation of the factor between the lengths of the two sets, 1e-6.
        rule: when a hypothesis about wrong data is reported.

    Raises:
        SamplesError: numbers of points that differ, fewer than three, points on a line, points
            that coincide, or the mirror image of each other.
    """
    a, b = checked_points(source, "source"), checked_points(target, "target")
    check_points(a, b)
    spread = StatedSpread.of(
        checked_sigmas(source_sigma, len(a), "source_sigma"),
        checked_sigmas(target_sigma, len(b), "target_sigma"),
    )
    pairs, judged = (a, b), seed if robust else None
    first, like = distinct_rows(a, b)
    distinct = np.isin(np.arange(len(a)), first)
    if robust:
        a, b = a[first], b[first]
        spread = None if spread is None else spread.take(first)
    else:
        first = like = np.arange(len(a))
    rigid = rigid_fit(a, b, spread, judged)
    agreeing, suspects = rigid.fit.inliers, rigid.fit.suspects
    again = _repeats(a, b, rigid) if robust else None
    if again is not None:
        # Every point once: where those of its rows that agree have their middle.
        once = again.chosen(agreeing)
        a, b = again.means(a, agreeing), again.means(b, agreeing)
        rigid = rigid_fit(a, b, None if spread is None else spread.take(once), judged)
        agreeing = agreeing & rigid.fit.inliers[again.point]
        suspects = agreeing & rigid.fit.suspects[again.point]
        first = first[once]
        distinct = np.isin(np.arange(len(distinct)), first)
    fit, failed = rigid.fit, list[str]()
    placed = a[fit.inliers]
    # What stands elsewhere in its frame, from a row on.
    called = {p.owner: "one of the two sets" for p in fit.solution.problem.parameters.values()}
    answer = fit.examined(rigid.length, "points", called, first)
    weighed = weigh(answer, failed)
    return Registration(
        rotation=rigid.rotation,
        position=rigid.position,
        covariance=rigid.jacobian @ fit.covariance @ rigid.jacobian.T,
        centre=rigid.middle,
        residuals=rigid.off(*pairs),
        inliers=agreeing[like],
        suspects=suspects[like],
        distinct=distinct,
        sigma=rigid.sigma,
        extent=rms_length(placed - placed.mean(axis=0)),
        repeats=again,
        stated=None if spread is None else spread.typical,
        agreement=fit.agreement,
        solution=fit.solution,
        scale_ppm=scale_ppm,
        unjudged=tuple(failed),
        examination=answer,
        weighed=tuple(weighed),
        rule=rule,
        scatter=fit.scatter,
    )


def _repeats(a: FloatArray, b: FloatArray, rigid: RigidFit) -> RepeatedPoints | None:
    """Rows of points (n, 3) that are the same ones, and have most of their error in common."""
    # Distance within which rows may be one point, in units of the scatter: were it less, those that
    # err alike would be found for it.
    near = max(6.0 * rigid.sigma, ROUNDING * float(np.ptp(b)))
    numbered = [together(points, near) for points in (a, b)]
    if numbered := [point for point in numbered if point.max() < len(a) - 1]:
        # Most points are touched once.
        return repeats(numbered, rigid.off(a, b) / rigid.relative[:, None], rigid.fit.inliers)
    return None


def registration_from_points(
    a: PointSet, b: PointSet, targets: PointSet | None = None, **options: Any
) -> Registration:
    """`register` of two files, with its options: errors name them, so do notes on their units.

    ``targets`` are points in frame a at which the error to expect will be asked for.
    """
    with error_context(a.path, f"registered to {b.path}"):
        sigmas: Any = {"source_sigma": a.sigma, "target_sigma": b.sigma}
        answer = register(a.position, b.position, **sigmas, **options)
    files = (a, b) if targets is None else (a, b, targets)
    return replace(answer, notes=tuple(note for file in files for note in file.unit_notes))
