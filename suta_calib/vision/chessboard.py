"""Chessboards in pictures: found, refined, counted, and numbered as the board says.

OpenCV finds a chessboard of a given size, also as a part of a larger one. So what is found is
grown as far as squares go on: a board of another size is named instead of being taken.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.measurements.board import Chessboard
from suta_calib.vision.finder import Finder, Found, NotSeenError, nothing_seen, refined, without
from suta_calib.vision.opencv import opencv
from suta_calib.vision.pictures import Grey

# Larger pictures are searched in smaller copies first: it is faster, and blur and noise are less.
_SEARCHED: Final = 1600
# Smallest board that a search for any board begins from.
_SEED: Final = 3
# Share of the corners of a board that must be seen; others may lie in a glare or under a cable.
_LEAST_SEEN: Final = 0.8
# Share of a further row whose corners are found where they would be if the board went on.
_GOES_ON: Final = 0.6
# How far from there, in ways to the next corner. At the rim of a board a single square's corner
# passes for one of two squares about a third of the way off.
_ROW_REACH: Final = 0.15
# How much less of the picture the corners of a further row may explain than those of the board:
# between a rim and what lies behind it there are things that are nearly corners.
_LESS_CLEAR: Final = 0.1
_MOST_ROWS: Final = 200
# Other boards that lie about.
_COMMON: Final = (
    *((4, 3), (5, 4), (6, 4), (6, 5), (7, 5), (7, 6), (8, 5), (8, 6), (9, 6), (9, 7)),
    *((10, 7), (11, 8), (13, 9)),
)
# A step from corner to corner, in steps before it: perspective makes them longer by some per cent.
# OpenCV's search of corners by themselves leaves out rows to come to the size it is asked for.
_LONGEST_STEP: Final = 1.5
# Sizes that a board has in truth whose file is wrong: squares counted for corners, one too many.
_MISCOUNTED: Final = ((-1, -1), (1, 1), (-1, 0), (0, -1), (1, 0), (0, 1), (-2, -2), (2, 2))


@dataclass(frozen=True, eq=False)
class _Grid:
    """Corners in rows and columns.

    Attributes:
        pixel: (rows, columns, 2) px.
        seen: (rows, columns) which were found in the picture.
    """

    pixel: FloatArray
    seen: BoolArray

    @property
    def spacing(self) -> float:
        """Least way from a corner to the next, px."""
        return min(float(np.linalg.norm(np.diff(self.pixel, axis=k), axis=2).min()) for k in (0, 1))

    @property
    def regular(self) -> bool:
        """Whether no row or column is left out: steps change little from one to the next."""
        for axis in (0, 1):
            steps = np.linalg.norm(np.diff(self.pixel, axis=axis), axis=2)
            longer = np.abs(np.diff(np.log(np.maximum(steps, 1e-3)), axis=axis))
            if np.any(longer > np.log(_LONGEST_STEP)):
                return False
        return True


@dataclass(frozen=True, eq=False)
class ChessboardFinder(Finder):
    """Finds one chessboard.

    Attributes:
        board: to be found.
    """

    board: Chessboard

    def find(self, grey: Grey) -> Found:
        """The board, its corners numbered along the rows.

        Raises:
            NotSeenError: another size, two boards, or none.
        """
        size = (self.board.columns, self.board.rows)
        copies = list(_copies(grey))
        grid = next((grid for copy in copies if (grid := _by_squares(grey, *copy, size))), None)
        if grid is None:
            grid = self._otherwise(grey, *copies[0])
        if grid is None:
            raise nothing_seen(grey, "chessboard")
        if sorted(grid.seen.shape) != sorted(size):
            # Which way the grid lies was not asked for.
            longer, shorter = sorted(grid.seen.shape, reverse=True)
            told = (longer, shorter) if size[0] >= size[1] else (shorter, longer)
            raise NotSeenError(f"{told[0]}x{told[1]} inner corners instead of {size[0]}x{size[1]}")
        # Squares' widths around the outer corners belong to the board as well.
        rest, scale = next(_copies(without(grey, grid.pixel.reshape(-1, 2), 1.6 * _widest(grid))))
        if _by_squares(grey, rest, scale, size):
            raise NotSeenError("two boards")
        return self._numbered(grey, grid)

    def _otherwise(self, grey: Grey, copy: Grey, scale: float) -> _Grid | None:
        """A board that is blurred or has small squares; else any that is there instead."""
        size = (self.board.columns, self.board.rows)
        # Asked for a board smaller than what is there, as where a part of one is in the picture,
        # OpenCV's search from square to square tries subsets of the squares for hours: it is last.
        for each in (size, None):
            grid = _by_sectors(grey, copy, scale, each)
            if grid is not None:
                return grid
        others = (_by_squares(grey, copy, scale, other) for other in _wrongly_counted(size))
        return next((grid for grid in others if grid is not None), None)

    def _numbered(self, grey: Grey, grid: _Grid) -> Found:
        """Numbers as the board's file has them, whichever way the search went."""
        best = max(self._ways(grid), key=lambda way: self._fitness(grey, way))
        saddles, seen = refined(grey, best.pixel.reshape(-1, 2), best.spacing)
        seen &= best.seen.ravel()
        if seen.mean() < _LEAST_SEEN:
            raise nothing_seen(grey, "chessboard")
        return Found(
            np.flatnonzero(seen),
            saddles.pixel[seen],
            saddles.std[seen],
            float(np.median(saddles.blur[seen])),
        )

    def _ways(self, grid: _Grid) -> Iterator[_Grid]:
        """All ways to number the grid that are seen from the board's face."""
        pixel, seen = grid.pixel, grid.seen
        right, down = pixel[0, -1] - pixel[0, 0], pixel[-1, 0] - pixel[0, 0]
        if right[0] * down[1] - right[1] * down[0] < 0:
            pixel, seen = pixel[:, ::-1], seen[:, ::-1]
        for quarter in range(4):
            turned, there = np.rot90(pixel, quarter), np.rot90(seen, quarter)
            if there.shape == (self.board.rows, self.board.columns):
                yield _Grid(turned, there)

    def _fitness(self, grey: Grey, way: _Grid) -> tuple[bool, float]:
        """Whether the square between the first four corners is dark; how upright the board is.

        Where half a turn changes the colours, they alone decide.
        """
        pixel = way.pixel
        right, down = pixel[0, -1] - pixel[0, 0], pixel[-1, 0] - pixel[0, 0]
        upright = right[0] / np.linalg.norm(right) + down[1] / np.linalg.norm(down)
        return _dark(grey, pixel), float(upright)


def _dark(grey: Grey, pixel: FloatArray) -> bool:
    """Whether the square between the first four corners of a grid is one of the dark ones."""
    middle = (pixel[:-1, :-1] + pixel[1:, :-1] + pixel[:-1, 1:] + pixel[1:, 1:]) / 4
    at = np.clip(np.round(middle).astype(np.intp), 0, np.array(grey.shape[::-1]) - 1)
    greys = grey[at[..., 1], at[..., 0]].astype(float)
    alike = np.indices(greys.shape).sum(axis=0) % 2 == 0
    return bool(np.median(greys[alike]) < np.median(greys[~alike])) if (~alike).any() else False


def _wrongly_counted(size: tuple[int, int]) -> Iterator[tuple[int, int]]:
    """Sizes that a board may have whose file says another."""
    near = ((size[0] + more[0], size[1] + more[1]) for more in _MISCOUNTED)
    yield from (each for each in near if min(each) >= _SEED)
    yield from _COMMON


def _by_squares(grey: Grey, copy: Grey, scale: float, size: tuple[int, int]) -> _Grid | None:
    """By OpenCV's search from square to square: a few hundredths of a second."""
    cv2 = opencv()
    how = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    found, corners = cv2.findChessboardCorners(copy, size, flags=how)
    return _whole(grey, corners, size, scale) if found else None


def _by_sectors(grey: Grey, copy: Grey, scale: float, size: tuple[int, int] | None) -> _Grid | None:
    """By OpenCV's search of corners by themselves: a second; any board where no size is given."""
    cv2 = opencv()
    how = cv2.CALIB_CB_NORMALIZE_IMAGE if size else cv2.CALIB_CB_LARGER
    found, corners, meta = cv2.findChessboardCornersSBWithMeta(copy, size or (_SEED, _SEED), how)
    return _whole(grey, corners, meta.shape[1::-1], scale) if found else None


def _copies(grey: Grey) -> Iterator[tuple[Grey, float]]:
    """Copies of a picture to search in, and how many times smaller each is."""
    cv2 = opencv()
    scale = max(grey.shape) / _SEARCHED
    if scale > 1:
        size = tuple(round(n / scale) for n in grey.shape[::-1])
        yield cv2.resize(grey, size, interpolation=cv2.INTER_AREA), scale
    yield grey, 1.0


def _whole(grey: Grey, corners: FloatArray, size: tuple[int, int], scale: float) -> _Grid | None:
    """The board that corners of a copy are of, in the picture itself; None where of none."""
    columns, rows = size
    # Pixels are counted by their centres, in the copy too.
    start = (corners.astype(float).reshape(-1, 2) + 0.5) * scale - 0.5
    rough = _Grid(start.reshape(rows, columns, 2), np.ones((rows, columns), dtype=np.bool_))
    if rough.spacing < 2.0 or not rough.regular:
        return None
    saddles, seen = refined(grey, start, rough.spacing)
    if seen.mean() < _LEAST_SEEN:
        return None
    pixel = np.where(seen[:, None], saddles.pixel, start).reshape(rows, columns, 2)
    clear = float(np.median(saddles.score[seen])) - _LESS_CLEAR
    seen = (seen & (saddles.score >= clear)).reshape(rows, columns)
    for _ in range(4):
        while len(seen) > 2 and seen[-1].mean() < _GOES_ON:
            pixel, seen = pixel[:-1], seen[:-1]
        pixel, seen = _grown(grey, pixel, seen, clear)
        # After four quarter turns it is as it was.
        pixel, seen = np.rot90(pixel), np.rot90(seen)
    return _Grid(pixel, seen)


def _grown(
    grey: Grey, pixel: FloatArray, seen: BoolArray, clear: float
) -> tuple[FloatArray, BoolArray]:
    """A grid with all rows that follow its last one in the picture."""
    while len(pixel) < _MOST_ROWS:
        spacing = _Grid(pixel, seen).spacing
        further = 2 * pixel[-1] - pixel[-2]
        if len(pixel) > 2:
            # Perspective makes steps longer or shorter from row to row.
            further += pixel[-1] - 2 * pixel[-2] + pixel[-3]
        saddles, there = refined(grey, further, spacing, reach=_ROW_REACH)
        there &= saddles.score >= clear
        if there.mean() < _GOES_ON:
            break
        row = np.where(there[:, None], saddles.pixel, further)
        pixel, seen = np.vstack([pixel, row[None]]), np.vstack([seen, there[None]])
    return pixel, seen


def _widest(grid: _Grid) -> float:
    return max(float(np.linalg.norm(np.diff(grid.pixel, axis=k), axis=2).max()) for k in (0, 1))
