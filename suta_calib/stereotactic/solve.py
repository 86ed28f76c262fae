"""The stereotactic navigation problem: two trackers, two pivots, distortion, registration to CT.

An optical tracker and a distorted electromagnetic (EM) one observe a calibration object, each with
its own markers. Frames: ``T_em_base`` is what the optical tracker says of the EM tracker's base.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.pose_calibration.error_context import error_context
from suta_calib.pose_calibration.pivot import PivotCalibration, calibrate_pivot
from suta_calib.pose_calibration.registration import Registration, register
from suta_calib.stereotactic.cis_files import Output1
from suta_calib.stereotactic.data import (
    EM_FIDUCIALS,
    StereotacticData,
    path_of,
)
from suta_calib.stereotactic.distortion import DistortionCorrection, fit_distortion
from suta_calib.stereotactic.marker_cloud import BodyPoses, MarkerCloud
from suta_calib.stereotactic.robust_distortion import fit_distortion_robustly


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
    em_pivot = _pivot(bodies.poses("empivot", probe, frames), data, "empivot", robust=robust)
    optical_pivot = _optical_pivot(bodies)
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


def _expected_markers(bodies: _Bodies) -> FloatArray:
    """Where the EM markers on the calibration object were: ``F_D⁻¹ F_A c``, every frame.

    F_D is the pose of the EM tracker's base and F_A that of the object, in the optical tracker.

    Returns:
        (N_frames, N_C, 3) in the EM tracker, m.
    """
    body, seen = bodies.data.body, bodies.data.readings
    base = bodies.poses("calreadings", MarkerCloud(body.base), seen.base)
    placed = bodies.poses("calreadings", MarkerCloud(body.optical), seen.optical)
    return base.to_body(placed.to_tracker(body.em))


def _correction(bodies: _Bodies, expected: FloatArray) -> DistortionCorrection:
    measured, kind = bodies.data.readings.em, "calreadings"
    with error_context(path_of(bodies.data.prefix, kind)):
        if not bodies.robust:
            return fit_distortion(measured, expected)
        correction, wrong = fit_distortion_robustly(measured, expected)
    bodies.outliers[kind] += int(wrong.sum())
    return correction


def _optical_pivot(bodies: _Bodies) -> PivotCalibration:
    """The optical pivot in the EM tracker's frame, whose base may move between frames."""
    data = bodies.data
    base = bodies.poses("optpivot", MarkerCloud(data.body.base), data.optical_pivot.base)
    frames = base.to_body(data.optical_pivot.probe)
    poses = bodies.poses("optpivot", MarkerCloud.from_frame(frames[0]), frames)
    return _pivot(poses, data, "optpivot", robust=bodies.robust)


def _pivot(
    poses: BodyPoses, data: StereotacticData, kind: str, *, robust: bool
) -> PivotCalibration:
    with error_context(path_of(data.prefix, kind)):
        return calibrate_pivot(poses.rotation, poses.position, robust=robust)


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
    uses = {"em_pivot": data.em_pivot}
    if data.navigation is not None:
        uses |= {k: getattr(data.navigation, k) for k in ("em_fiducials", "em_nav")}
    counts = {use: int(np.sum(~correction.inside(points))) for use, points in uses.items()}
    for use, count in counts.items():
        if count:
            warnings.warn(
                f"{data.name}: {count} of {uses[use][..., 0].size} markers of {use} lie outside "
                "the calibrated volume, where the distortion is not known: calibrate there too",
                stacklevel=3,
            )
    return counts
