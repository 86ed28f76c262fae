"""A camera from pictures of a board, with its covariance; and where the board is in a picture.

Zhang (2000), doi:10.1109/34.888718: the start is OpenCV's, or of a fisheye the best of some focal
lengths. All pictures are then fitted together, with any lens.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.geometry.lens import Lens
from suta_calib.geometry.numbers import homogeneous
from suta_calib.measurements.board import Board
from suta_calib.measurements.camera import Camera
from suta_calib.measurements.corners import Corners
from suta_calib.terms.camera_start import ahead_of
from suta_calib.terms.lens_choice import UNFIT, best_lens
from suta_calib.vision.opencv import opencv
from suta_calib.vision.projection_uncertainty import ProjectionMap


class NoCameraFitsError(SamplesError):
    """Corners of a board that no camera explains: what is wrong is the board's file, mostly."""


@dataclass(frozen=True)
class CameraFitOptions(Displayable):
    """What a calibration of a camera must keep to.

    Attributes:
        doubtful: standard deviation of a focal length or of the principal point, as a share of
            the focal length, from which on a word is said: 0.5 % of the focal length are 5 mm
            at a metre.
        useless: the same, from which on the camera must not be used.
        covered: least share of the picture that corners should have covered; outside, distortion
            is extrapolated.
        unfit: RMS, as a share of the picture's larger side, from which on no camera fits.
        astray: a picture is left out where its RMS is so many times the median.
        noticed: px; none is left out below it.
        lens: the model; without one, the one that predicts left-out pictures best.
    """

    doubtful: float = 0.005
    useless: float = 0.05
    covered: float = 0.25
    unfit: float = UNFIT
    astray: float = 5.0
    noticed: float = 1.0
    lens: Lens | None = None


@dataclass(frozen=True, eq=False)
class CameraFit(Displayable):
    """A camera that pictures of a board determined.

    Attributes:
        camera: with the covariance of its intrinsics.
        rms: of the reprojection errors, px (2-D, over corners).
        views: RMS of each picture that was used, px.
        astray: RMS of the pictures that do not fit the others, px; left out.
        residuals: (n, 2) reprojection errors of the corners of ``used``, px.
        used: the corners that were fitted.
        covered: share of the picture that their hull covers.
        assessment: how far to trust it.
    """

    camera: Camera
    rms: float
    views: Mapping[str, float]
    astray: Mapping[str, float]
    residuals: FloatArray
    used: Corners
    covered: float
    assessment: Assessment

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the corners' scatter: the poses of the board are unknown too."""
        told = 2 * len(self.used) - len(self.camera.lens.names) - 6 * len(self.views)
        return float(max(told, 1))

    @cached_property
    def projection(self) -> ProjectionMap:
        """How sure the camera's projection is, over its picture."""
        return ProjectionMap.of(self.camera, self.used.pixel)


def calibrate_camera(
    corners: Corners,
    board: Board,
    width: int,
    height: int,
    options: CameraFitOptions | None = None,
) -> CameraFit:
    """Intrinsics and distortion from corners of a board in pictures of one camera.

    Pictures with fewer corners than `LEAST_CORNERS`, or that do not fit the others, are left out.

    Args:
        corners: found in the pictures.
        board: that was seen.
        width: of the pictures, px.
        height: of the pictures, px.
        options: what it must keep to.

    Raises:
        SamplesError: too few pictures, or pictures that determine no camera.
        NoCameraFitsError: corners that none explains.
    """
    # Pictures with which a camera can be calibrated at all: each tells two numbers of four.
    least_views = 3
    how = options or CameraFitOptions()
    # Corners of a picture from which a pose and more can be determined.
    least_corners = 6
    names = [name for name in corners.images if np.sum(corners.image == name) >= least_corners]
    astray: dict[str, float] = {}
    while True:
        if len(names) < least_views:
            raise SamplesError(
                f"only {len(names)} pictures with {least_corners} corners or more",
                f"at least {least_views}, from different directions",
                where="camera",
                hint="take more pictures, or give the camera's file with --camera",
            )
        fitted = best_lens(corners, names, board, (width, height), how.lens)
        camera, residuals, used = fitted.camera, fitted.residuals, fitted.used
        views = rms_by_view(used, residuals)
        limit = max(how.astray * float(np.median(list(views.values()))), how.noticed)
        worst = max(views, key=lambda name: views[name])
        if views[worst] <= limit:
            break
        astray[worst] = views[worst]
        names.remove(worst)
    rms = float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))
    if not rms <= how.unfit * max(width, height):
        # Of a search that went astray the number itself means nothing.
        off = f"{rms:.1f} px" if rms < max(width, height) else "by more than the picture's size"
        raise NoCameraFitsError(
            f"corners that no camera model can explain (error {off})",
            "the corners of the board as its file describes it",
            where="camera",
            hint="check counts, sizes, positions and rotations in the file of the board",
        )
    hull = opencv().convexHull(used.pixel.astype(np.float32))
    covered = float(opencv().contourArea(hull)) / (width * height)
    assessment = _assessed(camera, rms, len(views), covered, how)
    return CameraFit(camera, rms, views, astray, residuals, used, covered, assessment)


def rms_by_view(corners: Corners, residuals: FloatArray) -> dict[str, float]:
    """RMS (2-D, over corners) of the residuals (n, 2) of each picture, px."""
    squared = np.sum(residuals**2, axis=1)
    return {
        name: float(np.sqrt(np.mean(squared[corners.image == name]))) for name in corners.images
    }


def _assessed(
    camera: Camera, rms: float, views: int, covered: float, how: CameraFitOptions
) -> Assessment:
    stds = camera.stds
    assert stds is not None
    share = stds[:4] / camera.intrinsics[:2].mean()
    worst = int(np.argmax(share))
    weakest = f"the uncertainty of {camera.lens.names[worst]} is ± {stds[worst]:.1f} px"
    remedy = "tilt the board by 30° or more in all directions, and bring it closer to the camera"
    bad, care = [], []
    if not np.isfinite(share).all() or share[worst] > how.useless:
        bad.append(f"The pictures do not determine the camera: {weakest}; {remedy}.")
    elif share[worst] > how.doubtful:
        care.append(f"The pictures determine the camera only poorly: {weakest}; {remedy}.")
    if covered < how.covered:
        care.append(
            f"Corners cover {100 * covered:.0f} % of the picture. Outside of this area the "
            "distortion is extrapolated. Take pictures with the board near the edges too."
        )
    sentence = f"Camera calibrated from {views} pictures, RMS {rms:.3f} px."
    return Assessment.of(sentence, bad=bad, care=care)


def _is_plane(points: FloatArray) -> bool:
    centred = points - points.mean(axis=0)
    values = np.linalg.svd(centred, compute_uv=False)
    # A point is out of its board's plane, in the board's size, where the board is not plane.
    return bool(values[2] <= 1e-6 * values[0])


def view_poses(
    corners: Corners, board: Board, camera: Camera
) -> tuple[dict[str, FloatArray], FloatArray]:
    """Where the board is in each picture, and reprojection errors.

    Args:
        corners: found in the pictures.
        board: that was seen.
        camera: that took them.

    Returns:
        ``T_camera_board`` (4, 4), m, by picture, where its corners tell it (at least four) and some
        pose has them in the picture; and
        (n, 2) residuals of all corners, px, NaN in other pictures.
    """
    poses, residuals = {}, np.full((len(corners), 2), np.nan)
    for name in corners.images:
        rows = corners.image == name
        shown = corners.take(rows)
        points = board.positions(shown.point)
        posed = _posed(points, shown.pixel, camera)
        if posed is None:
            continue
        pose = homogeneous(*posed)
        there = points @ pose[:3, :3].T + pose[:3, 3]
        off = camera.project(there) - shown.pixel if camera.lens.ahead(there).all() else np.inf
        # A search that went astray ends anywhere: beyond the picture nothing is told by how far.
        if np.abs(off).max() <= max(camera.width, camera.height):
            poses[name], residuals[rows] = pose, off
    return poses, residuals


def _posed(
    points: FloatArray, pixels: FloatArray, camera: Camera
) -> tuple[FloatArray, FloatArray] | None:
    """Rotation (3, 3) and position, m, if the points tell a pose."""
    if len(points) < 4:
        return None
    cv2 = opencv()
    turn = np.eye(3)
    lens: tuple[FloatArray, FloatArray] = camera.matrix, camera.intrinsics[4:]
    if camera.lens.sees_behind:
        # Turned so that the board is ahead, it is seen as by a camera without a lens.
        turn, pixels, ahead = ahead_of(camera.directions(pixels))
        if not ahead.all():
            return None
        lens = np.eye(3), np.zeros(5)
    # Of the two possible poses of a plane in a distant picture it selects the better one.
    method = cv2.SOLVEPNP_IPPE if _is_plane(points) else cv2.SOLVEPNP_SQPNP
    try:
        count, turns, places, _ = cv2.solvePnPGeneric(points, pixels, *lens, flags=method)
        if not count:
            return None
        vector, place = cv2.solvePnPRefineLM(points, pixels, *lens, turns[0], places[0])
    except cv2.error:
        return None
    return turn @ cv2.Rodrigues(vector)[0], turn @ np.ravel(place)
