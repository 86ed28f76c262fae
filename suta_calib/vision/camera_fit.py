"""A camera from pictures of a board, with its covariance; and where the board is in a picture.

Zhang (2000), doi:10.1109/34.888718: the start is OpenCV's, or of a fisheye the best of some focal
lengths. All pictures are then fitted together, with any lens.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.geometry.lens import EQUIDISTANT, PLUMB_BOB, RATIONAL, Lens
from suta_calib.geometry.numbers import homogeneous
from suta_calib.measurements.board import Board
from suta_calib.measurements.camera import Camera
from suta_calib.measurements.corners import Corners
from suta_calib.terms.camera_alone import PicturesSeen, State, refined, seen_by
from suta_calib.terms.camera_start import ahead_of
from suta_calib.terms.intrinsics import IntrinsicsPrior
from suta_calib.vision.opencv import opencv
from suta_calib.vision.projection_uncertainty import ProjectionMap

# What a search is kept within: far wider than any lens, but for what pictures do not tell of one.
_WIDE: Final = IntrinsicsPrior(focal=3.0, centre=1.0, radial=10.0, tangential=1.0, unbent=False)
# Corners of a picture from which a pose and more can be determined.
LEAST_CORNERS: Final = 6


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
        unfit: RMS, as a share of the picture's larger side, from which on no camera fits: half a
            per cent is 3 px of 640, and no lens is bent so that five numbers leave that.
        astray: a picture is left out where its RMS is so many times the median.
        noticed: px; none is left out below it.
        lens: the model; without one, the one that predicts left-out pictures best.
    """

    doubtful: float = 0.005
    useless: float = 0.05
    covered: float = 0.25
    unfit: float = 0.005
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

    @cached_property
    def projection(self) -> ProjectionMap:
        """How sure the camera's projection is, over its picture."""
        return ProjectionMap.of(self.camera, self.used.pixel)


@dataclass(frozen=True, eq=False)
class FittedCamera:
    """A camera with one lens, fitted to pictures.

    Attributes:
        camera: with its covariance.
        residuals: (n, 2) of the corners, px.
        used: the corners.
        seen, state: the same in tables, and where the board is in each picture.
    """

    camera: Camera
    residuals: FloatArray
    used: Corners
    seen: PicturesSeen
    state: State

    @cached_property
    def left_out(self) -> FloatArray:
        """(pictures,) mean square of the errors of each, px², by cameras that did not see it.

        Of five; the board's pose in a picture follows from its own corners.
        """
        folds, count = 5, len(self.seen.pixels)
        squares = np.zeros(count)
        prior = _WIDE.stds(self.camera)
        for fold in range(folds):
            out = np.arange(count) % folds == fold
            camera = refined(self.seen.take(~out), self.state.take(~out), prior, robust=False)
            alone, at = (
                self.seen.take(out),
                replace(self.state.take(out), intrinsics=camera.intrinsics),
            )
            errors = alone.errors(refined(alone, at, np.full(len(prior), 1e-9), robust=False))
            assert errors is not None
            squares[out] = np.sum(errors**2, axis=(1, 2)) / alone.there.sum(axis=1)
        return squares


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
        fitted = _best_lens(corners, names, board, width, height, how.lens)
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


def _fitted(
    lens: Lens,
    corners: Corners,
    names: list[str],
    board: Board,
    size: tuple[int, int],
    known: FittedCamera | None = None,
) -> FittedCamera:
    """The camera of these pictures with such a lens, by least squares of the reprojection errors.

    Args:
        lens: its model.
        corners: of all pictures.
        names: of those that are used.
        board: that was seen.
        size: width and height of the pictures, px.
        known: a camera with another lens that does not see behind itself, from which the search
            may begin too.

    Raises:
        SamplesError: the pictures determine none.
    """
    used = corners.take(np.isin(corners.image, names))
    best: tuple[PicturesSeen, State] | None = None
    least = np.inf
    for start in _starts(lens, used, names, board, size, known):
        searched = _searched(start, used, board)
        if searched is None:
            continue
        if searched[2] < least:
            best, least = searched[:2], searched[2]
        # A search that ended at corners that are found to a pixel ended well.
        if least < len(used):
            break
    if best is None:
        raise _undetermined(names)
    seen = best[0]
    start = Camera(*size, best[1].intrinsics, lens=lens)
    state = refined(seen, best[1], _WIDE.stds(start), robust=False, settled=1e-10)
    errors = seen.errors(state)
    assert errors is not None
    by_camera, by_pose = seen.slopes(state)
    count = len(lens.names)
    schur = np.zeros((count, count))
    for A, B in zip(by_camera, by_pose, strict=True):
        A, B = A.reshape(-1, count), B.reshape(-1, 6)
        # The board's pose in each picture is unknown too.
        schur += A.T @ (A - B @ np.linalg.lstsq(B, A, rcond=None)[0])
    free = 2 * len(used) - count - 6 * len(names)
    variance = float(np.sum(errors**2)) / max(free, 1)
    unit = np.sqrt(np.maximum(np.diag(schur), 1e-300))
    scale = np.outer(unit, unit)
    inverse = np.linalg.pinv(schur / scale, rcond=1e-14, hermitian=True) / scale
    camera = Camera(*size, state.intrinsics, variance * np.asarray(inverse), lens=lens)
    return FittedCamera(camera, _of_corners(used, board, errors), used, seen, state)


def _searched(
    start: Camera, used: Corners, board: Board
) -> tuple[PicturesSeen, State, float] | None:
    """All pictures about the camera of least squares, and their sum of squares, px².

    None where it has some of them behind itself.

    A first camera may see some boards nowhere, and others in a wrong pose: those that it sees
    improve it, and it is asked again.
    """
    best: tuple[PicturesSeen, State, float] | None = None
    camera = start
    for _ in range(3):
        seen, state, posed = seen_by(camera, used, board)
        before = _sum_of_squares(seen, state)
        if 2 * posed.sum() < len(posed) or not np.isfinite(before):
            break
        state = refined(seen, state, _WIDE.stds(start), robust=False, settled=1e-3)
        after = _sum_of_squares(seen, state)
        camera = replace(start, intrinsics=state.intrinsics)
        if posed.all() and (best is None or after < best[2]):
            best = seen, state, after
        if posed.all() and after < len(used):
            break
    return best


def _sum_of_squares(seen: PicturesSeen, state: State) -> float:
    errors = seen.errors(state)
    return np.inf if errors is None else float(np.sum(errors**2))


def _of_corners(corners: Corners, board: Board, table: FloatArray) -> FloatArray:
    """Rows of a table (pictures, points, …) in the order of the corners."""
    picture = {name: k for k, name in enumerate(corners.images)}
    number = {point: k for k, point in enumerate(board.points)}
    rows = [picture[name] for name in corners.image.tolist()]
    return np.asarray(table[rows, [number[k] for k in corners.point.tolist()]])


def _undetermined(names: list[str]) -> SamplesError:
    return SamplesError(
        f"{len(names)} pictures that do not determine the camera",
        "pictures of the board from different directions, tilted by 30° or more",
        where="camera",
        hint="take more pictures, or give the camera's file with --camera",
    )


def _starts(
    lens: Lens,
    used: Corners,
    names: list[str],
    board: Board,
    size: tuple[int, int],
    known: FittedCamera | None,
) -> Iterator[Camera]:
    """Cameras from which the search for the best one begins, the likeliest first."""
    bent = np.zeros(len(lens.distortion))
    if known is not None and not lens.sees_behind:
        values = known.camera.intrinsics
        yield Camera(*size, np.array([*values, *bent[len(values) - 4 :]]), lens=lens)
    by_opencv = None if lens.sees_behind else _by_opencv(used, names, board, size)
    if by_opencv is not None:
        yield Camera(*size, np.array([*by_opencv, *bent[5:]]), lens=lens)
    middle = [(length - 1) / 2 for length in size]
    ranked: list[tuple[float, Camera]] = []
    for angle in np.radians([60.0, 90.0, 120.0, 150.0, 180.0, 220.0]):
        half = angle / 2 if lens.sees_behind else np.tan(min(angle, np.radians(150.0)) / 2)
        focal = max(size) / 2 / half
        camera = Camera(*size, np.array([focal, focal, *middle, *bent]), lens=lens)
        seen, state, posed = seen_by(camera, used, board)
        if posed.all() and np.isfinite(off := _sum_of_squares(seen, state)):
            ranked.append((off, camera))
    yield from (camera for _, camera in sorted(ranked, key=lambda each: each[0])[:2])


def _by_opencv(
    used: Corners, names: list[str], board: Board, size: tuple[int, int]
) -> FloatArray | None:
    """Fx fy cx cy k1 k2 p1 p2 k3 of OpenCV; None where it finds none."""
    cv2 = opencv()
    shown = [used.take(used.image == name) for name in names]
    objects = [board.positions(one.point).astype(np.float32) for one in shown]
    pixels = [one.pixel.astype(np.float32) for one in shown]
    flags, guess = 0, np.eye(3)
    if not _is_plane(np.concatenate(objects)):
        # Only from plane boards is there a closed form.
        flags = cv2.CALIB_USE_INTRINSIC_GUESS
        width, height = size
        focal = float(max(width, height))
        guess = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
    try:
        _, matrix, distortion, *_ = cv2.calibrateCamera(
            objects, pixels, size, guess, np.zeros(5), flags=flags
        )
    except cv2.error:
        return None
    values = np.array([*matrix[[0, 1, 0, 1], [0, 1, 2, 2]], *np.ravel(distortion)[:5]])
    return values if np.isfinite(values).all() else None


def rms_by_view(corners: Corners, residuals: FloatArray) -> dict[str, float]:
    """RMS (2-D, over corners) of the residuals (n, 2) of each picture, px."""
    squared = np.sum(residuals**2, axis=1)
    return {
        name: float(np.sqrt(np.mean(squared[corners.image == name]))) for name in corners.images
    }


def _best_lens(
    corners: Corners, names: list[str], board: Board, width: int, height: int, lens: Lens | None
) -> FittedCamera:
    """The camera with this lens, or with the one whose predictions of left-out pictures are best.

    The first model stays, unless another predicts pictures that it has not seen better by more than
    chance: one with more coefficients fits its own pictures better in any case.
    """
    wanted = (lens,) if lens else (PLUMB_BOB, EQUIDISTANT, RATIONAL)
    best: FittedCamera | None = None
    straight: FittedCamera | None = None
    problems: list[SamplesError] = []
    for model in wanted:
        try:
            other = _fitted(model, corners, names, board, (width, height), straight)
        except SamplesError as problem:
            problems.append(problem)
            continue
        straight = straight if model.sees_behind else other
        if best is None or _predicts_better(other, best):
            best = other
    if best is None:
        raise problems[0]
    return best


def _predicts_better(other: FittedCamera, best: FittedCamera) -> bool:
    """Whether one camera's errors in left-out pictures are smaller by more than chance."""
    # Schwarz (1978), doi:10.1214/aos/1176344136, for four coefficients and some thousand numbers;
    # and fewer pictures tell nothing.
    worth, least = 30.0, 6
    squares, squares_best = (float(np.sum(each.residuals**2)) for each in (other, best))
    if squares_best - squares < worth * squares / other.residuals.size:
        return False
    if len(best.seen.pixels) < least:
        return False
    # Errors of a picture are alike, which the sum of squares does not know; by their logarithms, as
    # a lens may fail in the few pictures at the edge alone.
    gain = np.log(best.left_out / other.left_out)
    spread = float(np.std(gain, ddof=1)) / np.sqrt(len(gain))
    # One of twenty pairs of equally good models differs by so many standard errors.
    return bool(np.mean(gain) > 1.64 * spread)


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
