"""A line scanner on the hand, from profiles of a ball or a plane and the poses of the hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import Assessment, judged
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import homogeneous
from suta_calib.measurements.pose_files import ScanPoses
from suta_calib.measurements.profiles import Profiles
from suta_calib.measurements.samples import Samples
from suta_calib.pose_calibration.eye_poses import ENOUGH, AccuracyOfX, placed_points
from suta_calib.pose_calibration.inputs import checked_poses, error_context
from suta_calib.pose_calibration.robust_answer import MANY_OUTLIERS, FittedRows, set_aside
from suta_calib.terms.poses import MeasuredPoses
from suta_calib.terms.profile_fit import ScanFit, causes, fit_scans, model_of
from suta_calib.terms.profile_rows import with_profiles
from suta_calib.terms.profile_start import BallModel, in_scanner
from suta_calib.trust.uncertainty_budget import (
    AS_STATED,
    KnownScatter,
    UncertaintyBudget,
    pose_budgets,
)
from suta_calib.units import from_deg, mm, text
from suta_calib.words import listed

_ADVICE: Final = (
    "turn the scanner by 20° or more about all three axes, and let it cut the {0} at different "
    "places and distances"
)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class LineScannerCalibration(Displayable, AccuracyOfX, FittedRows):
    """Pose X of a line scanner on the hand, and the ball or plane that it saw.

    The covariance (6, 6) is of X: displacement (m, hand's axes) and small turn (rad, scanner's
    axes); residuals are of every scan in the base: where it has the ball's centre, from the mean of
    the fitted ones, or how far over the plane it lies.

    Attributes:
        X: (4, 4), ``T_hand_eye``; m.
        place: (3,) centre of the ball in the base, or the point of the plane next to the base's
            origin, m.
        place_std: (3,) standard deviations of the ball's centre, m; of a plane, across it.
        normal: (3,) of the plane, in the base; None of a ball.
        radius, radius_std: of the ball, m; the latter is zero where it was said. None of a plane.
        scans: (n,) names of the scans.
        hand_noise: what the hand seems to err by, one standard deviation, m per axis.
        profiles: (k, 3) points of all profiles on the ball or the plane, in the base, m.
        wrong: why X must not be used, one sentence each.
        scatter: how well the scatter behind the covariance is known.
        by_source: (6, 6) parts of the covariance, by what errs; the rest are the profiles' points.
    """

    X: FloatArray
    place: FloatArray
    place_std: FloatArray
    normal: FloatArray | None
    radius: float | None
    radius_std: float
    scans: NDArray[np.str_]
    hand_noise: float
    profiles: FloatArray
    wrong: tuple[str, ...] = ()
    scatter: KnownScatter = AS_STATED
    by_source: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def budgets(self) -> tuple[UncertaintyBudget, ...]:
        """What the uncertainty of X is made of: its place, and its turn."""
        return pose_budgets("X", self.covariance, self.scatter, shown=self.by_source)

    @property
    def seen(self) -> str:
        """What was scanned."""
        return "ball" if self.normal is None else "plane"

    @property
    def spread(self) -> FloatArray:
        """(3,) standard deviation of the fitted scans' places of the ball in the base, m."""
        return np.asarray(self.residuals[self.inliers].std(axis=0, ddof=1))

    @property
    def in_a_line(self) -> str:
        """How well the scans agree."""
        return f"RMS {text(self.rms, 'm')} mm over {int(self.inliers.sum())} scans"

    def in_base(self, hand: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points (k, 2), x and z of a profile, in the base, m, and their standard deviations.

        These are by how well X is known.

        Args:
            hand: (4, 4) ``T_base_hand``, m.
            points: in the scanner's plane, m.
        """
        return placed_points(hand, self.X, self.covariance, in_scanner(points))

    @property
    @judged
    def assessment(self) -> Assessment:
        """How far to trust X."""
        care, bad, count = list[str](), list(self.wrong), int(self.inliers.sum())
        if (share := 1.0 - float(self.inliers.mean())) > MANY_OUTLIERS:
            bad.append(f"{share:.0%} of the scans do not agree with the others.")
        if count < ENOUGH:
            care.append(
                f"Only {count} scans: the standard deviations are uncertain, and a wrong scan may "
                "stay unnoticed. Take a dozen or more."
            )
        if self.unsure():
            care.append(f"{self.unsure()}. To improve it, {_ADVICE.format(self.seen)}.")
        statement = f"X is known to {self.within} (one standard deviation, 3-D)"
        return Assessment.of(
            "" if bad else f"{statement}; {self.agreed('scans')}",
            bad=bad,
            care=[*care, *self.notes, *set_aside("scans", self.inliers)],
        )


def calibrate_line_scanner(
    hand: tuple[FloatArray, FloatArray],
    scans: Sequence[str],
    profiles: Profiles,
    *,
    radius: float | None = None,
    plane: bool = False,
    robust: bool = True,
) -> LineScannerCalibration:
    """X of a line scanner on the hand, from profiles of a ball or a plane that stands anywhere.

    Every profile counts as the few numbers that it shows, weighed by the noise of the hand and of
    the scanner that all of them show (`fit_scans`). The points beside the ball are left out.

    Args:
        hand: ``T_base_hand`` of every scan: rotations (n, 3, 3) and positions (n, 3), m.
        scans: (n,) names of the scans.
        profiles: of these scans, and perhaps of others.
        radius: of the ball, m; unknown by default.
        plane: whether a plane was scanned.
        robust: False for least squares over all scans.

    Raises:
        SamplesError: too few scans that show the ball or the plane, or scans that do not determine
            X, with the directions.
    """
    rotation, position = checked_poses(*hand, "hand")
    names = np.array(scans, dtype=np.str_)
    samples = Samples.from_arrays([], np.zeros((len(names), 0)), labels={"scan": names})
    poses, lost = with_profiles(
        MeasuredPoses(rotation, position, samples), profiles, radius, plane=plane
    )
    names, pixels = poses.samples.labels["scan"], poses.samples.pixels
    assert pixels is not None
    points = [p[np.isfinite(p).all(axis=1)] for p in pixels]
    what, per_scan = ("plane", 2) if plane else ("ball", 3)
    unknowns = 9 + (not plane and radius is None)
    least = -(-unknowns // per_scan) + 1
    if len(names) < least:
        raise SamplesError(
            f"{len(names)} scans that show the {what}",
            f"at least {least}",
            where="profiles",
            hint=lost or f"take a dozen or more: {_ADVICE.format(what)}",
        )
    model = model_of(poses.at({}), points, radius, plane=plane)
    fit = fit_scans(model, robust=robust)
    _refuse_open(fit, what)
    notes, wrong = [f"{lost}."] if lost else [], list[str]()
    explained = causes(fit, names.tolist())
    if not robust and (at_once := fit_scans(model)).outliers:
        explained = causes(at_once, names.tolist())
        named = listed([str(names[k]) for k in at_once.outliers])
        wrong.append(f"Of the scans, {named} contradict the others. Solve without --no-robust.")
    notes += explained
    if isinstance(model, BallModel) and radius is not None:
        (wrong if (other := _other_radius(fit, model, radius)).bad else notes).extend(other.said)
    return _answer(
        fit, names, np.flatnonzero(np.isin(scans, names)), points, tuple(notes), tuple(wrong)
    )


def line_scanner_from_files(
    poses: ScanPoses, profiles: Profiles, *, radius: float | None, plane: bool, robust: bool = True
) -> LineScannerCalibration:
    """`calibrate_line_scanner` of files: errors name them, so do notes on their units."""
    with error_context(profiles.path):
        answer = calibrate_line_scanner(
            poses.pose, poses.scan.tolist(), profiles, radius=radius, plane=plane, robust=robust
        )
    return replace(answer, wrong=(*answer.wrong, *poses.unit_notes))


def _answer(
    fit: ScanFit,
    names: NDArray[np.str_],
    numbers: IntArray,
    points: Sequence[FloatArray],
    notes: tuple[str, ...],
    wrong: tuple[str, ...],
) -> LineScannerCalibration:
    model, state = fit.model, fit.state
    rest, turn = state.rest[0], state.rotation[0]
    order = [3, 4, 5, 0, 1, 2]
    (R, p), std = model.hand, np.sqrt(np.diag(fit.covariance))
    every = np.concatenate(
        [
            np.column_stack([q[:, 0], np.zeros(len(q)), q[:, 1]]) @ turn.T @ R[k].T
            + (R[k] @ rest[:3] + p[k])
            for k, q in enumerate(points)
        ]
    )
    if isinstance(model, BallModel):
        centres = model.seen_centres(state)
        place, normal, residuals = rest[3:6], None, centres - centres[fit.inliers].mean(axis=0)
        size, place_std = float(model.size(state)[0]), std[6:9]
        size_std = float(std[9]) if model.radius is None else 0.0
    else:
        sign = -1.0 if rest[5] < 0 else 1.0
        normal, size, size_std = sign * rest[3:6], None, 0.0
        place, place_std = sign * rest[6] * normal, np.abs(normal) * std[9]
        heights = model.residuals(state)[0][0].mean(axis=1)
        residuals = sign * heights[:, None] * normal
    return LineScannerCalibration(
        X=homogeneous(turn, rest[:3]),
        covariance=fit.covariance[np.ix_(order, order)],
        place=place,
        place_std=place_std,
        normal=normal,
        radius=size,
        radius_std=size_std,
        scans=names,
        residuals=residuals,
        inliers=fit.inliers,
        suspects=np.zeros_like(fit.inliers),
        numbers=numbers,
        hand_noise=float(fit.levels[0]),
        profiles=every,
        notes=notes,
        wrong=wrong,
        scatter=KnownScatter(float(fit.freedom), student=True),
        by_source={
            words: part[np.ix_(order, order)]
            for words, part in zip(model.sources, fit.by_source, strict=True)
        },
    )


def _refuse_open(fit: ScanFit, what: str) -> None:
    """Refuse scans that leave X open, and say where it may move."""
    parts = []
    # Standard deviations of X from which on it is not known at all, m and rad.
    for first, most, words in (
        (3, 50e-3, "slide along {} of the hand"),
        (0, from_deg(10.0), "turn"),
    ):
        size, axes = np.linalg.eigh(fit.covariance[first : first + 3, first : first + 3])
        if not size[-1] <= most**2:
            axis = "(" + ", ".join(f"{v:.2f}" for v in axes[:, -1]) + ")"
            parts.append(words.format(axis) if first else f"turn about {axis} of the scanner")
    if parts:
        raise SamplesError(
            f"scans that do not determine X: it may {' and '.join(parts)}",
            "scans with the scanner turned about different axes",
            where="profiles",
            hint=_ADVICE.format(what),
        )


@dataclass(frozen=True)
class _Radius:
    """What the scans say against the radius of the ball that was given."""

    said: tuple[str, ...] = ()
    bad: bool = False


def _other_radius(fit: ScanFit, model: BallModel, radius: float) -> _Radius:
    """Whether a ball of another radius fits the scans that agree clearly better."""
    rows = np.flatnonzero(fit.inliers).astype(np.intp)
    unknown = BallModel(model.hand, model.arcs, None, model.scatter).take(rows)
    free = fit_scans(unknown, robust=False)
    fitted, std = float(unknown.size(free.state)[0]), float(np.sqrt(free.covariance[9, 9]))
    off = abs(fitted - radius)
    # A hundredth changes little, and is within what arcs are told to.
    # Standard deviations by which the radius that fits best may differ from the one that is said.
    if free.freedom < 3 or off < max(4.0 * std, 0.01 * radius):
        return _Radius()
    doubled = " Is it the diameter?" if abs(fitted / radius - 0.5) < 0.1 else ""
    sentence = (
        f"sphere_radius_mm is {mm(radius):g}, but the scans fit a ball of {mm(fitted):.2f} ± "
        f"{mm(std):.2f} mm radius.{doubled} Correct it, or leave it out: it is found then."
    )
    return _Radius((sentence,), off > 0.1 * radius)
