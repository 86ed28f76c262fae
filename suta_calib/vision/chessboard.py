"""Chessboards in pictures: found, refined, counted, and numbered as the board says.

OpenCV finds a chessboard of a given size, also as a part of a larger one. So what is found is
grown as far as squares go on: a board of another size is named instead of being taken.

OpenCV's search from square to square (``findChessboardCorners``) is the faster one. But where a
picture has many more squares than the board, as of a texture or of a part of a larger board, it
tries subsets of them for hours and cannot be stopped
(https://github.com/opencv/opencv/issues/23558), so that it is left out there. The search of corners
by themselves (``findChessboardCornersSB``) takes time in proportion to the picture, whatever is in
it, and finds more of the small and blurred boards, but fewer that have little white around them.
With its greys equalised, which it needs in a picture of little contrast, it finds none where all
about the board is dark: the dark squares become as grey as the rest. So it searches both ways.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.measurements.board import Chessboard
from suta_calib.vision.finder import DetectedBoard, NotSeenError, nothing_seen, refined, without
from suta_calib.vision.opencv import opencv
from suta_calib.vision.pictures import Grey

# Larger pictures are searched in smaller copies first: it is faster, and blur and noise are less.
_SEARCHED: Final = (1000, 1600)
# Smallest board that a search for any board begins from.
_SEED: Final = 3
# Share of the corners of a board that must be seen; others may lie in a glare or under a cable.
_LEAST_SEEN: Final = 0.8
# Share of a further row whose corners are found where they would be if the board went on.
_GOES_ON: Final = 0.6
# Other boards that lie about.
_COMMON: Final = (
    *((4, 3), (5, 4), (6, 4), (6, 5), (7, 5), (7, 6), (8, 5), (8, 6), (9, 6), (9, 7)),
    *((10, 7), (11, 8), (13, 9)),
)


@dataclass(frozen=True, eq=False)
class _Grid:
    """Corners in rows and columns.

    Attributes:
        pixel: (rows, columns, 2) px.
        detected: (rows, columns) which were found in the picture.
    """

    pixel: FloatArray
    detected: BoolArray

    @property
    def sides(self) -> tuple[FloatArray, FloatArray]:
        """Ways (2,) from the first corner along the first row and the first column, px."""
        return self.pixel[0, -1] - self.pixel[0, 0], self.pixel[-1, 0] - self.pixel[0, 0]

    @property
    def steps(self) -> tuple[FloatArray, FloatArray]:
        """Ways from each corner to the next, down the columns and along the rows, px."""
        down, right = (np.linalg.norm(np.diff(self.pixel, axis=k), axis=2) for k in (0, 1))
        return down, right

    @property
    def spacing(self) -> float:
        """Least way from a corner to the next, px."""
        return min(float(steps.min()) for steps in self.steps)

    @property
    def regular(self) -> bool:
        """Whether no row or column is left out: steps change little from one to the next."""
        # A step from corner to corner, in steps before it: perspective makes them longer by some
        # per cent. OpenCV's search of corners by themselves leaves out rows to come to the size it
        # is asked for.
        return not any(
            np.any(np.abs(np.diff(np.log(np.maximum(steps, 1e-3)), axis=k)) > np.log(1.5))
            for k, steps in enumerate(self.steps)
        )


@dataclass(frozen=True, eq=False)
class _Copy:
    """A copy of a picture to search in.

    Attributes:
        grey: of its pixels.
        scale: how many times smaller it is.
    """

    grey: Grey
    scale: float

    def inside(self, pixel: FloatArray) -> FloatArray:
        """Places (…, 2) of the picture in the copy. Pixels are counted by their centres in both."""
        return (pixel + 0.5) / self.scale - 0.5

    def outside(self, pixel: FloatArray) -> FloatArray:
        """Places (…, 2) of the copy in the picture."""
        return (pixel + 0.5) * self.scale - 0.5

    @cached_property
    def squares(self) -> int:
        """How many dark patches the search from square to square may take for some, about.

        At the thresholds with which it begins, and as it parts squares that touch.
        """
        cv2 = opencv()
        blocks = [round(part * min(self.grey.shape)) | 1 for part in (0.2, 0.1)]
        how = (255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY)
        levels = [cv2.adaptiveThreshold(self.grey, *how, block, 0) for block in blocks]
        levels.append(cv2.threshold(self.grey, 0, 255, cv2.THRESH_OTSU)[1])
        return max(_patches(cv2.bitwise_not(cv2.dilate(level, None))) for level in levels)


@dataclass(frozen=True, eq=False)
class ChessboardFinder:
    """Finds one chessboard.

    Attributes:
        board: to be found.
    """

    board: Chessboard

    def find(self, grey: Grey) -> DetectedBoard:
        """The board, its corners numbered along the rows."""
        size = (self.board.columns, self.board.rows)
        copies = list(_copies(grey))
        grid: _Grid | None = None
        instead: _Grid | None = None
        for grid in self._asked_for(grey, copies):
            if sorted(grid.detected.shape) == sorted(size):
                break
            # A row may be lost where another search, or a larger copy, finds it.
            instead = instead or grid
        else:
            grid = instead or self._other(grey, copies[0])
        if grid is None:
            raise nothing_seen(grey, "chessboard")
        if sorted(grid.detected.shape) != sorted(size):
            # Which way the grid lies was not asked for.
            longer, shorter = sorted(grid.detected.shape, reverse=True)
            longer_first = (longer, shorter) if size[0] >= size[1] else (shorter, longer)
            raise NotSeenError(
                f"{longer_first[0]}x{longer_first[1]} inner corners instead of {size[0]}x{size[1]}"
            )
        # Squares' widths around the outer corners belong to the board as well.
        rest = without(grey, grid.pixel.reshape(-1, 2), 1.6 * max(s.max() for s in grid.steps))
        if _by_squares(grey, next(_copies(rest)), size):
            raise NotSeenError("two boards")
        return self._numbered(grey, grid)

    def _asked_for(self, grey: Grey, copies: list[_Copy]) -> Iterator[_Grid]:
        """What is found in the copies when asked for the board."""
        size = (self.board.columns, self.board.rows)
        corner_searches = (_by_corners, _by_corners_as_taken)
        by_corners = ((search, copy) for copy in copies for search in corner_searches)
        for search, copy in (*((_by_squares, copy) for copy in copies), *by_corners):
            grid = search(grey, copy, size)
            if grid is not None:
                yield grid
        grid = _by_corners(grey, _last_resort(grey), size)
        if grid is not None:
            yield grid

    def _other(self, grey: Grey, copy: _Copy) -> _Grid | None:
        """Any board that is there instead."""
        sizes = list(_wrongly_counted((self.board.columns, self.board.rows)))
        searches = [
            *(partial(_by_corners, grey, copy, other) for other in (None, *sizes)),
            *(partial(_by_squares, grey, copy, other) for other in sizes),
        ]
        return next((grid for search in searches if (grid := search()) is not None), None)

    def _numbered(self, grey: Grey, grid: _Grid) -> DetectedBoard:
        """Numbers as the board's file has them, whichever way the search went."""
        best = max(self._ways(grid), key=lambda way: self._fitness(grey, way))
        for copy in (_Copy(grey, 1.0), _judging_copy(grey, best.spacing)):
            start = copy.inside(best.pixel.reshape(-1, 2))
            saddles, detected = refined(copy.grey, start, best.spacing / copy.scale)
            detected &= best.detected.ravel()
            if detected.mean() >= _LEAST_SEEN:
                numbers = np.arange(len(detected))
                return DetectedBoard.of(saddles, detected, numbers, copy.scale, copy.outside)
        raise nothing_seen(grey, "chessboard")

    def _ways(self, grid: _Grid) -> Iterator[_Grid]:
        """All ways to number the grid that are seen from the board's face."""
        pixel, detected = grid.pixel, grid.detected
        right, down = grid.sides
        if right[0] * down[1] - right[1] * down[0] < 0:
            pixel, detected = pixel[:, ::-1], detected[:, ::-1]
        for quarter in range(4):
            turned, there = np.rot90(pixel, quarter), np.rot90(detected, quarter)
            if there.shape == (self.board.rows, self.board.columns):
                yield _Grid(turned, there)

    def _fitness(self, grey: Grey, way: _Grid) -> tuple[bool, float]:
        """Whether the square between the first four corners is dark; how upright the board is.

        Where half a turn changes the colours, they alone decide.
        """
        right, down = way.sides
        upright = right[0] / np.linalg.norm(right) + down[1] / np.linalg.norm(down)
        return _dark(grey, way.pixel), float(upright)


def _dark(grey: Grey, pixel: FloatArray) -> bool:
    """Whether the square between the first four corners of a grid is one of the dark ones."""
    middle = (pixel[:-1, :-1] + pixel[1:, :-1] + pixel[:-1, 1:] + pixel[1:, 1:]) / 4
    at = np.clip(np.round(middle).astype(np.intp), 0, np.array(grey.shape[::-1]) - 1)
    greys = grey[at[..., 1], at[..., 0]].astype(float)
    same_colour = np.indices(greys.shape).sum(axis=0) % 2 == 0
    other_greys = greys[~same_colour]
    return bool(len(other_greys) and np.median(greys[same_colour]) < np.median(other_greys))


def _wrongly_counted(size: tuple[int, int]) -> Iterator[tuple[int, int]]:
    """Sizes that a board may have whose file says another."""
    # Squares counted for corners, one too many.
    miscounted = ((-1, -1), (1, 1), (-1, 0), (0, -1), (1, 0), (0, 1), (-2, -2), (2, 2))
    near = ((size[0] + more[0], size[1] + more[1]) for more in miscounted)
    yield from (size for size in near if min(size) >= _SEED)
    yield from _COMMON


def _by_corners(
    grey: Grey, copy: _Copy, size: tuple[int, int] | None, equalised: bool = True
) -> _Grid | None:
    """By OpenCV's search of corners by themselves; any board where no size is given."""
    cv2 = opencv()
    how = cv2.CALIB_CB_NORMALIZE_IMAGE * equalised if size else cv2.CALIB_CB_LARGER
    success, corners, meta = cv2.findChessboardCornersSBWithMeta(
        copy.grey, size or (_SEED, _SEED), how
    )
    return _complete_grid(grey, corners, meta.shape[1::-1], copy.scale) if success else None


def _by_corners_as_taken(grey: Grey, copy: _Copy, size: tuple[int, int]) -> _Grid | None:
    """The same without equalised greys."""
    return _by_corners(grey, copy, size, equalised=False)


def _by_squares(grey: Grey, copy: _Copy, size: tuple[int, int]) -> _Grid | None:
    """By OpenCV's search from square to square, in pictures in which it comes to an end."""
    cv2 = opencv()
    squares = (size[0] + 1) * (size[1] + 1) // 2
    there = copy.squares
    # Squared number of patches in a picture that may be squares, times those too many for the
    # board: work that the search from square to square does in a second or two.
    if (there - squares) * there**2 > 1e6:
        return None
    how = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    success, corners = cv2.findChessboardCorners(copy.grey, size, flags=how)
    return _complete_grid(grey, corners, size, copy.scale) if success else None


def _patches(binary: Grey) -> int:
    """How many patches of a binary picture may be squares, by their size and how much they fill."""
    patches = opencv().connectedComponentsWithStats(binary, connectivity=4)[2][1:]
    width, height, area = patches[:, 2:].T.astype(float)
    # At least 25 px large; a square that stands on its corner fills half of the upright rectangle
    # around it, and one that is seen aslant less.
    return int(np.sum((area >= 25.0) & (area >= 0.3 * width * height)))


def _copies(grey: Grey) -> Iterator[_Copy]:
    """Copies of a picture to search in, small ones first."""
    largest = max(grey.shape)
    yield from (_smaller(grey, largest / size) for size in _SEARCHED if largest > size)
    yield _Copy(grey, 1.0)


def _last_resort(grey: Grey) -> _Copy:
    """A copy of half of the smallest size, where all others show no board of the size asked for.

    Of a blurred or noisy board OpenCV finds no corner, or a part of them, in anything larger.
    """
    return _smaller(grey, 2.0 * max(max(grey.shape) / _SEARCHED[0], 1.0))


def _smaller(grey: Grey, scale: float) -> _Copy:
    """A copy so many times smaller."""
    size = tuple(round(n / scale) for n in grey.shape[::-1])
    return _Copy(opencv().resize(grey, size, interpolation=opencv().INTER_AREA), scale)


def _judging_copy(grey: Grey, spacing: float) -> _Copy:
    """The copy in which corners so many px apart are told from what is none."""
    # Way from corner to corner, px, in the copy in which corners are told from what is none: the
    # disc around a corner (`RADII`) reaches 0.3 of the way. Of squares ten times as wide it sees
    # nothing but blur, and the rim of a board passes for another row.
    scale = spacing / 26.0
    return _smaller(grey, scale) if scale > 1.0 else _Copy(grey, 1.0)


def _complete_grid(
    grey: Grey, corners: FloatArray, size: tuple[int, int], scale: float
) -> _Grid | None:
    """The board that corners of a copy are of, in the picture itself; None where of none."""
    columns, rows = size
    start = _Copy(grey, scale).outside(corners.astype(float).reshape(-1, 2))
    rough = _Grid(start.reshape(rows, columns, 2), np.ones((rows, columns), dtype=np.bool_))
    if rough.spacing < 2.0 or not rough.regular:
        return None
    copy = _judging_copy(grey, rough.spacing)
    start = copy.inside(start)
    saddles, detected = refined(copy.grey, start, rough.spacing / copy.scale)
    if detected.mean() < _LEAST_SEEN:
        return None
    pixel = np.where(detected[:, None], saddles.pixel, start).reshape(rows, columns, 2)
    # How much less of the picture the corners of a further row may explain than those of the board:
    # between a rim and what lies behind it there are things that are nearly corners.
    less_clear = 0.1
    clear = float(np.median(saddles.score[detected])) - less_clear
    detected = (detected & (saddles.score >= clear)).reshape(rows, columns)
    for _ in range(4):
        while len(detected) > 2 and detected[-1].mean() < _GOES_ON:
            pixel, detected = pixel[:-1], detected[:-1]
        pixel, detected = _grown(copy.grey, pixel, detected, clear)
        # After four quarter turns it is as it was.
        pixel, detected = np.rot90(pixel), np.rot90(detected)
    return _Grid(copy.outside(pixel), detected)


def _grown(
    grey: Grey, pixel: FloatArray, detected: BoolArray, clear: float
) -> tuple[FloatArray, BoolArray]:
    """A grid with all rows that follow its last one in the picture."""
    while len(pixel) < 200:
        spacing = _Grid(pixel, detected).spacing
        further = 2 * pixel[-1] - pixel[-2]
        if len(pixel) > 2:
            # Perspective makes steps longer or shorter from row to row.
            further += pixel[-1] - 2 * pixel[-2] + pixel[-3]
        # How far from there, in ways to the next corner. At the rim of a board a single square's
        # corner passes for one of two squares about a third of the way off.
        saddles, there = refined(grey, further, spacing, reach=0.15)
        there &= saddles.score >= clear
        if there.mean() < _GOES_ON:
            break
        row = np.where(there[:, None], saddles.pixel, further)
        pixel, detected = np.vstack([pixel, row[None]]), np.vstack([detected, there[None]])
    return pixel, detected
