"""A camera from pictures of a board, with its covariance; and where the board is in a picture.

Zhang (2000), doi:10.1109/34.888718, by OpenCV; the covariance is our own, over all pictures.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import homogeneous
from suta_calib.geometry.pinhole import INTRINSICS
from suta_calib.measurements.board import Board
from suta_calib.measurements.camera import Camera
from suta_calib.measurements.corners import Corners
from suta_calib.vision.opencv import opencv

# Corners of a picture from which a pose and more can be determined.
LEAST_CORNERS: Final = 6


class NoCameraFitsError(SamplesError):
    """Corners of a board that no camera explains: what is wrong is the board's file, mostly."""


@dataclass(frozen=True)
class CameraFitOptions:
    """What a calibration of a camera must keep to.

    Attributes:
        doubtful: standard deviation of a focal length or of the principal point, as a share of
            the focal length, from which on a word is said: 0.5 % of the focal length are 5 mm
            at a metre.
        useless: the same, from which on the camera must not be used.
        covered: least share of the picture that corners should have covered; outside, distortion
            is extrapolated.
        unfit: RMS, as a share of the picture's larger side, from which on no camera fits: half a
            per cent is 3 px of 640, and no lens is bent so that five numbers leave that.
        astray: a picture is left out where its RMS is so many times the median.
        noticed: px; none is left out below it.
    """

    doubtful: float = 0.005
    useless: float = 0.05
    covered: float = 0.25
    unfit: float = 0.005
    astray: float = 5.0
    noticed: float = 1.0


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
    names = [name for name in corners.images if np.sum(corners.image == name) >= LEAST_CORNERS]
    astray: dict[str, float] = {}
    while True:
        if len(names) < least_views:
            raise SamplesError(
                f"only {len(names)} pictures with {LEAST_CORNERS} corners or more",
                f"at least {least_views}, from different directions",
                where="camera",
                hint="take more pictures, or give the camera's file with --camera",
            )
        camera, residuals, used = _fitted(corners, names, board, width, height)
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
            hint="check counts, sizes, positions and rotations in the file of the board, and "
            "whether the lens is a fisheye",
        )
    hull = opencv().convexHull(used.pixel.astype(np.float32))
    covered = float(opencv().contourArea(hull)) / (width * height)
    assessment = _assessed(camera, rms, len(views), covered, how)
    return CameraFit(camera, rms, views, astray, residuals, used, covered, assessment)


def _fitted(
    corners: Corners, names: list[str], board: Board, width: int, height: int
) -> tuple[Camera, FloatArray, Corners]:
    """The camera of these pictures, residuals, and the corners they are of."""
    cv2 = opencv()
    used = corners.take(np.isin(corners.image, names))
    shown = [used.take(used.image == name) for name in names]
    objects = [board.positions(one.point).astype(np.float32) for one in shown]
    pixels = [one.pixel.astype(np.float32) for one in shown]
    flags, guess = 0, np.eye(3)
    if not _is_plane(np.concatenate(objects)):
        # Only from plane boards is there a closed form.
        flags = cv2.CALIB_USE_INTRINSIC_GUESS
        focal = float(max(width, height))
        guess = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
    try:
        _, matrix, distortion, turns, places = cv2.calibrateCamera(
            objects, pixels, (width, height), guess, np.zeros(5), flags=flags
        )
    except cv2.error:
        matrix = np.full((3, 3), np.nan)
    if not np.isfinite(matrix).all():
        raise SamplesError(
            f"{len(names)} pictures that do not determine the camera",
            "pictures of the board from different directions, tilted by 30° or more",
            where="camera",
            hint="take more pictures, or give the camera's file with --camera",
        )
    values = np.array([*matrix[[0, 1, 0, 1], [0, 1, 2, 2]], *np.ravel(distortion)[:5]])
    residuals = np.zeros((len(used), 2))
    schur = np.zeros((len(INTRINSICS), len(INTRINSICS)))
    for name, one, turn, place in zip(names, shown, turns, places, strict=True):
        r, A, B = _linearised(board, one, values, np.ravel(turn), np.ravel(place))
        residuals[used.image == name] = r
        # The board's pose in each picture is unknown too.
        schur += A.T @ (A - B @ np.linalg.lstsq(B, A, rcond=None)[0])
    free = residuals.size - len(INTRINSICS) - 6 * len(names)
    variance = float(np.sum(residuals**2)) / max(free, 1)
    inverse = np.asarray(np.linalg.pinv(schur, rcond=1e-14, hermitian=True), dtype=np.float64)
    return Camera(width, height, values, variance * inverse), residuals, used


def _linearised(
    board: Board, corners: Corners, intrinsics: FloatArray, turn: FloatArray, place: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (n, 2) of a picture; derivatives by intrinsics (2 n, 9) and by pose (2 n, 6)."""
    matrix = Camera(2, 2, intrinsics).matrix
    projected, J = opencv().projectPoints(
        board.positions(corners.point), turn, place, matrix, intrinsics[4:]
    )
    return projected.reshape(-1, 2) - corners.pixel, J[:, 6:15], J[:, :6]


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
    weakest = f"the uncertainty of {INTRINSICS[worst]} is ± {stds[worst]:.1f} px"
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
        posed = _posed(board.positions(shown.point), shown.pixel, camera)
        if posed is None:
            continue
        off, *_ = _linearised(board, shown, camera.intrinsics, *posed)
        # A search that went astray ends anywhere: beyond the picture nothing is told by how far.
        if np.abs(off).max() <= max(camera.width, camera.height):
            poses[name] = homogeneous(opencv().Rodrigues(posed[0])[0], posed[1])
            residuals[rows] = off
    return poses, residuals


def _posed(
    points: FloatArray, pixels: FloatArray, camera: Camera
) -> tuple[FloatArray, FloatArray] | None:
    """Rotation vector and position, m, if the points tell a pose."""
    if len(points) < 4:
        return None
    cv2 = opencv()
    lens = camera.matrix, camera.intrinsics[4:]
    # Of the two possible poses of a plane in a distant picture it selects the better one.
    method = cv2.SOLVEPNP_IPPE if _is_plane(points) else cv2.SOLVEPNP_SQPNP
    try:
        count, turns, places, _ = cv2.solvePnPGeneric(points, pixels, *lens, flags=method)
        if not count:
            return None
        turn, place = cv2.solvePnPRefineLM(points, pixels, *lens, turns[0], places[0])
    except cv2.error:
        return None
    return np.ravel(turn), np.ravel(place)
