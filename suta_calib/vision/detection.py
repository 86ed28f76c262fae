"""A board's corners in many pictures, and the camera that took them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment
from suta_calib.display import Displayable
from suta_calib.errors import InputError, SamplesError
from suta_calib.measurements.board import Board, Charuco, Chessboard, Markers
from suta_calib.measurements.camera import Camera
from suta_calib.measurements.corners import Corners, corners_of
from suta_calib.measurements.marker_axes import markers_as_seen
from suta_calib.terms.board_pictures import BoardPictures
from suta_calib.terms.misread_pictures import contradiction, otherwise_read, shown_camera
from suta_calib.threads import usable_cores
from suta_calib.vision.camera_fit import (
    CameraFit,
    CameraFitOptions,
    NoCameraFitsError,
    calibrate_camera,
    rms_by_view,
    view_poses,
)
from suta_calib.vision.chessboard import ChessboardFinder
from suta_calib.vision.coverage import ENOUGH
from suta_calib.vision.finder import DetectedBoard, NotSeenError
from suta_calib.vision.markers import CharucoFinder, MarkersFinder
from suta_calib.vision.pictures import PictureFile, UnusablePictureError, read_picture
from suta_calib.words import listed

BoardFinder = ChessboardFinder | CharucoFinder | MarkersFinder
Progress = Callable[[int, int], None]
_MOST_TOLD: Final = 3


@dataclass(frozen=True)
class DetectionOptions(Displayable):
    """Options of the search for corners, and thresholds of the notes.

    Attributes:
        workers: threads; as many as there are processors by default.
        suspicious: median RMS, px, from which on it is asked whether the pictures show another
            camera than the one that was given; corners are found to a few hundredths.
        doubtful: the same, from which on that camera hardly fits the pictures in any case.
        unfit: the same, from which on it is another camera's, or another focus'.
        camera: what a calibration of the camera must keep to.
    """

    workers: int = 0
    suspicious: float = 0.1
    doubtful: float = 1.0
    unfit: float = 3.0
    camera: CameraFitOptions = field(default_factory=CameraFitOptions)


@dataclass(frozen=True, eq=False)
class SearchedPicture(Displayable):
    """Result for one picture.

    Attributes:
        picture: its file.
        size: width and height, px; None where it could not be read.
        board: the board; None where the picture is left out.
        reason: why it is left out; empty where it is not.
        rms: of its reprojection errors, px; None where there is no camera.
    """

    picture: PictureFile
    size: tuple[int, int] | None = None
    board: DetectedBoard | None = None
    reason: str = ""
    rms: float | None = None

    def without(self, reason: str) -> SearchedPicture:
        """The same picture, left out."""
        return replace(self, board=None, reason=reason)


@dataclass(frozen=True, eq=False)
class Detection(Displayable):
    """Corners found in pictures.

    Attributes:
        board: that was sought, its markers turned as they are seen.
        views: every picture, in order.
        corners: of all pictures that are not left out.
        camera: that was given, or is calibrated; None where the pictures determine none.
        fit: the calibration of the camera, where none was given.
        residuals: (n, 2) reprojection errors of the corners, px; None without a camera.
        assessment: how far to trust it.
    """

    board: Board
    views: Sequence[SearchedPicture]
    corners: Corners
    camera: Camera | None
    fit: CameraFit | None
    residuals: FloatArray | None
    assessment: Assessment

    @property
    def detected(self) -> int:
        """Number of pictures in which the board was found."""
        return sum(view.board is not None for view in self.views)

    @property
    def rms(self) -> float | None:
        """Of the reprojection errors, px (2-D, over corners); None without a camera."""
        if self.residuals is None:
            return None
        squared = np.sum(self.residuals**2, axis=1)
        return float(np.sqrt(np.nanmean(squared))) if np.isfinite(squared).any() else None


def finder_of(board: Board) -> BoardFinder:
    """What finds a board."""
    if isinstance(board, Chessboard):
        return ChessboardFinder(board)
    if isinstance(board, Charuco):
        return CharucoFinder(board)
    assert isinstance(board, Markers)
    return MarkersFinder(board)


def detect(
    pictures: Sequence[PictureFile],
    board: Board,
    camera: Camera | None = None,
    options: DetectionOptions | None = None,
    progress: Progress | None = None,
) -> Detection:
    """Find a board's corners in pictures of one camera, and calibrate the camera if need be.

    Args:
        pictures: to be searched.
        board: to be found.
        camera: that took them; calibrated from them without.
        options: how.
        progress: is told how many pictures are done, and of how many.

    Raises:
        InputError: the board is in no picture; says why.
        MissingExtraError: OpenCV is not installed.
    """
    how = options or DetectionOptions()
    views = _searched(pictures, finder_of(board), how.workers, progress)
    if camera is not None:
        _check_size(views, camera)
    views = _one_size(views, camera)
    if not any(view.board for view in views):
        raise _none_found(views)
    board, turned = markers_as_seen(board, _corners(views))
    fit, notes = None, list[str]()
    bad: list[str] = []
    measured = not (isinstance(board, Markers) and board.unplaced)
    if camera is None and not measured:
        notes.append(
            "The camera was not calibrated: the board's file does not say where all markers are. "
            "Calibrate it with a chessboard, or give its file (--camera)."
        )
    elif camera is None:
        try:
            fit = calibrate_camera(_corners(views), board, *_size(views), how.camera)
        except NoCameraFitsError as problem:
            bad.append(f"The camera was not calibrated: found {problem.found}; {problem.hint}")
        except SamplesError as problem:
            notes.append(
                f"The camera was not calibrated: found {problem.found}; expected "
                f"{problem.expected}."
            )
        else:
            views = [
                view.without(
                    f"corners are {off:.1f} px away from where the camera of the other "
                    "pictures predicts them"
                )
                if (off := fit.astray.get(view.picture.name))
                else view
                for view in views
            ]
    corners = _corners(views)
    if fit is not None:
        fit = replace(fit, camera=replace(fit.camera, corners=corners.digest))
        camera = fit.camera
    residuals = None
    if camera is not None and measured:
        _, residuals = view_poses(corners, board, camera)
        rms = rms_by_view(corners, residuals)
        views = [_with_rms(view, rms) for view in views]
        if fit is None:
            bad, notes = _judged(
                list(rms.values()),
                BoardPictures(board, camera, corners.table(board.points)),
                how,
            )
    count = sum(view.board is not None for view in views)
    lost = [*filter(None, [_left_out(views)])]
    # A few that are lost among enough others do no harm.
    few = count < ENOUGH or 4 * count < 3 * len(views)
    notes = [*filter(None, [_symmetry(board)]), *notes, *(lost if few else ())]
    sentence = f"{len(corners)} corners found in {count} of {len(views)} pictures."
    if fit is not None:
        sentence += f" {fit.assessment.sentence}"
        (bad if not fit.assessment.usable else notes).extend(fit.assessment.notes)
    facts = [*filter(None, [turned, _on_its_side(board, views)]), *(() if few else lost)]
    assessment = Assessment.of(sentence, bad=bad, care=notes, facts=facts)
    return Detection(board, views, corners, camera, fit, residuals, assessment)


def _searched(
    pictures: Sequence[PictureFile], finder: BoardFinder, workers: int, progress: Progress | None
) -> list[SearchedPicture]:
    """Every picture searched; of pictures that are the same to the bit only the first counts."""
    first: dict[bytes, str] = {}

    def searched(picture: PictureFile) -> tuple[SearchedPicture, bytes]:
        try:
            grey = read_picture(picture.path)
        except UnusablePictureError as problem:
            return SearchedPicture(picture, reason=_reason(problem)), b""
        size = (grey.shape[1], grey.shape[0])
        content = sha256(grey.tobytes()).digest()
        try:
            return SearchedPicture(picture, size, finder.find(grey)), content
        except NotSeenError as problem:
            return SearchedPicture(picture, size, reason=_reason(problem)), content

    views = []
    with ThreadPoolExecutor(workers or usable_cores()) as pool:
        try:
            for done, (view, content) in enumerate(pool.map(searched, pictures), 1):
                name = view.picture.name
                same = first.setdefault(content, name) if view.board else name
                views.append(view if same == name else view.without(f"the same picture as {same}"))
                if progress is not None:
                    progress(done, len(pictures))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return views


def _reason(problem: InputError) -> str:
    return problem.found + (f"; expected {problem.expected}" if problem.expected else "")


def _size(views: Sequence[SearchedPicture]) -> tuple[int, int]:
    """Width and height of most of the pictures that show the board, px."""
    return Counter(view.size for view in views if view.board and view.size).most_common(1)[0][0]


def _one_size(views: list[SearchedPicture], camera: Camera | None) -> list[SearchedPicture]:
    """The same, pictures of another size left out: a camera's file is of one."""
    if not any(view.board for view in views):
        return views
    whose = "the other pictures" if camera is None else "the camera's file"
    size = _size(views) if camera is None else (camera.width, camera.height)
    reason = f"where {whose} " + ("have" if camera is None else "has")
    return [
        view.without(f"{view.size[0]}x{view.size[1]} px {reason} {size[0]}x{size[1]}")
        if view.board and view.size and view.size != size
        else view
        for view in views
    ]


def _check_size(views: Sequence[SearchedPicture], camera: Camera) -> None:
    """Refuse a camera's file of another size than all pictures that show the board."""
    detected = [view for view in views if view.board and view.size]
    width, height = camera.width, camera.height
    if not detected or any(view.size == (width, height) for view in detected):
        return
    size = _size(views)
    if size == (height, width):
        hint = (
            "width and height are exchanged: pictures are read as the sensor has them, not turned "
            "by their EXIF entry. Calibrate the camera with these pictures (--camera-out)"
        )
    elif size[0] * height == size[1] * width:
        factor = size[0] / width
        hint = (
            "calibrate the camera with pictures of this size (--camera-out). If they were only "
            f"scaled, and neither cut nor binned, multiply fx and fy in its file by {factor:.6g}, "
            f"and take {factor:.6g} (c + 0.5) - 0.5 for cx and cy"
        )
    else:
        hint = (
            "the sides have another ratio, so these pictures are cut out or stretched: calibrate "
            "the camera with pictures of this size (--camera-out)"
        )
    raise SamplesError(
        f"pictures of {size[0]}x{size[1]} px",
        f"{width}x{height} px, the size that the camera's file states",
        file=detected[0].picture.path,
        hint=hint,
    )


def _with_rms(view: SearchedPicture, rms: Mapping[str, float]) -> SearchedPicture:
    """A picture with the RMS of its corners, where some pose of the board explains them."""
    value = rms.get(view.picture.name, float("nan"))
    return replace(view, rms=value if np.isfinite(value) else None)


def _corners(views: Sequence[SearchedPicture]) -> Corners:
    detections = [(view.picture.name, view.board) for view in views if view.board is not None]
    return corners_of(
        np.concatenate([np.full(len(detected.point), name) for name, detected in detections]),
        np.concatenate([detected.point for _, detected in detections]),
        np.concatenate([detected.pixel for _, detected in detections]),
    )


def _none_found(views: Sequence[SearchedPicture]) -> InputError:
    """The board is nowhere: the commonest reason, to be raised by the caller."""
    count = len(views)
    (reason, times), *rest = Counter(view.reason for view in views).most_common()
    first = next(view.picture for view in views if view.reason == reason)
    where = f", in {times} of {count} pictures" if count > 1 else ""
    also = f"; also: {listed([reason for reason, _ in rest], _MOST_TOLD)}" if rest else ""
    return SamplesError(
        f"{reason}{where}{also}",
        "the board as its file describes it, in a picture of the camera's size",
        file=first.path,
        hint="correct the file of the board, or the pictures",
    )


def _judged(
    rms: Sequence[float], pictures: BoardPictures, how: DetectionOptions
) -> tuple[list[str], list[str]]:
    """What is bad about a camera that was given, and what must be known."""
    errors = [error if np.isfinite(error) else np.inf for error in rms]
    median = float(np.median(errors)) if errors else 0.0
    cause = contradiction(pictures) if median > how.suspicious else None
    misfit = "The file of the camera or of the board does not fit the pictures: " + (
        f"RMS {median:.1f} px (median)"
        if np.isfinite(median)
        else "no pose of the board explains most corners"
    )
    if cause is not None:
        return [f"{misfit}; found {cause.found}; expected {cause.expected}; {cause.hint}."], []
    if median > how.unfit:
        return [
            f"{misfit}. Check whether the file belongs to this camera, focus and resolution."
        ], []
    if refocused := _refocused(pictures, median, how):
        return [], [refocused]
    remedy = "Measure the board, and calibrate the camera with --camera-out"
    return [], [f"{misfit}; {remedy}"] if median > how.doubtful else []


def _refocused(pictures: BoardPictures, median: float, how: DetectionOptions) -> str:
    """That the pictures are mirrored, or show the camera with other numbers; empty if neither.

    Either leaves far smaller errors.
    """
    # Fewer pictures hardly tell it, and more no better.
    least, most = 5, 16
    if median <= how.suspicious or len(pictures.pixels) < least:
        return ""
    chosen = np.linspace(0, len(pictures.pixels) - 1, min(len(pictures.pixels), most))
    subset = replace(pictures, pixels=pictures.pixels[chosen.astype(np.intp)])
    # So many times smaller; a board that is a little bent leaves the same with either camera.
    for sentence, pixels in otherwise_read(subset):
        if 3.0 * (left := float(np.nanmedian(replace(subset, pixels=pixels).rms))) <= median:
            return (
                f"The pictures agree far better with the camera's file ({left:.2f} px RMS instead "
                f"of {median:.2f} px) if {sentence}."
            )
    given = pictures.camera
    shown = shown_camera(subset, given.lens)
    if (
        shown is None
        or 3.0 * (left := float(np.nanmedian(replace(subset, camera=shown).rms))) > median
    ):
        return ""
    changes = ", ".join(
        f"{name} {given.values[name]:.1f} → {value:.1f}"
        for name, value in list(shown.values.items())[:4]
    )
    return (
        f"The pictures contradict the camera's file ({changes} px), which leaves errors of "
        f"{median:.2f} px (RMS) instead of {left:.2f} px: another focus, or another cut of the "
        "picture. Calibrate the camera again (--camera-out)."
    )


def _symmetry(board: Board) -> str:
    return (
        "The board looks the same after half a turn. Its corners are numbered as if it were "
        "upright in every picture. Only known poses of the hand can show where it was not. Use a "
        "board with an odd and an even number of corners."
        if board.symmetric
        else ""
    )


def _on_its_side(board: Board, views: Sequence[SearchedPicture]) -> str:
    """That a chessboard's columns may have been counted as its rows, which no picture tells.

    A board that lies in nearly every picture as it would lie with the counts exchanged is what
    there is to be seen of it.
    """
    if not isinstance(board, Chessboard) or board.exchanged is None:
        return ""
    lying = [_lies(board, view.board) for view in views if view.board is not None]
    # Share of the pictures in which a board lies on its side from which on it may be miscounted.
    if sum(lying) < 0.9 * len(lying):
        return ""
    which = "the picture" if len(lying) == 1 else f"{sum(lying)} of {len(lying)} pictures"
    return (
        f"In {which} the board lies on its side: rows of {board.columns} corners run up and "
        f"down, as the file states (corners: [{board.columns}, {board.rows}]). If columns and "
        "rows are exchanged in the file, the same corners are found but numbered along the other "
        "side: the camera is still right, but the frame of the board is wrong by a quarter turn. "
        "Check the numbers in the pictures (--report DIR --pictures)."
    )


def _lies(board: Chessboard, detected: DetectedBoard) -> bool:
    """Whether the board's x runs rather up or down in a picture, and its y to a side."""
    place = board.positions(detected.point)[:, :2]
    across, along = np.linalg.lstsq(
        place - place.mean(axis=0), detected.pixel - detected.pixel.mean(axis=0), rcond=None
    )[0]
    return bool(abs(across[1]) > abs(across[0]) and abs(along[0]) > abs(along[1]))


def _left_out(views: Sequence[SearchedPicture]) -> str:
    lost = [f"{view.picture.name} ({view.reason})" for view in views if view.board is None]
    sentence = f"{len(lost)} of {len(views)} pictures are not used: {listed(lost, _MOST_TOLD)}."
    return sentence if lost else ""
