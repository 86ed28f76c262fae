"""Pivot calibration: the tip of a tracked tool from poses while it rests on one or more points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import Assessment, Level, judged
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.measurements.pose_files import ToolPoses
from suta_calib.measurements.samples import Samples
from suta_calib.measurements.scale import INSTRUMENT_PPM, PPM
from suta_calib.pose_calibration.consensus import Consensus, find_consensus, minimal_samples
from suta_calib.pose_calibration.inputs import checked_poses, error_context
from suta_calib.pose_calibration.robust_answer import (
    LARGEST,
    LONGEST_TIP,
    RobustAnswer,
    doubting,
    exchanged,
    set_aside,
)
from suta_calib.pose_calibration.robust_fit import RobustFit, parts_of, robust_fit
from suta_calib.pose_calibration.undetermined import refuse_undetermined
from suta_calib.terms.block import Noise, grouped
from suta_calib.terms.fixed_point import FixedPoint, rows_of_each, stacked_pivot
from suta_calib.terms.poses import MeasuredPoses
from suta_calib.trust.hypotheses.bent_tip import EVENLY, BentTip, displacement
from suta_calib.trust.hypothesis import Finding, weigh
from suta_calib.trust.rule import Rule
from suta_calib.trust.uncertainty_budget import UncertaintyBudget, axis_budget
from suta_calib.units import deg, from_deg, mm, std_text, text


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class PivotCalibration(Displayable, RobustAnswer):
    """The tip of a tool, and the points it rested on; `solution` is in units of `length`.

    The covariance (3 + 3k, 3 + 3k), m², is of the tip and then of the posts in order; residuals are
    ``R_iᵀ (c - p_i) - t`` of every pose, in the tool.

    Attributes:
        tip: (3,) in the tool, m.
        posts: (3,) each, in the tracker, m, by label.
        sigma: scatter of one component of an inlier's residual, m.
        turn: root mean square turn of the inliers' orientations about their mean, as far as it
            tells the tip along the direction of the tool that they tell least about, rad.
        unseen: displacement of the tip at the largest tilt, m, that would hardly be found if the
            tip bent by it to all sides alike, and that tilt, rad; None where it was not tested.
        by_bending: part of the tip's standard deviation, 3-D, that allows for a tip that bends, m.
        length: m per unit of `solution`.
        scale_ppm: standard deviation of one factor on all the tracker's positions, 1e-6; the
            covariance holds it.
    """

    tip: FloatArray
    posts: dict[str, FloatArray]
    sigma: float
    turn: float
    unseen: tuple[float, float] | None
    by_bending: float
    length: float
    scale_ppm: float = 0.0

    @property
    def budget(self) -> UncertaintyBudget:
        """What the uncertainty of the tip is made of."""
        by_scale = self.scale_ppm * PPM * self.tip
        # What a tip that bends adds is known as one number for all axes.
        bending = np.eye(3) * self.by_bending**2 / 3.0
        stated = {
            f"scale of the tracker ({self.scale_ppm:g} ppm)": np.outer(by_scale, by_scale),
            "a tip that bends as the tool tilts": bending,
        }
        of = "one coordinate of the tip in the tool"
        return replace(
            axis_budget(of, "m", self.covariance[:3, :3], self.scatter, stated), name="tip"
        )

    @property
    def in_a_line(self) -> str:
        """The tip, and how well the poses agree."""
        at = ", ".join(text(v, "m") for v in self.tip)
        return f"tip ({at}) mm, RMS {text(self.rms, 'm')} mm over {int(self.inliers.sum())} poses"

    @property
    def post(self) -> FloatArray:
        """The first post, which is the only one where all poses touched the same."""
        return next(iter(self.posts.values()))

    @property
    def tip_std(self) -> FloatArray:
        """Standard deviation of the tip's coordinates (3,), m."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[:3]))

    def post_std(self, label: str | None = None) -> FloatArray:
        """Standard deviation of a post's coordinates (3,), m; of the first one by default."""
        first = 3 + 3 * (0 if label is None else list(self.posts).index(label))
        return np.asarray(np.sqrt(np.diag(self.covariance)[first : first + 3]))

    @property
    @judged
    def assessment(self) -> Assessment:
        """How far to trust the tip."""
        caution = list[str]()
        # What is left of a cone of 24°: whatever the residuals are, the tip is badly determined.
        if self.turn < from_deg(12.0):
            caution.append(
                f"The tool was turned too little ({deg(self.turn):.0f}° RMS in the worst "
                "direction): the tip is badly determined. Turn it by 30° or more to every side."
            )
        if self.moved:
            caution.append(self.moved.sentence)
        unsure = float(np.linalg.norm(self.tip_std))
        if self.bent:
            caution.append(self.bent.sentence)
        caution += self.others_found(BentTip.name)
        # No navigation can afford more (optical systems: 0.3 mm). A rigid tool seems to bend by
        # chance in one of 20 sets: no reason for care.
        most = 0.5e-3
        if unsure > most and (self.bent or unsure**2 - self.by_bending**2 > most**2):
            caution.append(
                f"The tip is known to ± {std_text(unsure, 'm')} only (one standard deviation, "
                "3-D). Turn the tool farther, or add poses."
            )
        bad = self.objections("poses", self.inliers)
        long, away = float(np.linalg.norm(self.tip)), float(np.linalg.norm(self.post))
        if max(long, away) > LARGEST or long > LONGEST_TIP:
            bad.append(
                f"The tip is {long:.4g} m from the tool's origin, and the touched point {away:.4g} "
                "m from the tracker's. Are the positions in mm? Then name the columns x_mm, y_mm, "
                "z_mm."
            )
        facts = [self.relied_on]
        if self.inverted != "good":
            # Before a reference body a divot is near, and a stylus is longer than that: so long.
            usual_stylus = 0.4
            doubtful = caution if long > usual_stylus else facts
            (bad if self.inverted == "bad" else doubtful).append(
                f"The tip is {mm(long):.0f} mm from the tool's origin, farther than the post from "
                f"the tracker's ({mm(away):.0f} mm). Are the poses T_tool_tracker? Inverted, they "
                f"give the tip {_place(self.post)} and the post {_place(self.tip)}."
            )
        # No tracker sees a tool from millimetres or from tens of metres.
        bad += self.notes
        statement = f"the tip is known to ± {std_text(unsure, 'm')} (one standard deviation, 3-D)"
        return Assessment.of(
            "" if bad else f"{statement}; {self.agreed('poses')}",
            bad=bad,
            care=[*caution, *set_aside("poses", self.inliers), *self.notes_on_rows("poses")],
            facts=facts,
        )

    @property
    def bent(self) -> Finding | None:
        """Motion of the tip when the tool tilts; None if there is none."""
        return self.finding(BentTip.name)

    @property
    def relied_on(self) -> str:
        """A sentence on the scale, of which no residual shows an error."""
        sentence = (
            f"No residual shows an error of the tracker's scale. ± includes {self.scale_ppm:g} ppm "
            "for it (--scale-ppm); an error of 1 % makes the tip "
            f"{text(0.01 * float(np.linalg.norm(self.tip)), 'm', with_unit=True)} longer or shorter"
        )
        if self.bent or not self.unseen:
            return f"{sentence}."
        by, tilt = self.unseen
        if self.by_bending:
            return (
                f"{sentence}. Perhaps the tip bends equally to all sides as the tool tilts; the "
                f"poses do not prove it. ± includes {text(self.by_bending, 'm', with_unit=True)} "
                "for it."
            )
        return (
            f"{sentence}. The residuals do not show a tip that bends equally to all sides by less "
            f"than {text(by, 'm', with_unit=True)} at {deg(tilt):.0f}°; this would move the "
            f"estimated tip along the tool by {text(by / max(tilt, 1e-9), 'm', with_unit=True)}."
        )

    @property
    def inverted(self) -> Level:
        """Whether the poses seem to be inverted, which exchanges tip and post: ``good`` if not."""
        if len(self.posts) > 1:
            return "good"  # several posts have no tip in common then
        return exchanged(self.tip, self.post, float(np.sqrt(np.trace(self.covariance))))


@doubting
def calibrate_pivot(
    rotation: ArrayLike,
    position: ArrayLike,
    point: Sequence[str] | NDArray[np.str_] | None = None,
    *,
    robust: bool = True,
    seed: int = 0,
    scale_ppm: float = INSTRUMENT_PPM,
    rule: Rule = Rule(),
) -> PivotCalibration:
    """Tip and posts from poses ``T_tracker_tool`` of a tool that pivots on them.

    ``R_i t + p_i = c`` by linear least squares (Yaniv 2015, doi:10.1117/12.2081348, "algebraic one
    step"), from a consensus of the poses, then with Huber's loss on what agrees.

    Args:
        rotation: (n, 3, 3).
        position: (n, 3), m.
        point: (n,) label of the post each pose touched; one post by default.
        robust: False for plain least squares over all poses.
        seed: of the minimal samples.
        scale_ppm: standard deviation of one factor on all positions, 1e-6. With p tip and posts are
            longer by it, and no residual changes.
        rule: when a hypothesis about wrong data is reported.

    Raises:
        SamplesError: too few poses, or turns so small or about so few axes that the tip is not
            determined; names the undetermined directions.
    """
    least_poses = 3
    R, p = checked_poses(rotation, position, "poses")
    labels = np.full(len(p), "post") if point is None else np.asarray(point, dtype=np.str_)
    if len(labels) != len(p):
        raise SamplesError(f"{len(labels)} labels", f"{len(p)}, one per pose", where="point")
    if len(labels) < least_poses:
        raise SamplesError(
            f"{len(labels)} poses", f"at least {least_poses}, turned about different axes"
        )
    names, index = grouped(labels)
    for name, count in zip(names, np.bincount(index), strict=True):
        if count < 2:
            raise SamplesError(
                f"one pose for point {name}", "at least 2 poses for every point", where="point"
            )
    # Lengths are solved in units of how large all this is, so that none counts. A tool whose tip is
    # its own origin has no extent; then the way to the tracker tells.
    centre, norms = p.mean(axis=0), np.linalg.norm(p, axis=1)
    tool = np.linalg.norm(stacked_pivot(R, p, index)) + np.linalg.norm(p - centre, axis=1).max()
    length = max(float(tool), 0.1 * float(norms.max())) or 1.0
    scaled = (p - centre) / length
    start = _start(R, scaled, index, seed if robust else None)
    samples = Samples.from_arrays([], np.zeros((len(p), 0)), labels={"point": labels})
    some_poses = parts_of(MeasuredPoses(R, scaled, samples))

    def make(rows: IntArray, noises: Sequence[Noise]) -> FixedPoint:
        for k, name in enumerate(names):
            if np.sum(index[rows] == k) < 2:
                raise SamplesError(
                    f"{int(np.sum(index == k))} poses for point {name} that do not agree",
                    "at least 2 that do",
                    where="point",
                    hint="did the tool slip off it?",
                )
        return FixedPoint(some_poses(rows), noises[0])

    fit = robust_fit(make, start, robust=robust)
    # Where nothing fits though the tool turned, what the data leave open is not the trouble: poses
    # without a common point scatter by a tenth of their extent.
    if fit.sigmas[0] > 0.1 and _turns(R[fit.inliers])[-1] > from_deg(2.0):
        raise SamplesError(
            f"poses whose tips scatter by {mm(length * fit.sigmas[0]):.0f} mm per axis",
            "a tool whose tip rests on a point",
            hint=(
                "is it the right file, unit, and order of the quaternion (x y z w)? If single "
                "poses are grossly wrong, solve robustly (without --no-robust)"
            ),
        )
    advice = "turn the tool more while its tip rests on the point"
    refuse_undetermined(fit.solution, "tip", "the tip in the tool", advice)
    labels_of = ["tip", *(f"{FixedPoint.place_unknown}[{n}]" for n in names)]
    parameters = [f"{label}.{axis}" for label in labels_of for axis in "xyz"]
    x = np.array([fit.solution.values[n] for n in parameters]) * length
    order = [fit.solution.problem.names.index(n) for n in parameters]
    posts_in_tracker = x[3:].reshape(-1, 3) + centre
    by_scale = scale_ppm * PPM * np.concatenate([x[:3], posts_in_tracker.reshape(-1)])
    failed = list[str]()
    places = {f"{FixedPoint.place_unknown}[{name}]": name for name in names}
    called = {
        place: f"the post {n}" if len(names) > 1 else "the post" for place, n in places.items()
    }
    answer = fit.examined(
        length,
        "poses",
        {"tip": "the tip on the tool", **called},
        seen_by={place: np.flatnonzero(index == k) for k, place in enumerate(places)},
    )
    weighed = weigh(answer, failed)
    unseen, by_bending = _bending(fit, weighed, rule)
    covariance = (fit.covariance + by_bending)[np.ix_(order, order)] * length**2
    tip_moves = np.diag(by_bending)[order[:3]]
    return PivotCalibration(
        tip=x[:3],
        posts=dict(zip(names, posts_in_tracker, strict=True)),
        covariance=covariance + np.outer(by_scale, by_scale),
        residuals=fit.residuals[0] * length,
        inliers=fit.inliers,
        suspects=fit.suspects,
        sigma=fit.sigmas[0] * length,
        turn=float(_turns(R[fit.inliers])[0]),
        unseen=unseen,
        by_bending=length * float(np.sqrt(tip_moves.sum())),
        solution=fit.solution,
        length=length,
        scale_ppm=scale_ppm,
        unjudged=tuple(failed),
        examination=answer,
        weighed=tuple(weighed),
        rule=rule,
        scatter=fit.scatter,
    )


def _bending(
    fit: RobustFit, weighed: Sequence[Finding], rule: Rule
) -> tuple[tuple[float, float] | None, FloatArray]:
    """`PivotCalibration.unseen`, and the fit's covariance for having followed a tip that bends."""
    bends = [finding for finding in weighed if finding.hypothesis.name == BentTip.name]
    followed = next((f.evidence for f in bends if f.supported(rule)), None)
    evenly = next((f.evidence for f in bends if f.evidence.effect.name == EVENLY), None)
    unseen = None
    if evenly is not None:
        # Standard deviations at which an effect of one number is found in half of all sets.
        unseen = 3.3 * displacement(evenly)[1], evenly.effect.about
        # Standard deviations from which on a tip that bends evenly widens ± though nothing is said:
        # of 30 poses with 0.1 mm of noise, tilted by 40°, 1 mm per rad has two and a half, and
        # moves the tip by 17 times what its scatter tells. Of rigid tools one of 20 is wider for
        # it.
        if followed is None and evenly.significance > 2.0:
            followed = evenly
    nothing = np.zeros_like(fit.covariance)
    return unseen, nothing if followed is None else fit.followed(followed)


def pivot_from_poses(poses: ToolPoses, **options: Any) -> PivotCalibration:
    """`calibrate_pivot` of a file, with its options: errors name it, so do notes on its unit."""
    with error_context(poses.path):
        answer = calibrate_pivot(poses.rotation, poses.position, poses.point, **options)
    return replace(answer, notes=poses.unit_notes)


def _place(position: FloatArray) -> str:
    return f"({', '.join(f'{v:.1f}' for v in mm(position))}) mm"


def _turns(R: FloatArray) -> FloatArray:
    """Root mean square turns (3,), rad, as far as they tell a tip, from least to most."""
    mean = R.mean(axis=0)
    information = np.linalg.eigvalsh(np.eye(3) - mean.T @ mean)
    return np.asarray(np.sqrt(np.maximum(information, 0.0)))


def _norms(R: FloatArray, p: FloatArray, index: IntArray, tips: FloatArray) -> FloatArray:
    """Distance of every touch from the middle of its post's touches, (m, n, 1)."""
    touched = p + (tips @ R.reshape(-1, 3).T).reshape(len(tips), *p.shape)
    norms = np.zeros(touched.shape[:2])
    for rows in rows_of_each(index):
        middle = np.median(touched[:, rows], axis=1, keepdims=True)
        away = touched[:, rows] - middle
        norms[:, rows] = np.sqrt(np.einsum("mni,mni->mn", away, away))
    return norms[..., None]


def _start(R: FloatArray, p: FloatArray, index: IntArray, seed: int | None) -> Consensus:
    """What most poses agree on; all of them without a seed, or where they are too few to tell."""
    # Rows of a minimal sample: one more than needed, so that small turns do not decide by chance.
    sample = 4
    if seed is None or np.bincount(index).max() < sample + 1:
        norms = _norms(R, p, index, stacked_pivot(R, p, index)[None])
        return Consensus.of_all(len(p), float(np.sqrt(np.mean(norms**2) / 3.0)))

    def propose(rows: IntArray) -> FloatArray:
        used, place = np.unique(rows, return_inverse=True)
        weight = np.zeros((len(rows), len(used)))
        np.put_along_axis(weight, place.reshape(rows.shape), 1.0, axis=1)
        return stacked_pivot(R[used], p[used], index[used], weight)

    def residuals(tips: FloatArray, rows: IntArray) -> FloatArray:
        return _norms(R[rows], p[rows], index[rows], tips)

    samples = minimal_samples(index, sample, seed)
    posts = int(index.max()) + 1
    return find_consensus(len(p), samples, propose, residuals, 2 + posts)
