"""CSV files as columns of text that remember the line of every row, and the poses in them.

Columns of a pose are ``x, y, z`` in m or ``x_mm, y_mm, z_mm``, and ``qx, qy, qz, qw``; a prefix
such as ``a_`` tells several poses in one file apart (``a_x``, ``a_x_mm``, ``a_qx``).
"""

from __future__ import annotations

import csv
import re
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import compress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import (
    EmptyCellError,
    MissingColumnError,
    SamplesError,
    SutaCalibWarning,
    did_you_mean,
)
from suta_calib.geometry.numbers import rotation_from_quaternion
from suta_calib.measurements.files import lines_of, read_text
from suta_calib.measurements.plain_csv import PlainColumns
from suta_calib.units import FARTHEST, SHOWN, Unit, from_mm, stored

_QUATERNION = ("qx", "qy", "qz", "qw")
# Standard deviation of every measured coordinate, and of each.
SIGMA = "sigma"
SIGMAS = ("sigma_x", "sigma_y", "sigma_z")
_DECIMAL = re.compile(r"[+-]?\d+\.\d+", re.ASCII)
# What reads tables as spreadsheets of any country write them.
_IMPORT = "suta-calib import converts such a file"
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


@dataclass(frozen=True)
class CsvTable(Displayable):
    """A CSV file with a header row, its cells still text.

    Attributes:
        path: the file.
        columns: cells by column name, both stripped of surrounding blanks.
        header_line: line number of the header, from 1.
        lines: line number of each row, from 1.
    """

    path: Path
    columns: Mapping[str, tuple[str, ...]]
    header_line: int
    lines: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def origin(self) -> tuple[str, ...]:
        """``file.csv:12`` for each row."""
        name = self.path.name
        return tuple([f"{name}:{line}" for line in self.lines])

    def cells(self, name: str, expected: str = "a column of this name") -> tuple[str, ...]:
        """Cells of one column as text.

        Raises:
            MissingColumnError: no such column; names the columns there are.
        """
        if name in self.columns:
            return self.columns[name]
        raise MissingColumnError(
            f"only the columns {', '.join(self.columns)}",
            expected,
            file=self.path,
            line=self.header_line,
            where=f"column {name!r}",
            hint=did_you_mean(name, self.columns),
        )

    def numbers(self, name: str, expected: str = "a column of this name") -> FloatArray:
        """One column as numbers, (n,).

        Raises:
            SamplesError: no such column, or a cell that is not a finite number.
        """
        if name in self.columns and isinstance(self.columns, PlainColumns):
            numbers = self.columns.numbers(name)
            if numbers is not None and np.isfinite(numbers).all():
                return numbers
        cells = self.cells(name, expected)
        values = _numbers(cells)
        for row in np.flatnonzero(~np.isfinite(values)):
            comma = np.isfinite(number_in(cells[row].replace(",", ".", 1)))
            hint = f"a decimal comma? {_IMPORT}" if comma and "," in cells[row] else ""
            error = SamplesError if cells[row] else EmptyCellError
            raise self.refuse(int(row), name, repr(cells[row]), "a finite number", hint, error)
        return values

    def labels(self, name: str, expected: str = "a column of this name") -> NDArray[np.str_]:
        """One column as labels, (n,), none of them empty.

        Raises:
            SamplesError: no such column, or an empty cell.
        """
        labels = np.array(self.cells(name, expected), dtype=np.str_)
        for row in np.flatnonzero(labels == ""):
            raise self.refuse(int(row), name, "an empty cell", "a label")
        return labels

    def valid(self) -> CsvTable:
        """Only the rows of a recording that say of themselves that they are valid.

        A row is not where its ``valid`` is 0, or where ``errors`` names a joint.
        """
        if not {"valid", "errors"} & {*self.columns}:
            return self
        rows = np.ones(len(self), dtype=bool)
        if "valid" in self.columns:
            rows &= [cell.lower() not in ("0", "false") for cell in self.columns["valid"]]
        if "errors" in self.columns:
            rows &= [not cell for cell in self.columns["errors"]]
        columns = {name: tuple(compress(cells, rows)) for name, cells in self.columns.items()}
        return CsvTable(self.path, columns, self.header_line, tuple(compress(self.lines, rows)))

    def time(self, hint: str) -> FloatArray:
        """The column ``time``, (n,) s.

        Args:
            hint: what to do where it does not increase.

        Raises:
            SamplesError: no such column, a cell that is no number, or time that does not increase.
        """
        time = self.numbers("time", "a column time, in s")
        for row in np.flatnonzero(np.diff(time) <= 0):
            cells = self.columns["time"][row : row + 2]
            problem = f"{cells[1]} after {cells[0]}"
            raise self.refuse(int(row) + 1, "time", problem, "time that increases", hint)
        return time

    def refuse(
        self,
        row: int,
        name: str,
        problem: str,
        expected: str,
        hint: str = "",
        error: type[SamplesError] = SamplesError,
    ) -> SamplesError:
        """Error about one cell, to be raised by the caller."""
        # Characters of a cell that a message shows.
        longest_quote = 200
        short = problem if len(problem) <= longest_quote else f"{problem[:longest_quote]}…"
        return error(
            short,
            expected,
            file=self.path,
            line=self.lines[row],
            where=f"column {name!r}",
            hint=hint,
        )


def read_csv_table(path: str | Path) -> CsvTable:
    """Read comma-separated values; blank lines and lines that start with ``#`` are skipped.

    Raises:
        SamplesError: unreadable, empty, header only, a column name twice, not comma-separated,
            or a row with another number of cells than the header, or a last number of fewer
            decimals or far fewer characters than all others, as if half-written.

    Warns:
        SutaCalibWarning: a last number that may be half-written.
    """
    path = Path(path)
    return csv_table(path, read_text(path, SamplesError))


def csv_table(path: Path, text: str) -> CsvTable:
    """The table of a text; raises and warns as `read_csv_table`."""
    if (plain := PlainColumns.of(text)) is not None:
        return CsvTable(path, plain, 1, tuple(range(2, 2 + plain.rows)))
    rows = _csv_rows(path, text)
    if not rows:
        raise SamplesError("an empty file", "a header row and data", file=path)
    header_line, header = rows.pop(0)
    _check_header(path, header_line, header)
    if not rows:
        hint = "fill it in, or delete it"
        raise SamplesError(
            "a header without data", "at least one row", file=path, line=header_line, hint=hint
        )
    for line, row in rows:
        if len(row) != len(header):
            cut_off = line == rows[-1][0] and len(row) < len(header)
            raise SamplesError(
                f"{len(row)} cells",
                f"{len(header)}, as in the header",
                file=path,
                line=line,
                hint="the file ends in the middle of a row: record it again or delete this row"
                if cut_off
                else "",
            )
    _check_last(path, text, rows)
    cells = zip(*(row for _, row in rows), strict=True)
    columns = {name: column for name, column in zip(header, cells, strict=True) if name}
    return CsvTable(path, columns, header_line, tuple(line for line, _ in rows))


def _check_last(path: Path, text: str, rows: Sequence[tuple[int, list[str]]]) -> None:
    """Look at the last number of a file whose last line alone has no end: a copy may be cut there.

    Many a program leaves that end out, so it alone means nothing.
    """
    # Rows from which on the length of the last one's numbers says something.
    enough_lines = 5
    if text.endswith(("\n", "\r")) or len(rows) < enough_lines:
        return
    line, last = rows[-1][0], rows[-1][1][-1]
    cells_before = [row[-1] for _, row in rows[:-1]]
    decimals = {len(cell.partition(".")[2]) for cell in cells_before if _DECIMAL.fullmatch(cell)}
    if not _NUMBER.fullmatch(last) or not all(map(_NUMBER.fullmatch, cells_before)):
        return
    where = f"{path}:{line}"
    problem = f"{last!r} at the end of the file, without a line break"
    hint = "if nothing is missing, add a line break"
    fixed = len(decimals) == 1 and all(map(_DECIMAL.fullmatch, cells_before))
    if fixed and len(last.partition(".")[2]) < min(decimals):
        expected = f"{min(decimals)} decimals, as in all other rows"
        raise SamplesError(problem, expected, file=path, line=line, hint=f"cut off? {hint}")
    shortest = min(map(len, cells_before))
    # Programs that leave out zeros at the end leave out three of them once in a thousand numbers,
    # and never all behind a point.
    cut = len(last) < shortest - 2 or last.endswith(".")
    if cut and all(map(_DECIMAL.fullmatch, cells_before)):
        expected = f"{shortest} characters or more, as in all other rows"
        raise SamplesError(problem, expected, file=path, line=line, hint=f"cut off? {hint}")
    if len(last) < shortest:
        warnings.warn(
            f"{where}: found {problem}; all other rows have a longer number, so the file may be "
            f"incomplete; {hint}",
            SutaCalibWarning,
            stacklevel=4,
        )


def _numbers(cells: Sequence[str]) -> FloatArray:
    """`number_in` of every cell, (n,)."""
    together = "".join(cells)
    if together.isascii() and "_" not in together:
        # All of them at once, unless one of them is no number.
        with suppress(ValueError):
            return np.array([*map(float, cells)])
    return np.array([number_in(cell) for cell in cells])


def number_in(cell: str) -> float:
    """The number in a cell, NaN where there is none: no ``1_000``, no digits of other scripts."""
    try:
        return float(cell if cell.isascii() and "_" not in cell else "nan")
    except ValueError:
        return float("nan")


def _csv_rows(path: Path, text: str) -> list[tuple[int, list[str]]]:
    """Line number and stripped cells of every line that holds data.

    Each line is parsed on its own: a forgotten quote then costs one line, not the rest of the file.
    """
    rows = []
    contents = (line.rstrip("\r\n") for line in lines_of(text))
    for line, content in enumerate(contents, 1):
        if not content.strip() or content.lstrip().startswith("#"):
            continue
        try:
            cells = next(csv.reader([content], strict=True, skipinitialspace=True))
        except csv.Error as problem:
            raise SamplesError(
                f"a line that is not CSV ({problem})", file=path, line=line
            ) from None
        rows.append((line, [cell.strip() for cell in cells]))
    return rows


def _check_header(path: Path, line: int, header: list[str]) -> None:
    if len(header) == 1 and any(separator in header[0] for separator in ";\t"):
        raise SamplesError(
            f"the header {header[0]!r}",
            "columns separated by commas",
            file=path,
            line=line,
            hint=_IMPORT,
        )
    for name, times in Counter(header).items():
        if name and times > 1:
            raise SamplesError(
                f"the column {name!r} more than once", "each column only once", file=path, line=line
            )


# ── positions and orientations ───────────────────────────────────────────────────────────────
def position_columns(prefix: str = "") -> tuple[str, ...]:
    """Names of every column that `positions` may read."""
    return tuple(f"{prefix}{axis}{unit}" for unit in ("", "_mm") for axis in "xyz")


def rotation_columns(prefix: str = "") -> tuple[str, ...]:
    """Names of every column that `rotations` reads."""
    return tuple(prefix + name for name in _QUATERNION)


def positions(table: CsvTable, prefix: str = "") -> FloatArray:
    """Positions, (n, 3) in m.

    Raises:
        SamplesError: a column is missing or not finite, there are both metres and millimetres, or
            a position is no place.
    """
    names = position_columns(prefix)
    metres, millimetres = names[:3], names[3:]
    in_mm = any(name in table.columns for name in millimetres)
    if in_mm and any(name in table.columns for name in metres):
        raise SamplesError(
            f"columns {', '.join(name for name in names if name in table.columns)}",
            f"either {', '.join(metres)} (m) or {', '.join(millimetres)}",
            file=table.path,
            line=table.header_line,
        )
    expected = f"columns {', '.join(metres)} in m, or {', '.join(millimetres)}"
    chosen = millimetres if in_mm else metres
    read = np.stack([table.numbers(name, expected) for name in chosen], axis=-1)
    position = from_mm(read) if in_mm else read
    for row, axis in np.argwhere(np.abs(position) > FARTHEST):
        cell = repr(table.columns[chosen[axis]][row])
        expected = f"a position within {FARTHEST:g} m"
        hint = (
            "if these are coordinates of a grid, subtract an origin with suta-calib import "
            "--origin first"
        )
        raise table.refuse(int(row), chosen[axis], cell, expected, hint)
    return position


def position_sigma_columns() -> tuple[str, ...]:
    """Names of the columns that `position_sigmas` may read."""
    return tuple(column for name in (SIGMA, *SIGMAS) for column in _sigma(name).names)


def position_sigmas(table: CsvTable) -> FloatArray:
    """Standard deviations of measured coordinates, (n, 3) in m, all of them positive.

    From ``sigma_x, sigma_y, sigma_z``, or else from ``sigma``, the same for each coordinate; in m,
    or in mm with ``_mm`` after their names.
    """
    by_axis = any(column in table.columns for name in SIGMAS for column in _sigma(name).names)
    names = SIGMAS if by_axis else (SIGMA,) * 3
    return np.stack([numbers(table, _sigma(name)) for name in names], axis=1)


@dataclass(frozen=True)
class NumberColumn:
    """A column with one measured number for each row: a length, an angle, or a plain number.

    Attributes:
        name: of the column that holds it in its SI unit. The same with the suffix of `SHOWN`, such
            as ``length_mm`` or ``roll_deg``, holds it as people read it.
        unit: m, rad, …; 1 for a plain number.
        required: whether it must be there; otherwise all files of a term have it, or none.
        positive: whether it must be greater than zero.
        noise_unit: unit of the noise that it scatters by: its own, but for a component of a
            direction, which scatters as an angle.
        offered: whether the files of a new job have it.
    """

    name: str
    unit: Unit = "1"
    required: bool = True
    positive: bool = False
    noise_unit: Unit | None = None
    offered: bool = True

    @property
    def scatters_in(self) -> Unit:
        """`noise_unit`, or its own unit."""
        return self.noise_unit or self.unit

    @property
    def names(self) -> tuple[str, ...]:
        """The names that the column may have, that of the SI unit first."""
        suffix = SHOWN[self.unit].suffix
        return (self.name, f"{self.name}{suffix}") if suffix else (self.name,)


def _sigma(name: str) -> NumberColumn:
    return NumberColumn(name, "m", positive=True)


def numbers(table: CsvTable, column: NumberColumn) -> FloatArray:
    """Measured numbers, (n,) in SI."""
    there = [name for name in column.names if name in table.columns]
    if len(there) > 1:
        raise SamplesError(
            f"columns {' and '.join(there)}",
            f"either {there[0]} ({column.unit}) or {there[1]}",
            file=table.path,
            line=table.header_line,
        )
    chosen = there[0] if there else column.name
    unit = "" if column.unit == "1" else f" in {column.unit}"
    read = table.numbers(chosen, f"column {f'{unit}, or '.join(column.names)}")
    what = "length" if column.unit == "m" else "number"
    for row in np.flatnonzero(read <= 0.0) if column.positive else ():
        raise table.refuse(int(row), chosen, f"{read[row]:g}", f"a {what} greater than 0")
    return read if chosen == column.name else stored(read, column.unit)


def has_rotations(table: CsvTable, prefix: str = "") -> bool:
    """Whether any of the quaternion's columns is there."""
    return any(name in table.columns for name in rotation_columns(prefix))


def rotations(table: CsvTable, prefix: str = "") -> FloatArray:
    """Rotation matrices, (n, 3, 3), of the quaternions ``qx, qy, qz, qw``.

    Warns:
        SutaCalibWarning: a quaternion's length is more than 1 % away from one; it is normalised.

    Raises:
        SamplesError: a column is missing or not finite, or a quaternion is zero.
    """
    names = rotation_columns(prefix)
    expected = f"the orientation as a quaternion {', '.join(names)}"
    quaternion = np.stack([table.numbers(name, expected) for name in names], axis=-1)
    with np.errstate(over="ignore"):
        length = np.linalg.norm(quaternion, axis=-1)
    zero_norm = 1e-3
    for row in np.flatnonzero((length < zero_norm) | ~np.isfinite(length)):
        problem = f"a quaternion of length {length[row]:.3g}"
        raise table.refuse(int(row), names[0], problem, "a quaternion of length 1")
    unit_norm_tolerance = 0.01
    unnormalised = np.flatnonzero(np.abs(length - 1) > unit_norm_tolerance)
    if unnormalised.size:
        warnings.warn(
            f"{table.path}:{table.lines[unnormalised[0]]}: found a quaternion of length "
            f"{length[unnormalised[0]]:.3f} ({unnormalised.size} such rows); expected length 1; "
            "they were normalised",
            SutaCalibWarning,
            stacklevel=3,
        )
    return rotation_from_quaternion(quaternion / length[:, None])
