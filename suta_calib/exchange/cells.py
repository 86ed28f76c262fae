"""Text of other programs: bounded, in whatever encoding they use, as rows of cells."""

from __future__ import annotations

import csv
import errno
import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.atomic import note_input
from suta_calib.errors import ForeignFileError
from suta_calib.inputs import read_input
from suta_calib.measurements.csv_table import number_in
from suta_calib.measurements.files import lines_of
from suta_calib.units import from_mm

# Half a million rows of two bodies; what is larger does not fit a table that people look at, and a
# device or a pipe never ends.
MOST_BYTES: Final = 64_000_000
# What programs write where they measured nothing, in small letters.
MISSING: Final = frozenset(
    {"", "-", "--", "missing", "nan", "na", "n/a", "#n/a", "null", "none", "no data", "disabled"}
)

# m per unit, by what instruments call it.
LENGTH_UNITS: Final[dict[str, float]] = {
    **dict.fromkeys(("m", "meters", "metres", "meter", "metre"), 1.0),
    **dict.fromkeys(("cm", "centimeters", "centimetres"), from_mm(10.0)),
    **dict.fromkeys(("mm", "millimeters", "millimetres"), from_mm(1.0)),
}

# No where that cannot be told: methods of a path raise on names that are too long.
is_folder, is_plain_file = os.path.isdir, os.path.isfile


@dataclass(frozen=True)
class TableRow:
    """One row of a foreign table: its line (of a spreadsheet its row), and stripped cells."""

    line: int
    cells: tuple[str, ...]

    def without(self, start: int, stop: int) -> TableRow:
        """The row with nothing in some of its cells."""
        blank = ("",) * len(self.cells[start:stop])
        return TableRow(self.line, (*self.cells[:start], *blank, *self.cells[stop:]))


def read_bounded(path: Path) -> bytes:
    """Every byte of a file that is not too large.

    Raises:
        ForeignFileError: missing, a folder, unreadable, empty, or larger than `MOST_BYTES`.
    """
    if is_folder(path):
        raise ForeignFileError("a folder", "a file", file=path)
    try:
        note_input(path)
        data = read_input(path, MOST_BYTES)
    except FileNotFoundError:
        raise ForeignFileError("no such file", "a file that exists", file=path) from None
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or str(problem)
        if getattr(problem, "errno", None) == errno.EFBIG:
            expected = "a recording with at most a few hundred thousand rows"
            hint = "cut it, or record less often: averages over rests contain as much information"
            raise ForeignFileError(reason, expected, file=path, hint=hint) from None
        description = f"an unreadable file ({reason})"
        raise ForeignFileError(description, "a readable file", file=path) from None
    if not data.strip(b"\0 \t\r\n"):
        raise ForeignFileError("an empty file", "data", file=path)
    return data


def read_foreign_text(path: Path) -> str:
    """The text of a file: UTF-8 or UTF-16 with its mark, or else Western European.

    Raises:
        ForeignFileError: as `read_bounded`, or bytes that are no text.
    """
    data = read_bounded(path)
    utf_16 = data.startswith((b"\xff\xfe", b"\xfe\xff"))
    if b"\0" in data and not utf_16:
        line = data[: data.index(b"\0")].count(b"\n") + 1
        raise ForeignFileError("bytes that are not text", "a text file", file=path, line=line)
    try:
        return data.decode("utf-16" if utf_16 else "utf-8-sig")
    except UnicodeDecodeError:
        if utf_16:
            raise ForeignFileError("damaged UTF-16", "a text file", file=path) from None
        # The degree signs and names in files of instruments; every byte is some character.
        return data.decode("latin-1")


def read_json(path: Path) -> dict[str, Any]:
    """The JSON object in a file, which is not empty; every problem raises the same error."""
    try:
        data = json.loads(read_foreign_text(path))
    except json.JSONDecodeError as problem:
        reason = f"text that is not JSON ({problem.msg})"
        raise ForeignFileError(reason, "a JSON object", file=path, line=problem.lineno) from None
    except (RecursionError, ValueError) as problem:
        reason = f"JSON that cannot be read ({type(problem).__name__})"
        raise ForeignFileError(reason, "a JSON object", file=path) from None
    if not isinstance(data, dict) or not data:
        description = "an empty JSON object" if data == {} else f"a JSON {type(data).__name__}"
        raise ForeignFileError(description, "a JSON object with content", file=path)
    return data


def split_lines(path: Path, text: str, separator: str) -> Iterator[tuple[int, list[str]]]:
    """Line and cells of every line that holds anything but a comment (``#`` or ``%``).

    A blank as the separator stands for any number of blanks and tabs.
    """
    for number, line in enumerate(lines_of(text), 1):
        content = line.rstrip("\r\n")
        begin = content.lstrip()[:1]
        if not begin or begin in "#%":
            continue
        if separator == " ":
            yield number, content.split()
        elif '"' not in content:
            # What the parser would do, in a tenth of its time.
            yield number, content.split(separator)
        else:
            try:
                yield number, next(csv.reader([content], delimiter=separator, strict=True))
            except csv.Error as problem:
                description = f"a line that cannot be split into cells ({problem})"
                raise ForeignFileError(description, file=path, line=number) from None


def rows_of_text(path: Path, text: str, separator: str) -> list[TableRow]:
    """Rows of `split_lines`, their cells stripped; raises as that does."""
    return [
        TableRow(number, tuple(cell.strip() for cell in cells))
        for number, cells in split_lines(path, text, separator)
    ]


def is_missing(cell: str) -> bool:
    """Whether a cell says that nothing was measured."""
    return cell.strip().lower() in MISSING


def numbers_of(path: Path, rows: Sequence[TableRow], columns: Sequence[int]) -> FloatArray:
    """Numbers (rows, columns) in some columns; NaN where a cell is missing."""
    numbers = np.full((len(rows), len(columns)), np.nan)
    for k, row in enumerate(rows):
        for j, column in enumerate(columns):
            cell = row.cells[column] if column < len(row.cells) else ""
            if is_missing(cell):
                continue
            numbers[k, j] = number_in(cell)
            if not np.isfinite(numbers[k, j]):
                raise no_number(path, row.line, column, cell)
    return numbers


def no_number(path: Path, line: int, column: int, cell: str) -> ForeignFileError:
    """Error about a cell that is no number, to be raised by the caller; columns count from 0."""
    longest = 40
    shown = repr(cell if len(cell) <= longest else cell[:longest] + "…")
    where = f"column {column + 1}"
    return ForeignFileError(shown, "a finite number", file=path, line=line, where=where)
