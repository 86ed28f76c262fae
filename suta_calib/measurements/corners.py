"""Corners of a board found in pictures: ``corners.csv``, columns image, point, u, v."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.errors import InputError, SamplesError
from suta_calib.measurements.board import Board
from suta_calib.measurements.camera import Camera
from suta_calib.measurements.csv_table import CsvTable, read_csv_table
from suta_calib.measurements.files import write_text

_COLUMNS: Final = ("image", "point", "u", "v")


@dataclass(frozen=True, eq=False)
class Corners(Displayable):
    """Which point of a board was seen where, in which picture. Immutable.

    Attributes:
        image: (n,) the picture's name.
        point: (n,) the board's number of the point.
        pixel: (n, 2) u to the right and v down, px; the centre of the first pixel is 0, 0.
        path: the file it was read from, or None.
        lines: (n,) line of every row in it, from 1; empty without a file.
    """

    image: NDArray[np.str_]
    point: IntArray
    pixel: FloatArray
    path: Path | None = None
    lines: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.image)

    @property
    def images(self) -> list[str]:
        """Names of the pictures, by first appearance."""
        return list(dict.fromkeys(self.image.tolist()))

    @property
    def digest(self) -> str:
        """SHA-256 of the rows as their file has them, in whichever order."""
        return sha256("\n".join(sorted(corners_text(self).splitlines())).encode()).hexdigest()

    def table(self, numbers: Iterable[int]) -> FloatArray:
        """(pictures, points, 2) px, in the order of `images` and the numbers; NaN if not found."""
        columns = {number: k for k, number in enumerate(numbers)}
        pictures = {name: k for k, name in enumerate(self.images)}
        table = np.full((len(pictures), len(columns), 2), np.nan)
        at = [pictures[name] for name in self.image.tolist()]
        table[at, [columns[number] for number in self.point.tolist()]] = self.pixel
        return table

    def take(self, rows: BoolArray | IntArray) -> Corners:
        """Some of the rows, by number or by boolean mask."""
        index = np.arange(len(self))[rows]
        lines = tuple(self.lines[k] for k in index) if self.lines else ()
        return Corners(self.image[index], self.point[index], self.pixel[index], self.path, lines)

    def refuse(self, row: int, problem: str, expected: str, hint: str = "") -> SamplesError:
        """Error about one row, to be raised by the caller."""
        line = self.lines[row] if self.lines else None
        where = f"image {self.image[row]}, point {self.point[row]}"
        return SamplesError(problem, expected, file=self.path, line=line, where=where, hint=hint)

    def check(self, board: Board, camera: Camera | None = None) -> None:
        """Refuse points that the board does not have, and pixels outside the camera's picture.

        Raises:
            SamplesError: the first such row, with its line.
        """
        for row in np.flatnonzero(~np.isin(self.point, list(board.points)))[:1]:
            expected = f"{board.numbering} ({board.type})"
            hint = "check whether corners and board belong together"
            raise self.refuse(int(row), f"point {self.point[row]}", expected, hint)
        if camera is None:
            return
        for row in np.flatnonzero(~camera.inside(self.pixel))[:1]:
            u, v = self.pixel[row]
            raise self.refuse(
                int(row),
                f"a corner at {u:.1f}, {v:.1f} px",
                f"a corner in the picture, which is {camera.width} x {camera.height} px",
                self._why_outside(camera),
            )

    def _why_outside(self, camera: Camera) -> str:
        """What to do about corners outside the camera's picture."""
        if camera.inside(self.pixel[:, ::-1]).all():
            return (
                "if u and v were exchanged, all corners would be in the picture: u is the column, "
                "v the row"
            )
        for first, which in ((0.5, "from the corner of the first pixel"), (1.0, "from 1")):
            if camera.inside(self.pixel - first).all():
                return (
                    f"pixels seem to be counted {which}, where the centre of the first one is 0, "
                    f"0: subtract {first:g} from u and v"
                )
        if self.pixel.min() < -0.5:
            return "u and v count from the first pixel, whose centre is 0, 0"
        width, height = np.ceil(self.pixel.max(axis=0)).astype(int) + 1
        return (
            f"the corners reach {width} x {height} px, so the pictures are larger than the "
            "camera's file states: calibrate the camera with these pictures (suta-calib detect "
            "--camera-out)"
        )


def read_corners(path: str | Path) -> Corners:
    """Read ``corners.csv``; other columns are ignored.

    Raises:
        SamplesError: as `read_corners_by_sight`; a point twice in one picture, whichever eye or
            board it is of.
    """
    return _checked(read_csv_table(Path(path)), ())


def read_corners_by_sight(path: str | Path) -> dict[tuple[str, str], Corners]:
    """Read ``corners.csv`` with columns ``eye`` and ``target``, by these; empty without a column.

    Raises:
        SamplesError: unreadable, a column missing, a value that is none, a point's number that is
            not whole, or a point of one board twice in one picture of an eye.
    """
    table = read_csv_table(Path(path))
    roles = [role for role in ("eye", "target") if role in table.columns]
    corners = _checked(table, roles)
    none = np.full(len(corners), "", dtype=np.str_)
    eye, target = (table.labels(r) if r in roles else none for r in ("eye", "target"))
    keys = dict.fromkeys(zip(eye.tolist(), target.tolist(), strict=True))
    return {key: corners.take((eye == key[0]) & (target == key[1])) for key in keys}


def _checked(table: CsvTable, roles: Sequence[str]) -> Corners:
    """All rows, of which no two have the same picture, point and labels of these columns."""
    image = table.labels("image", "a column with the picture's name")
    point = table.numbers("point", "a column with the board's number of the corner")
    # Pixels; a corner farther off than any sensor is wide is none.
    largest = 1e6
    for row in np.flatnonzero((point != np.round(point)) | (point < 0) | (point > largest))[:1]:
        cell = repr(table.columns["point"][row])
        raise table.refuse(int(row), "point", cell, "a corner's number: whole, from 0")
    pixel = np.column_stack([table.numbers(name, f"a column {name}, px") for name in "uv"])
    for row, axis in np.argwhere(np.abs(pixel) > largest)[:1]:
        cell = repr(table.columns["uv"[axis]][row])
        raise table.refuse(int(row), "uv"[axis], cell, f"pixels, within {largest:g}")
    corners = Corners(image, point.astype(np.intp), pixel, table.path, table.lines)
    first: dict[tuple[object, ...], int] = {}
    labels = [table.columns[role] for role in roles]
    for row, key in enumerate(zip(image.tolist(), corners.point.tolist(), *labels, strict=True)):
        if key in first:
            raise corners.refuse(
                row,
                f"the same point as in line {table.lines[first[key]]}",
                "each point only once per picture",
                "if there are two boards in one picture, or two pictures with one name, give "
                "each its own name, or columns eye and target",
            )
        first[key] = row
    return corners


def corners_text(corners: Corners) -> str:
    """Content of ``corners.csv``; pixels to a ten-thousandth, far below what is found."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for image, point, (u, v) in zip(corners.image, corners.point, corners.pixel, strict=True):
        writer.writerow([image, point, f"{u:.4f}", f"{v:.4f}"])
    return text.getvalue()


def write_corners(path: Path, corners: Corners) -> None:
    """Write ``corners.csv``: `corners_text`.

    Raises:
        OutputError: the file cannot be written; what was there is untouched.
    """
    write_text(path, corners_text(corners))


def corners_of(image: ArrayLike, point: ArrayLike, pixel: ArrayLike) -> Corners:
    """Corners from arrays: (n,) names, (n,) numbers, (n, 2) px.

    Raises:
        InputError: shapes that do not fit one another.
    """
    names, numbers = np.asarray(image, dtype=np.str_), np.asarray(point, dtype=np.intp)
    pixels = np.asarray(pixel, dtype=float)
    if not (names.shape == numbers.shape == pixels.shape[:1] and pixels.shape[1:] == (2,)):
        raise InputError(
            f"shapes {names.shape}, {numbers.shape}, {pixels.shape}", "(n,), (n,), (n, 2)"
        )
    return Corners(names, numbers, pixels)
