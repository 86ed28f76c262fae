"""ArUco markers and AprilTags in pictures, alone or in the white squares of a chessboard."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.errors import BoardError
from suta_calib.measurements.board import Charuco, Markers
from suta_calib.vision.corner_model import FittedCorners, fit_corners
from suta_calib.vision.finder import (
    RADII,
    DetectedBoard,
    NotSeenError,
    homography,
    nothing_seen,
    refined,
    transformed,
)
from suta_calib.vision.opencv import marker_dictionaries, marker_dictionary, opencv
from suta_calib.vision.pictures import Grey
from suta_calib.words import listed

# Share of the markers that must lie where the board has them.
_LEAST_IN_PLACE: Final = 0.6
# Markers around a corner from which its place is foretold.
_NEAREST: Final = 4


def marker_cells(board: Charuco, *, legacy: bool = False) -> IntArray:
    """Column and row (n, 2) of the squares that hold the markers, in their order.

    As OpenCV drew it before 4.6 (``legacy``) the first square is white where the number of rows is
    even.
    """
    row, column = np.indices((board.rows, board.columns))
    white = (row + column) % 2 == (0 if legacy and board.rows % 2 == 0 else 1)
    return np.stack([column[white], row[white]], axis=1)


def _seen_markers(grey: Grey, dictionary: str) -> tuple[FloatArray, IntArray]:
    """Corners (n, 4, 2) and numbers (n,) of all markers of a dictionary."""
    detector = opencv().aruco.ArucoDetector(marker_dictionary(dictionary))
    quads, numbers, _ = detector.detectMarkers(grey)
    if numbers is None or not len(quads):
        return np.zeros((0, 4, 2)), np.zeros(0, dtype=np.intp)
    corners = np.array(quads, dtype=float).reshape(-1, 4, 2)
    return corners, np.asarray(numbers, dtype=np.intp).ravel()


def _none_seen(grey: Grey, dictionary: str, what: str) -> NotSeenError:
    """Why there are no markers: a mirrored picture, another dictionary, or as ever."""
    if len(_seen_markers(np.ascontiguousarray(grey[:, ::-1]), dictionary)[1]):
        return NotSeenError(f"mirrored markers of {dictionary}")
    counts = {name: len(_seen_markers(grey, name)[1]) for name in marker_dictionaries()}
    # Small dictionaries are parts of larger ones, so that the first of those that see most counts.
    best = max(counts, key=lambda name: counts[name])
    if counts[best] > 1:
        return NotSeenError(f"{counts[best]} markers of {best} instead of {dictionary}")
    return nothing_seen(grey, what)


def _check_once(numbers: IntArray) -> None:
    """Refuse a marker twice."""
    unique, count = np.unique(numbers, return_counts=True)
    if (count > 1).any():
        raise NotSeenError(f"two boards: marker {unique[count > 1][0]} is visible twice")


@dataclass(frozen=True, eq=False)
class MarkersFinder:
    """Finds markers of known places.

    Attributes:
        board: to be found.

    Raises:
        BoardError: there is no such dictionary, or it does not have a marker of the board.
    """

    board: Markers

    def __post_init__(self) -> None:
        _check_numbers(self.board.dictionary, max(self.board.markers), "markers")

    def find(self, grey: Grey) -> DetectedBoard:
        """The corners of all its markers that are seen."""
        corners, numbers = _seen_markers(grey, self.board.dictionary)
        if not len(numbers):
            raise _none_seen(grey, self.board.dictionary, "marker")
        of_board = np.isin(numbers, list(self.board.markers))
        if not of_board.any():
            other_numbers = listed([str(number) for number in np.unique(numbers)])
            raise NotSeenError(f"markers that are not on the board: {other_numbers}")
        _check_once(numbers[of_board])
        order = np.argsort(numbers[of_board])
        point = (4 * numbers[of_board][order, None] + np.arange(4)).ravel()
        fitted = self._refined(grey, corners[of_board][order])
        return DetectedBoard(point, fitted.pixel, fitted.std, float(np.median(fitted.blur)))

    def _refined(self, grey: Grey, corners: FloatArray) -> FittedCorners:
        """Corners (m, 4, 2) of the markers' black squares, one after the other."""
        forth, back = (np.roll(corners, by, axis=1) - corners for by in (-1, 1))
        # Turning from u to v, as its corners do, the square is beyond either edge.
        edges = np.stack([_angle(forth), _angle(-back)], axis=-1).reshape(-1, 2)
        cells = int(marker_dictionary(self.board.dictionary).markerSize) + 2
        # The rim is as wide as a cell; of the white around it there is as much.
        rim = float(np.linalg.norm(forth, axis=2).min()) / cells
        start = corners.reshape(-1, 2)
        # Radius of the disc around a marker's corner, in widths of its black rim.
        fitted = fit_corners(grey, start, int(np.clip(0.9 * rim, *RADII)), edges)
        lost = np.linalg.norm(fitted.pixel - start, axis=1) > max(rim, 2.0)
        if lost.any():
            pixel = np.where(lost[:, None], start, fitted.pixel)
            # Standard deviation of a corner that could not be refined, px.
            fitted = replace(fitted, pixel=pixel, std=np.where(lost, 0.5, fitted.std))
        return fitted


@dataclass(frozen=True, eq=False)
class CharucoFinder:
    """Finds a chessboard with markers, also a part of one.

    Attributes:
        board: to be found.

    Raises:
        BoardError: there is no such dictionary, or it has fewer markers than the board.
    """

    board: Charuco

    def __post_init__(self) -> None:
        _check_numbers(self.board.dictionary, len(marker_cells(self.board)) - 1, "squares")

    @cached_property
    def _layouts(self) -> list[FloatArray]:
        """Corners (m, 4, 2) of the markers, in squares, in each way that OpenCV draws the board."""
        cells = [marker_cells(self.board)]
        if self.board.rows % 2 == 0:
            cells.append(marker_cells(self.board, legacy=True))
        return [self._corners(cells_of_one) for cells_of_one in cells]

    def _corners(self, cells: IntArray) -> FloatArray:
        half = 0.5 * self.board.marker / self.board.square
        around = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        return np.asarray((cells + 0.5)[:, None] + around)

    def find(self, grey: Grey) -> DetectedBoard:
        """Its inner corners that are seen."""
        corners, numbers = _seen_markers(grey, self.board.dictionary)
        if not len(numbers):
            raise _none_seen(grey, self.board.dictionary, "markers")
        of_board = numbers < len(self._layouts[0])
        if not of_board.any():
            raise NotSeenError(
                f"markers {listed([str(n) for n in np.unique(numbers)])}, but such a board has "
                f"only 0 to {len(self._layouts[0]) - 1}"
            )
        corners, numbers = corners[of_board], numbers[of_board]
        _check_once(numbers)
        size = float(np.median(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)))
        placed = [_in_place(layout[numbers], corners, size) for layout in self._layouts]
        layout, inside = max(zip(self._layouts, placed, strict=True), key=lambda one: one[1].sum())
        if inside.mean() < _LEAST_IN_PLACE:
            # A few markers of a small dictionary are others' mirror images.
            mirrored = _seen_markers(np.ascontiguousarray(grey[:, ::-1]), self.board.dictionary)[1]
            if len(mirrored) > len(numbers):
                raise NotSeenError(f"mirrored markers of {self.board.dictionary}")
            raise NotSeenError(self._misplaced(corners, numbers, size))
        return self._between(grey, layout[numbers[inside]], corners[inside])

    def _between(self, grey: Grey, marked: FloatArray, corners: FloatArray) -> DetectedBoard:
        """Corners of squares, foretold from the markers around them and refined."""
        middle, points, places, start, spacing = marked.mean(axis=1), [], [], [], []
        for number, place in self.board.points.items():
            place = place[:2] / self.board.square
            away = np.linalg.norm(middle - place, axis=1)
            near = np.argsort(away)[:_NEAREST]
            # No farther than a square away.
            near = near[away[near] < max(1.0, float(away.min()) + 0.1)]
            if away.min() > 1.0:
                continue
            planes = marked[near].reshape(-1, 2), corners[near].reshape(-1, 2)
            H = opencv().findHomography(*planes, 0)[0]
            H = np.eye(3) if H is None else np.asarray(H)
            around = transformed(H, place + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
            points.append(number)
            places.append(place)
            start.append(around[0])
            spacing.append(np.linalg.norm(around[1:] - around[0], axis=1).min())
        if not points:
            raise NotSeenError("markers of the board, but no corner next to one")
        # What is white between the markers around a corner: its disc reaches no marker, and farther
        # off from where its neighbours have it are corners of markers.
        white = (1.0 - self.board.marker / self.board.square) / 2.0
        least, most = float(np.min(spacing)), min(1.3 * white, 0.45)
        saddles, usable = refined(grey, np.array(start), least, most=most)
        again = _among(np.array(places), saddles, usable, least)
        predicted = np.isfinite(again[:, 0])
        if predicted.any():
            again[~predicted] = np.array(start)[~predicted]
            saddles, usable = refined(grey, again, least, most=most, reach=white)
            usable &= predicted
        if not usable.any():
            raise NotSeenError("markers of the board, but no corner of its squares")
        return DetectedBoard.of(saddles, usable, np.array(points))

    def _misplaced(self, corners: FloatArray, numbers: IntArray, size: float) -> str:
        """What board the markers are of, if it is only wider or narrower."""
        for columns in range(3, 60):
            rows = 2 * (int(numbers.max()) + 1) // columns + 2
            for parity in (rows, rows + 1):
                board = Charuco(columns, parity, 1.0, 0.75, self.board.dictionary)
                for legacy in (False, True):
                    cells = marker_cells(board, legacy=legacy)
                    if len(cells) <= numbers.max():
                        continue
                    there = self._corners(cells)[numbers]
                    if _in_place(there, corners, size).mean() > _LEAST_IN_PLACE:
                        return f"a board {columns} squares wide instead of {self.board.columns}"
        return "markers of the board, but at other positions than on the board"


def _among(
    places: FloatArray, fitted: FittedCorners, good: BoolArray, spacing: float
) -> FloatArray:
    """Where corners (n, 2) are by those around them; NaN where these do not tell it.

    A marker that is blurred, or seen aslant, is found some pixels off, and what is then taken for a
    corner beside it may be its own. Places (n, 2) are in squares, their spacing in px.
    """
    predicted = np.full((len(places), 2), np.nan)
    if not good.any():
        return predicted
    # They may explain a little less of the picture than the middle one.
    clear = np.flatnonzero(good & (fitted.score >= np.median(fitted.score[good]) - 0.1))
    for k, place in enumerate(places):
        candidates = clear[clear != k]
        near = candidates[np.argsort(np.linalg.norm(places[candidates] - place, axis=1))[:8]]
        offsets = places[near] - place
        # Markers on one line determine nothing beside it.
        if len(near) <= _NEAREST or np.linalg.matrix_rank(offsets - offsets.mean(axis=0), 0.1) < 2:
            continue
        # From where a plane has them, in ways to the next one.
        H, agreeing = homography(places[near], fitted.pixel[near], 0.05 * spacing)
        if H is not None and agreeing.sum() > _NEAREST:
            predicted[k] = transformed(H, place[None])[0]
    return predicted


def _angle(direction: FloatArray) -> FloatArray:
    return np.arctan2(direction[..., 1], direction[..., 0])


def _in_place(marked: FloatArray, corners: FloatArray, size: float) -> Any:
    """(m,) which markers lie where a plane board has them."""
    # How far marker corners may be from where a plane board has them, in edges of a marker: a lens
    # bends a board more than a marker is misread.
    _, inliers = homography(marked.reshape(-1, 2), corners.reshape(-1, 2), 0.35 * size)
    return inliers.reshape(-1, 4).all(axis=1)


def _check_numbers(dictionary: str, largest: int, where: str) -> None:
    """Refuse a board with markers that its dictionary does not have."""
    count = len(marker_dictionary(dictionary).bytesList)
    if largest >= count:
        raise BoardError(
            f"marker {largest} of {dictionary}, which has {count}",
            f"numbers up to {count - 1}",
            where=where,
            hint="check the name of the dictionary",
        )


def marker_bits(dictionary: str, number: int) -> FloatArray:
    """A marker's cells (k, k) with its black border: 0 black, 1 white."""
    marker_set = marker_dictionary(dictionary)
    cells = int(marker_set.markerSize) + 2
    drawn = opencv().aruco.generateImageMarker(marker_set, number, cells)
    return np.asarray(drawn, dtype=float) / 255.0
