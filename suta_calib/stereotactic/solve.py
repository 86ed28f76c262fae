"""The stereotactic navigation problem: two trackers, two pivots, distortion, registration to CT.

An optical tracker and a distorted electromagnetic (EM) one observe a calibration object, each with
its own markers. Frames: ``T_em_base`` is what the optical tracker says of the EM tracker's base.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Final, TypeVar

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment, attempt, judge, judged
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import extent, register_points, rms_length
from suta_calib.pose_calibration.inputs import error_context
from suta_calib.pose_calibration.pivot import PivotCalibration, calibrate_pivot
from suta_calib.pose_calibration.registration import Registration, register
from suta_calib.stereotactic.cis_files import (
    EM_FIDUCIALS,
    Output1,
    StereotacticData,
    agree,
    path_of,
    read_output1,
    read_points,
)
from suta_calib.stereotactic.distortion import (
    HARMLESS,
    DistortionCorrection,
    far_off,
    fit_distortion_robustly,
    is_distorted,
    smooth_distortion,
)
from suta_calib.stereotactic.left_out import (
    left_out_of_pivot,
    left_out_of_registration,
    robust_predicts_better,
)
from suta_calib.stereotactic.marker_cloud import BodyPoses, MarkerCloud, ObservedBody
from suta_calib.stereotactic.navigation import Navigation
from suta_calib.stereotactic.shapes import (
    EXPLAINED,
    MOST_FRAMES,
    GivenShape,
    ObservedProbe,
    on_given_shapes,
    on_late_base,
    on_probe,
)
from suta_calib.units import mm
from suta_calib.words import listed

A = TypeVar("A", PivotCalibration, Registration)
# Files with frames of the EM probe; the first one defines its shape.
EM_PROBE: Final = ("empivot", EM_FIDUCIALS[0], "EM-nav")
# The EM tracker's base and the calibration object, as the optical tracker sees them.
BASE, PLACED, PIVOT_BASE = "calreadings: D", "calreadings: A", "optpivot: D"
USES: Final = {
    "em_pivot": "the EM pivot",
    "em_fiducials": "the fiducials",
    "em_nav": "the navigation frames",
}


@dataclass(frozen=True, eq=False)
class StereotacticResult(Displayable):
    """Result of the navigation problem.

    Attributes:
        data: what was given.
        expected: (N_frames, N_C, 3) where the EM markers were by the optical tracker, in the EM
            tracker, m.
        em_pivot: of the EM probe; its post is in the EM tracker.
        optical_pivot: of the optical probe; its post too is in the EM tracker.
        correction: of the EM distortion, if asked for.
        navigation: where it was asked for and the files are there.
        extrapolated: how many markers were seen outside what the correction is fitted to, by use:
            ``em_pivot``, ``em_fiducials``, ``em_nav``; empty without correction. The covariance of
            `em_pivot` allows for it.
        outliers: how many markers were left out, by file; empty where all were believed.
        bodies: rigid bodies as they were seen, those of the EM probe corrected: by file, and by
            file and letter of the markers.
    """

    data: StereotacticData
    expected: FloatArray
    em_pivot: PivotCalibration
    optical_pivot: PivotCalibration
    correction: DistortionCorrection | None
    navigation: Navigation | None
    extrapolated: Mapping[str, int]
    outliers: Mapping[str, int]
    bodies: Mapping[str, ObservedBody]

    @property
    def em_error(self) -> FloatArray:
        """(N_frames, N_C, 3) EM markers as measured minus where they were, m."""
        return self.data.readings.em - self.expected

    @cached_property
    def bent(self) -> bool:
        """Whether the EM readings are distorted, and not corrected."""
        return self.correction is None and is_distorted(self.data.readings.em, self.expected)

    @property
    @judged
    def assessment(self) -> Assessment:
        """Verdict from the pivots, the registration, the distortion, and the extrapolation."""
        parts: dict[str, PivotCalibration | Registration] = {
            "EM pivot": self.em_pivot,
            "optical pivot": self.optical_pivot,
        }
        if self.navigation is not None:
            parts["registration to CT"] = self.navigation.registration
        failed = list[str]()
        misread = judge("the EM markers", lambda: _on_em_markers(self), failed)
        nothing = list[str](), list[str]()
        judge_bodies = partial(_on_bodies, self, misread=bool(misread))
        bad, care = attempt("judged: the bodies", judge_bodies, nothing, failed)
        bad += misread
        # What does not fit together is not for dewarping to mend.
        distortion = [] if bad else judge("distortion", lambda: _on_distortion(self), failed)
        for name, part in parts.items():
            # What every answer of its kind relies on is no news here.
            news = (n for n in part.assessment.notes if n != getattr(part, "relied_on", ""))
            notes = [f"{name}: {note}" for note in news]
            (care if part.assessment.usable else bad).extend(notes)
        # What is bent is off for that reason.
        if self.navigation is not None and (self.correction is not None or not distortion):
            care += filter(None, [self.navigation.unexplained])
        return Assessment.of(bad=bad, care=[*care, *distortion, *failed])

    @property
    def output1(self) -> Output1:
        """The output of the first assignment."""
        return Output1(self.em_pivot.post, self.optical_pivot.post, self.expected)


def solve_stereotactic(
    data: StereotacticData, *, dewarp: bool = False, robust: bool | None = None
) -> StereotacticResult:
    """Solve the problem.

    Args:
        data: the given files.
        dewarp: correct the EM tracker's distortion first.
        robust: whether single markers, frames and fiducials that do not fit the others are left
            out as outliers; None: in each step for itself, where that predicts left-out frames
            better.

    Raises:
        SamplesError: the data leave a pose, a pivot, the correction or the registration
            undetermined; says which file.
    """
    bodies = _Bodies(data, robust)
    expected = _expected_markers(bodies)
    correction = _correction(bodies, expected) if dewarp else None
    corrected = correction.correct if correction is not None else np.asarray
    frames = corrected(data.em_pivot)
    probe = MarkerCloud.from_frame(frames[0])
    em_pivot = bodies.pivot(EM_PROBE[0], probe, frames)
    if correction is not None:
        # All frames are about one place, where the correction errs alike: that moves the post.
        common = correction.extrapolation_error(data.em_pivot) ** 2 / 3.0
        covariance = em_pivot.covariance + np.diag([0.0, 0.0, 0.0, common, common, common])
        em_pivot = replace(em_pivot, covariance=covariance)
    # The base may move between frames: the optical pivot is solved in the EM tracker's frame.
    base = bodies.poses(PIVOT_BASE, MarkerCloud(data.body.base), data.optical_pivot.base)
    frames = base.to_body(data.optical_pivot.probe)
    optical_pivot = bodies.pivot("optpivot", MarkerCloud.from_frame(frames[0]), frames)
    navigation = _navigate(bodies, correction, probe, em_pivot.tip)
    outside = dict[str, int]()
    if correction is not None:
        outside = {u: int(np.sum(~correction.inside(p))) for u, p in data.em_uses.items()}
    return StereotacticResult(
        *(data, expected, em_pivot, optical_pivot, correction, navigation, outside),
        *(bodies.outliers, bodies.seen),
    )


class _Bodies:
    """Poses of marker bodies by the file their frames come from; counts outliers by file."""

    def __init__(self, data: StereotacticData, robust: bool | None) -> None:
        self.data, self.robust = data, robust
        self.outliers: dict[str, int] = {}
        self.seen: dict[str, ObservedBody] = {}

    def poses(self, name: str, cloud: MarkerCloud, frames: FloatArray) -> BodyPoses:
        """Poses of one body, named by its file and the letter of its markers; so is an error."""
        kind = name.partition(":")[0]
        with error_context(path_of(self.data.prefix, kind)):
            poses = cloud.poses(frames, robust=self.robust)
        if self.robust is not False:
            self.outliers[kind] = self.outliers.get(kind, 0) + poses.outliers
        self.seen[name] = ObservedBody(cloud, frames, poses)
        return poses

    def pivot(self, kind: str, cloud: MarkerCloud, frames: FloatArray) -> PivotCalibration:
        """Pivot calibration of one body; an error names the file."""
        poses = self.poses(kind, cloud, frames)
        R, p = poses.rotation, poses.position
        with error_context(path_of(self.data.prefix, kind)):
            return self.better(
                lambda robust: calibrate_pivot(R, p, robust=robust),
                lambda calibration: left_out_of_pivot(R, p, calibration.inliers),
            )

    def better(self, solve: Callable[[bool], A], left_out: Callable[[A], FloatArray]) -> A:
        """The answer as asked for; or the one that predicts left-out rows better."""
        if self.robust is not None:
            return solve(self.robust)
        try:
            robust = solve(True)
        except SamplesError:
            return solve(False)
        try:
            plain = solve(False)
        except SamplesError:
            # Gross errors may leave nothing that all rows together fit.
            return robust
        if robust.inliers.all():
            return plain
        return robust if robust_predicts_better(left_out(plain), left_out(robust)) else plain


def _expected_markers(bodies: _Bodies) -> FloatArray:
    """Where the EM markers were in the EM tracker: ``F_D⁻¹ F_A c`` (N_frames, N_C, 3), m.

    F_D is the pose of the EM tracker's base and F_A that of the object, in the optical tracker.
    """
    body, readings = bodies.data.body, bodies.data.readings
    base = bodies.poses(BASE, MarkerCloud(body.base), readings.base)
    placed = bodies.poses(PLACED, MarkerCloud(body.optical), readings.optical)
    return base.to_body(placed.to_tracker(body.em))


def _correction(bodies: _Bodies, expected: FloatArray) -> DistortionCorrection:
    measured = bodies.data.readings.em
    used = np.concatenate([points.reshape(-1, 3) for points in bodies.data.em_uses.values()])
    with error_context(path_of(bodies.data.prefix, "calreadings")):
        correction, wrong = fit_distortion_robustly(measured, expected, used, robust=bodies.robust)
    if bodies.robust is not False:
        bodies.outliers["calreadings"] += int(wrong.sum())
    return correction


def _navigate(
    bodies: _Bodies,
    correction: DistortionCorrection | None,
    probe: MarkerCloud,
    tip: FloatArray,
) -> Navigation | None:
    data, given = bodies.data, bodies.data.navigation
    if given is None:
        return None

    def tips(kind: str, frames: FloatArray) -> FloatArray:
        corrected = frames if correction is None else correction.correct(frames)
        return bodies.poses(kind, probe, corrected).to_tracker(tip[None])[:, 0]

    fiducials, em = tips(EM_FIDUCIALS[0], given.em_fiducials), tips(EM_PROBE[2], given.em_nav)
    with error_context(path_of(data.prefix, "ct-fiducials")):
        registration = bodies.better(
            lambda robust: register(fiducials, given.ct_fiducials, robust=robust),
            lambda registration: left_out_of_registration(
                fiducials, given.ct_fiducials, registration.inliers
            ),
        )

    def tip_error(frames: FloatArray) -> FloatArray:
        if correction is not None:
            return probe.amplified(tip) * correction.body_error(frames)
        # What the markers miss the probe's shape by, which is of a frame as well: both are read
        # wrongly. Six numbers of a frame are its pose's.
        scatter = rms_length(ObservedBody(probe, frames, probe.poses(frames)).misfit[:, None])
        free = 2 * max(len(probe.markers) - 2, 1)
        return np.full(len(frames), probe.amplified(tip) * scatter / np.sqrt(free))

    errors = tip_error(given.em_nav), tip_error(given.em_fiducials)
    return Navigation(registration, fiducials, em, *errors)


def _on_em_markers(result: StereotacticResult) -> list[str]:
    """EM markers far from where they should be read, where that is not distortion.

    Distortion belongs to a place: a smooth polynomial of it predicts the error in frames that were
    left out. A wrong unit or order belongs to the marker: it is off by the same in every frame.
    """
    body, measured, expected = result.data.body.em, result.data.readings.em, result.expected
    off = rms_length(result.em_error)
    # Misfit of EM readings from which a reason is looked for, as part of the markers' extent.
    if off <= 0.05 * extent(body):
        return []
    sentence = (
        f"The EM markers are read {mm(off):.1f} mm RMS from the places that the optical tracker "
        "measured"
    )
    read, there = (v.reshape(-1, 3) - v.mean(axis=(0, 1)) for v in (measured, expected))
    affine = np.linalg.lstsq(there, read, rcond=None)[0]
    # A field bends by less than half; what is turned or stretched by more is in other axes or
    # units.
    if np.linalg.norm(affine - np.eye(3), 2) > 0.5:
        axes = "look for another unit, or other axes, of the C markers in calreadings."
        return [f"{sentence}: {axes}"]
    R = register_points(np.broadcast_to(body, expected.shape), expected)[0]
    by_marker = result.em_error @ R
    frames = len(by_marker)
    # Each frame less the mean of the others.
    left_out = (by_marker - by_marker.mean(axis=0)) * frames / max(frames - 1, 1)
    try:
        by_place = min(smooth_distortion(measured, expected).cross_validation.values())
    except SamplesError:
        by_place = off
    if by_place < EXPLAINED * off and (frames < 2 or by_place < rms_length(left_out)):
        return []
    return [
        f"{sentence}. Distortion does not look like this: look for another unit or order of "
        "the C markers."
    ]


def _on_bodies(result: StereotacticResult, *, misread: bool) -> tuple[list[str], list[str]]:
    """Contradictions from the shapes of rigid bodies: bad, care."""
    bodies, body, correction = result.bodies, result.data.body, result.correction
    base, placed, measured = bodies[BASE], bodies[PLACED], result.data.readings.em
    robust, expected = bool(result.outliers), "the expected EM markers"
    # What the correction is fitted to errs as the object's pose does, and the EM post with it.
    em_std = None if correction is None else float(np.linalg.norm(result.em_pivot.post_std()))
    em = (expected, "the EM post", em_std)
    post, std = result.optical_pivot.post[None], np.linalg.norm(result.optical_pivot.post_std())
    optical = ("the optical post", "it", float(std))
    bad, care = on_given_shapes(
        [
            GivenShape("calreadings", "D", base, result.expected.reshape(-1, 3), *em),
            GivenShape("optpivot", "D", bodies[PIVOT_BASE], post, *optical),
            GivenShape("calreadings", "A", placed, body.em, *em),
        ],
        robust=robust,
    )
    late, maybe_late = on_late_base(base.poses, placed.poses, body.em, measured)
    bad, care = [*bad, *late], [*care, *maybe_late]
    bent = result.bent
    # An uncorrected field bends the object too, alike in many frames; so do wrong poses of it.
    if not (bent or misread or bad or care):
        cloud = MarkerCloud(body.em)
        frames = measured if correction is None else correction.correct(measured)
        observed = ObservedBody(cloud, frames, BodyPoses(*register_points(cloud.markers, frames)))
        object_ = GivenShape("calreadings", "C", observed, body.em, *em, bent=True)
        bad, care = on_given_shapes([object_], robust=robust)
    of_probe = {kind: bodies[kind] for kind in EM_PROBE if kind in bodies}
    outside = dict[str, FloatArray]()
    if correction is not None:
        outside = {
            kind: np.array([correction.extrapolation_error(frame) for frame in frames])
            for kind, frames in zip(EM_PROBE, result.data.em_uses.values(), strict=False)
        }
    stated = {} if result.navigation is None else {EM_PROBE[2]: result.navigation.tip_error}
    probe = on_probe(ObservedProbe(of_probe, bent, outside, result.em_pivot.tip, stated))
    return [*bad, *probe[0]], [*care, *probe[1]]


def _on_distortion(result: StereotacticResult) -> list[str]:
    correction = result.correction
    if correction is None:
        if not result.bent:
            return []
        return [
            f"The EM tracker's readings are {mm(rms_length(result.em_error)):.2f} mm from the "
            "places that the optical tracker measured, and most of this is distortion. Use "
            "--dewarp to correct it."
        ]
    notes = list[str]()
    far = far_off(correction.residuals)
    if far.any() and "calreadings" not in result.outliers:
        frames, sizes = np.flatnonzero(far.any(axis=1)) + 1, correction.residuals[far]
        notes.append(
            f"calreadings: {int(far.sum())} of {far.size} EM markers are up to "
            f"{mm(np.linalg.norm(sizes, axis=1).max()):.2f} mm from the places that the other "
            f"frames predict (frame {listed([str(frame) for frame in frames], MOST_FRAMES)}). They "
            "make the correction wrong near these places. Use --robust to leave them out."
        )
    for use, points in result.data.em_uses.items():
        error = correction.extrapolation_error(points)
        if error > max(correction.cross_validation[correction.degree], HARMLESS):
            notes.append(
                f"{result.extrapolated[use]} of {points[..., 0].size} markers of {USES[use]} lie "
                "outside the calibrated volume, by up to "
                f"{mm(correction.outside(points).max()):.0f} mm: the correction there is good "
                f"to ± {mm(error):.2f} mm only (3-D RMS)."
            )
    return notes


@dataclass(frozen=True, eq=False)
class StereotacticErrors(Displayable):
    """Distances between the result and the given one; None if that file is missing.

    Attributes:
        expected: (N_frames, N_C) of the expected EM markers, m.
        em_post: of the EM post, m.
        optical_post: of the optical post, m.
        navigation: (N_frames,) of the tips in CT, m.
    """

    expected: FloatArray | None = None
    em_post: float | None = None
    optical_post: float | None = None
    navigation: FloatArray | None = None


GivenOutputs = tuple[Output1 | None, FloatArray | None]


def read_given(result: StereotacticResult) -> GivenOutputs:
    """``-output1.txt`` and, where there is a navigation, ``-output2.txt`` beside the inputs.

    Returns:
        The first; of the second the (N_frames, 3) tips in CT, m; None for what is not there.

    Raises:
        SamplesError: one is malformed or its counts are not those of the inputs.
    """
    data, output1, output2 = result.data, None, None
    path, readings = path_of(data.prefix, "output1"), path_of(data.prefix, "calreadings")
    if os.path.lexists(path):
        output1, em = read_output1(path), data.readings.em
        agree(path, "N_C", output1.expected.shape[1], "EM markers", em.shape[1], readings)
        agree(path, "N_frames", len(output1.expected), "frames", len(em), readings)
    path = path_of(data.prefix, "output2")
    if data.navigation is not None and os.path.lexists(path):
        output2, frames = read_points(path), len(data.navigation.em_nav)
        agree(path, "N_frames", len(output2), "frames", frames, path_of(data.prefix, "EM-nav"))
    return output1, output2


def compare(result: StereotacticResult, given: GivenOutputs) -> StereotacticErrors:
    """Distances of the result from what is given."""
    (output1, output2), navigated, navigation = given, result.navigation, None
    if navigated is not None and output2 is not None:
        navigation = np.asarray(np.linalg.norm(navigated.ct - output2, axis=1))
    if output1 is None:
        return StereotacticErrors(navigation=navigation)
    return StereotacticErrors(
        np.asarray(np.linalg.norm(result.expected - output1.expected, axis=-1)),
        float(np.linalg.norm(result.em_pivot.post - output1.em_post)),
        float(np.linalg.norm(result.optical_pivot.post - output1.optical_post)),
        navigation,
    )
