"""The stereotactic navigation problem: two trackers, two pivots, distortion, registration to CT.

An optical tracker and a distorted electromagnetic (EM) one observe a calibration object, each with
its own markers. Frames: ``T_em_base`` is what the optical tracker says of the EM tracker's base.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment
from suta_calib.geometry.numbers import extent, rms_length
from suta_calib.pose_calibration.inputs import error_context
from suta_calib.pose_calibration.pivot import PivotCalibration, calibrate_pivot
from suta_calib.pose_calibration.registration import Registration, kabsch, register
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
    DistortionCorrection,
    fit_distortion,
    fit_distortion_robustly,
    is_distorted,
)
from suta_calib.stereotactic.marker_cloud import BodyPoses, MarkerCloud
from suta_calib.units import mm

# Misfit of rigid markers, and of EM readings, that no noise or distortion of use makes, as part of
# the markers' extent.
MISSHAPEN: Final = 0.02
ELSEWHERE: Final = 0.05
USES: Final = {
    "em_pivot": "the EM pivot",
    "em_fiducials": "the fiducials",
    "em_nav": "the navigation frames",
}


@dataclass(frozen=True, eq=False)
class Navigation:
    """Where the EM probe's tip was in CT.

    Attributes:
        registration: ``T_ct_em`` by the fiducials.
        fiducials: (N_B, 3) the fiducials by the EM probe, corrected, in the EM tracker, m.
        em: (N_frames, 3) the tip while navigating, corrected, in the EM tracker, m.
    """

    registration: Registration
    fiducials: FloatArray
    em: FloatArray

    @property
    def ct(self) -> FloatArray:
        """(N_frames, 3) the tip while navigating, in CT, m."""
        return self.registration.act(self.em)

    @property
    def target_error(self) -> FloatArray:
        """(N_frames,) expected error there by the registration alone, 3-D RMS, m."""
        return self.registration.target_error(self.em)


@dataclass(frozen=True, eq=False)
class StereotacticResult:
    """Answer to the assignments.

    Attributes:
        data: what was given.
        expected: (N_frames, N_C, 3) where the EM markers were by the optical tracker, in the EM
            tracker, m.
        em_pivot: of the EM probe; its post is in the EM tracker.
        optical_pivot: of the optical probe; its post too is in the EM tracker.
        correction: of the EM distortion, if asked for.
        navigation: where it was asked for and the files are there.
        extrapolated: how many markers were seen outside what the correction is fitted to, by use:
            ``em_pivot``, ``em_fiducials``, ``em_nav``; empty without correction.
        outliers: how many markers were left out, by file; empty where all were believed.
    """

    data: StereotacticData
    expected: FloatArray
    em_pivot: PivotCalibration
    optical_pivot: PivotCalibration
    correction: DistortionCorrection | None
    navigation: Navigation | None
    extrapolated: Mapping[str, int]
    outliers: Mapping[str, int]

    @property
    def em_error(self) -> FloatArray:
        """(N_frames, N_C, 3) EM markers as measured minus where they were, m."""
        return self.data.readings.em - self.expected

    @property
    def assessment(self) -> Assessment:
        """Weighs the pivots, the registration, the distortion, and what was extrapolated."""
        parts: dict[str, PivotCalibration | Registration] = {
            "EM pivot": self.em_pivot,
            "optical pivot": self.optical_pivot,
        }
        if self.navigation is not None:
            parts["registration to CT"] = self.navigation.registration
        bad, care = _on_shapes(self), list[str]()
        # What does not fit together is not for dewarping to mend.
        distortion = [] if bad else _on_distortion(self)
        for name, part in parts.items():
            notes = [f"{name}: {note}" for note in part.assessment.notes]
            (care if part.assessment.usable else bad).extend(notes)
        return Assessment.of(bad=bad, care=[*care, *distortion])

    @property
    def output1(self) -> Output1:
        """What the first assignment asks for."""
        return Output1(self.em_pivot.post, self.optical_pivot.post, self.expected)


def solve_stereotactic(
    data: StereotacticData, *, dewarp: bool = False, robust: bool = False
) -> StereotacticResult:
    """Solve the problem.

    Args:
        data: the given files.
        dewarp: correct the EM tracker's distortion first.
        robust: hold single markers, frames and fiducials that do not fit the others for outliers.

    Raises:
        SamplesError: the data leave a pose, a pivot, the correction or the registration
            undetermined; says which file.

    Warns:
        UserWarning: markers were corrected outside what the correction is fitted to.
    """
    bodies = _Bodies(data, robust)
    expected = _expected_markers(bodies)
    correction = _correction(bodies, expected) if dewarp else None
    corrected = correction.correct if correction is not None else np.asarray
    frames = corrected(data.em_pivot)
    probe = MarkerCloud.from_frame(frames[0])
    em_pivot = bodies.pivot("empivot", probe, frames)
    # The base may move between frames: the optical pivot is solved in the EM tracker's frame.
    base = bodies.poses("optpivot", MarkerCloud(data.body.base), data.optical_pivot.base)
    frames = base.to_body(data.optical_pivot.probe)
    optical_pivot = bodies.pivot("optpivot", MarkerCloud.from_frame(frames[0]), frames)
    navigation = _navigate(bodies, corrected, probe, em_pivot.tip)
    return StereotacticResult(
        data,
        expected,
        em_pivot,
        optical_pivot,
        correction,
        navigation,
        _extrapolated(data, correction),
        bodies.outliers,
    )


class _Bodies:
    """Poses of marker bodies by the file their frames come from; counts outliers by file."""

    def __init__(self, data: StereotacticData, robust: bool) -> None:
        self.data, self.robust = data, robust
        self.outliers: dict[str, int] = {}

    def poses(self, kind: str, cloud: MarkerCloud, frames: FloatArray) -> BodyPoses:
        """Poses of one body; an error names the file."""
        with error_context(path_of(self.data.prefix, kind)):
            poses = cloud.poses(frames, robust=self.robust)
        if self.robust:
            self.outliers[kind] = self.outliers.get(kind, 0) + poses.outliers
        return poses

    def pivot(self, kind: str, cloud: MarkerCloud, frames: FloatArray) -> PivotCalibration:
        """Pivot calibration of one body; an error names the file."""
        poses = self.poses(kind, cloud, frames)
        with error_context(path_of(self.data.prefix, kind)):
            return calibrate_pivot(poses.rotation, poses.position, robust=self.robust)


def _expected_markers(bodies: _Bodies) -> FloatArray:
    """Where the EM markers were in the EM tracker: ``F_D⁻¹ F_A c`` (N_frames, N_C, 3), m.

    F_D is the pose of the EM tracker's base and F_A that of the object, in the optical tracker.
    """
    body, seen = bodies.data.body, bodies.data.readings
    base = bodies.poses("calreadings", MarkerCloud(body.base), seen.base)
    placed = bodies.poses("calreadings", MarkerCloud(body.optical), seen.optical)
    return base.to_body(placed.to_tracker(body.em))


def _correction(bodies: _Bodies, expected: FloatArray) -> DistortionCorrection:
    measured = bodies.data.readings.em
    with error_context(path_of(bodies.data.prefix, "calreadings")):
        if not bodies.robust:
            return fit_distortion(measured, expected)
        correction, wrong = fit_distortion_robustly(measured, expected)
    bodies.outliers["calreadings"] += int(wrong.sum())
    return correction


def _navigate(
    bodies: _Bodies,
    corrected: Callable[[FloatArray], FloatArray],
    probe: MarkerCloud,
    tip: FloatArray,
) -> Navigation | None:
    data, given = bodies.data, bodies.data.navigation
    if given is None:
        return None

    def tips(kind: str, frames: FloatArray) -> FloatArray:
        return bodies.poses(kind, probe, corrected(frames)).to_tracker(tip[None])[:, 0]

    fiducials, em = tips(EM_FIDUCIALS[0], given.em_fiducials), tips("EM-nav", given.em_nav)
    with error_context(path_of(data.prefix, "ct-fiducials")):
        registration = register(fiducials, given.ct_fiducials, robust=bodies.robust)
    return Navigation(registration, fiducials, em)


def _extrapolated(
    data: StereotacticData, correction: DistortionCorrection | None
) -> dict[str, int]:
    """Count, and tell, markers outside what the correction is fitted to."""
    if correction is None:
        return {}
    uses = _uses(data)
    counts = {use: int(np.sum(~correction.inside(points))) for use, points in uses.items()}
    for use, count in counts.items():
        if count:
            warnings.warn(
                f"{data.name}: {count} of {uses[use][..., 0].size} markers of {use} lie outside "
                "the calibrated volume, where the distortion is not known: calibrate there too",
                stacklevel=3,
            )
    return counts


def _uses(data: StereotacticData) -> dict[str, FloatArray]:
    """Markers (N_frames, n, 3) that the EM tracker saw, by what they were used for."""
    uses, given = {"em_pivot": data.em_pivot}, data.navigation
    if given is not None:
        uses |= {"em_fiducials": given.em_fiducials, "em_nav": given.em_nav}
    return uses


def _on_shapes(result: StereotacticResult) -> list[str]:
    """Markers that do not have the shape that calbody gives them: a unit, an order, a marker."""
    body, readings = result.data.body, result.data.readings
    seen = {
        "calreadings: D": (body.base, readings.base),
        "calreadings: A": (body.optical, readings.optical),
        "optpivot: D": (body.base, result.data.optical_pivot.base),
    }
    notes = [
        f"{where} markers of frame {int(np.argmax(rms)) + 1} stay {mm(rms.max()):.2f} mm RMS "
        "from calbody's: look for another unit or order, or for a wrong marker."
        for where, (given, frames) in seen.items()
        if (rms := _misfit(given, frames)).max() > MISSHAPEN * extent(given)
    ]
    off = rms_length(result.em_error)
    if off > ELSEWHERE * extent(body.em):
        notes.append(
            f"The EM markers are read {mm(off):.1f} mm RMS from where the optical tracker says: "
            "more than distortion; look for another unit or order of the C markers."
        )
    return notes


def _misfit(given: FloatArray, frames: FloatArray) -> FloatArray:
    """RMS distance (N_frames,) of each frame's markers from the given ones laid over them, m."""
    same = np.broadcast_to(given, frames.shape)
    R, p = kabsch(same, frames)
    apart = np.einsum("fij,fmj->fmi", R, same) + p[:, None] - frames
    return np.asarray(np.sqrt(np.mean(np.sum(apart**2, axis=2), axis=1)))


def _on_distortion(result: StereotacticResult) -> list[str]:
    correction, measured = result.correction, result.data.readings.em
    if correction is None:
        if not is_distorted(measured, result.expected):
            return []
        return [
            f"The EM tracker's readings are {mm(rms_length(result.em_error)):.2f} mm off where "
            "the optical tracker says, most of it distortion: --dewarp corrects it."
        ]
    seen = _uses(result.data)
    return [
        f"{count} of {seen[use][..., 0].size} markers of {USES[use]} lie outside the calibrated "
        "volume, where the distortion is not known."
        for use, count in result.extrapolated.items()
        if count
    ]


@dataclass(frozen=True, eq=False)
class StereotacticErrors:
    """Distances of the answer from the given one; None where that file is not there.

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
    (output1, output2), found = given, result.navigation
    navigation = None
    if found is not None and output2 is not None:
        navigation = np.asarray(np.linalg.norm(found.ct - output2, axis=1))
    if output1 is None:
        return StereotacticErrors(navigation=navigation)
    return StereotacticErrors(
        np.asarray(np.linalg.norm(result.expected - output1.expected, axis=-1)),
        float(np.linalg.norm(result.em_pivot.post - output1.em_post)),
        float(np.linalg.norm(result.optical_pivot.post - output1.optical_post)),
        navigation,
    )
