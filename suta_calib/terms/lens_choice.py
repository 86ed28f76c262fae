"""Which model of a lens took pictures of a board, and the camera that they show.

Every model is fitted to the pictures, and judged by the pictures that it has not seen: one with
more coefficients fits its own pictures better in any case.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.lens import EQUIDISTANT, PLUMB_BOB, RATIONAL, Lens
from suta_calib.measurements import Board, Camera, Corners
from suta_calib.terms.camera_alone import CameraState, PicturesSeen, refined, seen_by
from suta_calib.terms.camera_start import PLANAR, closed_form_camera, closed_form_intrinsics
from suta_calib.terms.intrinsics import UNCALIBRATED, IntrinsicsPrior

# What a search is kept within: far wider than any lens, but for what pictures do not tell of one.
_WIDE: Final = IntrinsicsPrior(focal=3.0, centre=1.0, radial=10.0, tangential=1.0, unbent=False)
# Pictures that left-out errors are asked of: fewer tell nothing.
_LEAST: Final = 6
# RMS, as a share of the picture's larger side, from which on no camera fits: half a per cent is
# 3 px of 640, and no lens is bent so that five numbers leave that.
UNFIT: Final = 0.005


@dataclass(frozen=True)
class LensChoice:
    """The model of a lens that was chosen by pictures, and how well each predicts.

    Attributes:
        lens: that was chosen.
        left_out: RMS of the middle one of the pictures left out, px, by name of the model; empty
            of too few pictures.
    """

    lens: Lens
    left_out: Mapping[str, float]

    @property
    def sentence(self) -> str:
        """Which it is, and by how much it predicts better than the others."""
        lens = self.lens.called
        if not self.left_out:
            return (
                f"Without a camera file, the lens is taken for {lens}: with fewer than {_LEAST} "
                "pictures no model can be chosen. If it is another one, say so (lens), or "
                "calibrate the camera first (suta-calib detect)."
            )
        rivals = ", ".join(
            f"{name} {rms:.3f} px" for name, rms in self.left_out.items() if name != self.lens.name
        )
        error = self.left_out[self.lens.name]
        better = [rms > error for name, rms in self.left_out.items() if name != self.lens.name]
        why = (
            "which predicts left-out pictures best"
            if all(better)
            else "as no other model predicts left-out pictures better by more than chance"
        )
        return (
            f"Without a camera file, the lens is taken for {lens}, {why}: error {error:.3f} px"
            + (f" ({rivals})." if rivals else ".")
        )


def camera_alone(
    corners: Corners, board: Board, lens: Lens | None = None
) -> tuple[Camera, LensChoice | None]:
    """A camera as its pictures of a flat board show it, and how its lens was chosen.

    Its picture is taken to end where the corners do: its real size is in none of them. What the
    pictures hardly tell of a lens stays near none.

    Args:
        corners: found in the pictures.
        board: that was seen.
        lens: its model; without one, that which predicts left-out pictures best.

    Raises:
        BoardError: one that is not flat.
        SamplesError: corners of another board, or pictures that do not tell the focal length.
    """
    usual: Camera | None = None
    problem: SamplesError | None = None
    if lens is None or lens is PLUMB_BOB:
        try:
            usual = _without_outliers(closed_form_camera(corners, board), corners, board)
        except SamplesError as refused:
            if lens is not None:
                raise
            problem = refused
    if lens is PLUMB_BOB:
        assert usual is not None
        return usual, None
    names = [name for name in corners.images if np.sum(corners.image == name) >= PLANAR + 2]
    # A choice among so many pictures is as good as among all.
    if len(names) > (most := 40):
        chosen = np.linspace(0, len(names) - 1, most).astype(np.intp)
        names = [names[k] for k in chosen]
    width, height = (int(size) + 1 for size in corners.pixel.max(axis=0))
    left_out: dict[str, float] = {}
    best: FittedCamera | None = None
    if len(names) >= (1 if lens else _LEAST):
        try:
            best = best_lens(corners, names, board, (width, height), lens, left_out)
        except SamplesError as refused:
            problem = problem or refused
    if best is not None and best.rms > UNFIT * max(width, height):
        best = None
    if best is None or (best.camera.lens is PLUMB_BOB and usual is not None):
        if usual is None:
            assert problem is not None
            raise problem
        return usual, LensChoice(PLUMB_BOB, left_out)
    camera = replace(best.camera, covariance=None)
    choice = None if lens else LensChoice(best.camera.lens, left_out)
    return _without_outliers(camera, corners, board), choice


def _without_outliers(start: Camera, corners: Corners, board: Board) -> Camera:
    """A camera refined by all pictures; corners that are far off pull no harder than others."""
    pictures, state, _ = seen_by(start, corners, board)
    return replace(start, intrinsics=refined(pictures, state, UNCALIBRATED.stds(start)).intrinsics)


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
    state: CameraState

    @property
    def rms(self) -> float:
        """Of the reprojection errors, px (2-D, over corners)."""
        return float(np.sqrt(np.mean(np.sum(self.residuals**2, axis=1))))

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


def best_lens(
    corners: Corners,
    names: list[str],
    board: Board,
    size: tuple[int, int],
    lens: Lens | None = None,
    left_out: dict[str, float] | None = None,
) -> FittedCamera:
    """The camera with this lens, or with the one whose predictions of left-out pictures are best.

    The first model stays, unless another predicts pictures that it has not seen better by more than
    chance: one with more coefficients fits its own pictures better in any case. The errors that
    models have in the middle one of them, RMS in px, are put into ``left_out`` by name.
    """
    lenses = (lens,) if lens else (PLUMB_BOB, EQUIDISTANT, RATIONAL)
    best: FittedCamera | None = None
    straight: FittedCamera | None = None
    problems: list[SamplesError] = []
    for model in lenses:
        try:
            other = _fitted(model, corners, names, board, size, straight)
        except SamplesError as problem:
            problems.append(problem)
            continue
        straight = straight if model.sees_behind else other
        if best is None or _predicts_better(other, best):
            best = other
        if left_out is not None and len(other.seen.pixels) >= _LEAST:
            left_out[model.name] = float(np.sqrt(np.median(other.left_out)))
    if best is None:
        raise problems[0]
    return best


def _predicts_better(other: FittedCamera, best: FittedCamera) -> bool:
    """Whether one camera's errors in left-out pictures are smaller by more than chance."""
    # Schwarz (1978), doi:10.1214/aos/1176344136, for four coefficients and some thousand numbers.
    worth = 30.0
    # Mean square error of a coordinate, px², that is rounding.
    rounding = 1e-6
    squares, squares_best = (
        float(np.sum(fitted.residuals**2 + rounding)) for fitted in (other, best)
    )
    if squares_best - squares < worth * squares / other.residuals.size:
        return False
    if len(best.seen.pixels) < _LEAST:
        return False
    # Errors of a picture are alike, which the sum of squares does not know; by their logarithms, as
    # a lens may fail in the few pictures at the edge alone.
    gain = np.log((best.left_out + rounding) / (other.left_out + rounding))
    spread = float(np.std(gain, ddof=1)) / np.sqrt(len(gain))
    # One of twenty pairs of equally good models differs by so many standard errors.
    return bool(np.mean(gain) > 1.64 * spread)


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
    best: tuple[PicturesSeen, CameraState] | None = None
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
    pictures = best[0]
    start = Camera(*size, best[1].intrinsics, lens=lens)
    state = refined(pictures, best[1], _WIDE.stds(start), robust=False, settled=1e-10)
    errors = pictures.errors(state)
    assert errors is not None
    by_camera, by_pose = pictures.slopes(state)
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
    return FittedCamera(camera, _of_corners(used, board, errors), used, pictures, state)


def _searched(
    start: Camera, used: Corners, board: Board
) -> tuple[PicturesSeen, CameraState, float] | None:
    """All pictures about the camera of least squares, and their sum of squares, px².

    None where it has some of them behind itself.

    A first camera may see some boards nowhere, and others in a wrong pose: those that it sees
    improve it, and it is asked again.
    """
    best: tuple[PicturesSeen, CameraState, float] | None = None
    camera = start
    for _ in range(3):
        pictures, state, posed = seen_by(camera, used, board)
        before = _sum_of_squares(pictures, state)
        if 2 * posed.sum() < len(posed) or not np.isfinite(before):
            break
        state = refined(pictures, state, _WIDE.stds(start), robust=False, settled=1e-3)
        after = _sum_of_squares(pictures, state)
        camera = replace(start, intrinsics=state.intrinsics)
        if posed.all() and (best is None or after < best[2]):
            best = pictures, state, after
        if posed.all() and after < len(used):
            break
    return best


def _sum_of_squares(seen: PicturesSeen, state: CameraState) -> float:
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
    if board.flat and not lens.sees_behind:
        shown = [used.take(used.image == name) for name in names]
        boards = [board.positions(one.point) for one in shown]
        straight = closed_form_intrinsics(boards, [one.pixel for one in shown])
        if straight is not None:
            yield Camera(*size, np.array([*straight, *bent]), lens=lens)
    middle = [(length - 1) / 2 for length in size]
    ranked: list[tuple[float, Camera]] = []
    for angle in np.radians([60.0, 90.0, 120.0, 150.0, 180.0, 220.0]):
        half = angle / 2 if lens.sees_behind else np.tan(min(angle, np.radians(150.0)) / 2)
        focal = max(size) / 2 / half
        camera = Camera(*size, np.array([focal, focal, *middle, *bent]), lens=lens)
        pictures, state, posed = seen_by(camera, used, board)
        if posed.all() and np.isfinite(off := _sum_of_squares(pictures, state)):
            ranked.append((off, camera))
    yield from (camera for _, camera in sorted(ranked, key=lambda each: each[0])[:2])
