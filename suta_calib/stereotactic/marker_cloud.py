"""Poses of a rigid body from the markers on it, in many frames at once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
from scipy.special import chdtri

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import register_points
from suta_calib.pose_calibration.consensus import DIMENSION, outlier_limit
from suta_calib.pose_calibration.rigid_fit import (
    ENOUGH_TO_JUDGE,
    LEAST_POINTS,
    MIRRORED,
    ON_A_LINE,
    agreeing_points,
)

# Numbers that a pose takes of its markers'.
OF_A_POSE: Final = 6


@dataclass(frozen=True, eq=False)
class BodyPoses:
    """``T_tracker_body`` of every frame.

    Attributes:
        rotation: (N_frames, 3, 3).
        position: (N_frames, 3), m.
        used: (N_frames, n) markers that were not held for outliers; None where all are believed.
    """

    rotation: FloatArray
    position: FloatArray
    used: BoolArray | None = None

    @property
    def outliers(self) -> int:
        """How many markers were left out."""
        return 0 if self.used is None else int(np.sum(~self.used))

    def of(self, frames: IntArray) -> BodyPoses:
        """Of some frames."""
        used = None if self.used is None else self.used[frames]
        return BodyPoses(self.rotation[frames], self.position[frames], used)

    def to_body(self, points: FloatArray) -> FloatArray:
        """Points of each frame from the tracker to the body: (N_frames, n, 3), m."""
        return np.asarray((points - self.position[:, None]) @ self.rotation)

    def to_tracker(self, points: FloatArray) -> FloatArray:
        """Points of the body, (n, 3) or of each frame, to the tracker: (N_frames, n, 3), m."""
        turned = points @ np.swapaxes(self.rotation, -1, -2)
        return np.asarray(turned + self.position[:, None])


@dataclass(frozen=True, eq=False)
class MarkerCloud:
    """Markers (n, 3) that are fixed to one body, in it, m."""

    markers: FloatArray

    @classmethod
    def from_frame(cls, frame: FloatArray) -> Self:
        """A body defined by one frame: axes of the tracker, origin at the markers' centroid."""
        return cls(frame - frame.mean(axis=0))

    def amplified(self, point: FloatArray) -> float:
        """How many times an error of the body's middle a point of the body (3,) errs, RMS.

        Fitzpatrick, West, Maurer (1998), doi:10.1109/42.736021: it turns with the body too.
        """
        centred = self.markers - self.markers.mean(axis=0)
        _, spread, axes = np.linalg.svd(centred)
        along = axes @ (point - self.markers.mean(axis=0))
        # Square distances from each axis: of the point, and the mean of the markers.
        lever, arm = along @ along - along**2, (spread @ spread - spread**2) / len(centred)
        return float(np.sqrt(1.0 + np.sum(lever / arm) / 3.0))

    def poses(self, frames: FloatArray, *, robust: bool | None = False) -> BodyPoses:
        """Pose of the body in every frame, by least squares over the markers.

        Closed form, because there are many frames and no unknown that they share: Arun, Huang,
        Blostein (1987), doi:10.1109/TPAMI.1987.4767965.

        Args:
            frames: (N_frames, n, 3) the markers in the tracker, m.
            robust: leave markers out that do not fit the others, where there are five or more;
                None: only in frames whose other markers then predict one another far better.

        Raises:
            SamplesError: fewer than three markers, markers on a line, or a frame that shows the
                mirror image of the body; says which frame.
        """
        if len(self.markers) < LEAST_POINTS:
            count = f"{len(self.markers)} markers on a body"
            raise SamplesError(count, "three or more, not on a line")
        if _on_a_line(self.markers[None])[0]:
            raise SamplesError("all markers of a body on one line", "three or more that are not")
        used = np.ones(frames.shape[:2], dtype=bool)
        _check_handedness(self.markers, frames, used)
        if robust is not False and len(self.markers) >= ENOUGH_TO_JUDGE:
            used = _agreeing(self.markers, frames)
            used = used if robust else _proven(self.markers, frames, used)
        shown = np.where(used[..., None], frames, _centres(frames, used))
        for frame in np.flatnonzero(_on_a_line(shown)):
            raise SamplesError(
                "all markers on one line", "markers as on the body", where=f"frame {frame + 1}"
            )
        return BodyPoses(*_register(self.markers, frames, used), used)


@dataclass(frozen=True, eq=False)
class ObservedBody:
    """A body as it was seen.

    Attributes:
        cloud: its markers, in it.
        frames: (N_frames, n, 3) the markers in the tracker, m.
        poses: of every frame.
    """

    cloud: MarkerCloud
    frames: FloatArray
    poses: BodyPoses

    @property
    def used(self) -> BoolArray:
        """(N_frames, n) markers that were not held for outliers."""
        used = self.poses.used
        return np.ones(self.frames.shape[:2], dtype=bool) if used is None else used

    @property
    def residuals(self) -> FloatArray:
        """(N_frames, n, 3) markers as seen less as given, in the body, m; NaN where left out."""
        difference = self.poses.to_body(self.frames) - self.cloud.markers
        return np.asarray(np.where(self.used[..., None], difference, np.nan))

    @property
    def misfit(self) -> FloatArray:
        """RMS distance (N_frames,) of the markers used from where the poses have them, m."""
        return np.asarray(np.sqrt(np.nanmean(np.sum(self.residuals**2, axis=-1), axis=1)))

    def against(self, cloud: MarkerCloud, used: BoolArray | None = None) -> Self:
        """The same frames, laid over another shape by the same markers, or by others."""
        used = self.used if used is None else used
        poses = BodyPoses(*_register(cloud.markers, self.frames, used), used)
        return replace(self, cloud=cloud, poses=poses)


def _register(
    markers: FloatArray, frames: FloatArray, used: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Least squares over the markers used: (N_frames, 3, 3), (N_frames, 3)."""
    # Markers left out come to lie on both centroids, where they pull at nothing.
    bodies, weight = np.broadcast_to(markers, frames.shape), used[..., None]
    return register_points(
        np.where(weight, bodies, _centres(bodies, used)),
        np.where(weight, frames, _centres(frames, used)),
    )


def _centres(frames: FloatArray, used: BoolArray) -> FloatArray:
    """Centroid of the markers used in each frame, (N_frames, 1, 3)."""
    weight = used[..., None]
    return np.asarray((weight * frames).sum(axis=1, keepdims=True) / weight.sum(axis=1)[:, None])


def _norms(markers: FloatArray, frames: FloatArray, used: BoolArray) -> FloatArray:
    """Distance of every marker from where the pose has it, (N_frames, n), m."""
    poses = BodyPoses(*_register(markers, frames, used))
    return np.asarray(np.linalg.norm(poses.to_tracker(markers) - frames, axis=-1))


def _agreeing(markers: FloatArray, frames: FloatArray) -> BoolArray:
    """Markers that fit: a start in each frame alone, then one scatter for all frames."""
    used = np.stack([agreeing_points(markers, f, 0, LEAST_POINTS).inliers for f in frames])
    # Residual relative to the size of the body that is rounding.
    floor = 1e-9 * float(np.ptp(markers))
    limit = np.sqrt(outlier_limit(used.size, 1))
    for _ in range(10):
        norms = _norms(markers, frames, used)
        sigma = np.median(norms[used]) / np.sqrt(chdtri(DIMENSION, 0.5))
        agreeing = norms <= limit * sigma + floor
        # A frame that shows nothing certain keeps what it began with.
        agreeing = np.where(agreeing.sum(axis=1, keepdims=True) >= LEAST_POINTS, agreeing, used)
        if np.array_equal(agreeing, used):
            break
        used = agreeing
    return used


def _proven(markers: FloatArray, frames: FloatArray, used: BoolArray) -> BoolArray:
    """The markers used; all of them in frames whose others predict one another no better so."""
    everything = np.ones_like(used)
    # Markers that both ways use are compared, each predicted from the others.
    errors = {}
    for way, believed in (("plain", everything), ("robust", used)):
        squares = np.zeros(used.shape)
        for marker in range(used.shape[1]):
            remaining = believed.copy()
            remaining[:, marker] = False
            squares[:, marker] = _norms(markers, frames, remaining)[:, marker] ** 2
        errors[way] = np.sum(squares * used, axis=1)
    enough = used.sum(axis=1) > LEAST_POINTS
    # Times less squared error of the markers that stay, from which on one that is left out is
    # wrong: a marker at the limit of what noise makes gives about two.
    far_better = enough & (errors["plain"] > 3.0 * errors["robust"])
    return np.asarray(used | ~far_better[:, None])


def _check_handedness(markers: FloatArray, frames: FloatArray, everything: BoolArray) -> None:
    rotated, reflected = (
        np.sum(_norms(points, frames, everything) ** 2, axis=1) for points in (markers, -markers)
    )
    noticeable = 1e-20 * np.sum((frames - frames.mean(axis=1, keepdims=True)) ** 2, axis=(1, 2))
    for frame in np.flatnonzero((rotated > MIRRORED**2 * reflected) & (rotated > noticeable)):
        raise SamplesError(
            "markers that are the mirror image of the body's",
            "two right-handed frames",
            where=f"frame {frame + 1}",
            hint="swap two axes or turn the sign of one, or put the markers in the same order",
        )


def _on_a_line(sets: FloatArray) -> BoolArray:
    """Whether each set of points (m, n, 3) lies on a line, or in one point."""
    spread = np.linalg.svd(sets - sets.mean(axis=1, keepdims=True), compute_uv=False)
    return np.asarray(spread[:, 1] <= ON_A_LINE * spread[:, 0])
