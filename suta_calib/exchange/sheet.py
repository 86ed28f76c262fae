"""A foreign table whose columns have names: numbers at once, text when somebody asks for it."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import is_missing, no_number
from suta_calib.measurements.csv_table import number_in

# A row's line and its cells, with blanks around them.
RawRow = tuple[int, Sequence[str]]


@dataclass(frozen=True, eq=False)
class Sheet:
    """A table of text, its columns named.

    The text of a million rows would take a gigabyte: numbers are kept, and what else stands in a
    column is read once more where it is wanted.

    Attributes:
        path: the file.
        names: of the columns: those of the header, or ``1``, ``2``, … where there is none.
        lines: (n,) line of each row, n at least one.
        values: of each column its numbers (n,), NaN where one is missing; None where it holds
            something else.
        rows: gives the rows anew.
        headed: whether the names are the file's.
        seen: how it was taken apart, one sentence each.
        ahead: columns of ``rows`` in front of the first.
        comment: cells of the comment above the rows, where it has one for each column and no row
            names them; empty otherwise.
    """

    path: Path
    names: tuple[str, ...]
    lines: Sequence[int]
    values: tuple[FloatArray | None, ...]
    rows: Callable[[], Iterator[RawRow]]
    headed: bool
    remarks: tuple[str, ...]
    ahead: int = 0
    comment: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.lines)

    def refuse(self, found: str, expected: str, hint: str = "") -> ForeignFileError:
        """Error about the table as a whole, at its first row, to be raised by the caller."""
        return ForeignFileError(found, expected, file=self.path, line=self.lines[0], hint=hint)

    def named_by_comment(self) -> Sheet:
        """With the names that the comment above the rows has."""
        remarks = (*self.remarks[:-1], "The comment above the rows names the columns.")
        return replace(self, names=self.comment, headed=True, remarks=remarks)

    def from_column(self, first: int) -> Sheet:
        """Without the columns in front of one, which is counted from 1."""
        left = first - 1
        names, values = self.names[left:], self.values[left:]
        comment = self.comment[left:]
        ahead = self.ahead + left
        return replace(self, names=names, values=values, ahead=ahead, comment=comment)

    def cells(self, column: int) -> list[str]:
        """(n,) cells of a column."""
        return [cells[self.ahead + column].strip() for _, cells in self.rows()]

    def numbers(self, columns: Sequence[int]) -> FloatArray:
        """Numbers (n, columns) in some columns; NaN where a cell is missing."""
        numbers = [self.values[column] for column in columns]
        for column, values in zip(columns, numbers, strict=True):
            where = self.ahead + column
            for line, cells in self.rows() if values is None else ():
                cell = cells[where].strip()
                if not is_missing(cell) and not np.isfinite(number_in(cell)):
                    raise no_number(self.path, line, where, cell)
        return np.stack([values for values in numbers if values is not None], axis=1)


def sheet_of(
    path: Path,
    names: tuple[str, ...],
    rows: Callable[[], Iterator[RawRow]],
    *,
    headed: bool,
    remarks: tuple[str, ...],
) -> Sheet:
    """A sheet of rows that all have as many cells as there are names."""
    lines = array("q")
    parts: list[list[FloatArray] | None] = [[] for _ in names]
    given = rows()
    # Rows whose cells are text at the same time.
    at_once = 10_000
    while chunk := list(islice(given, at_once)):
        lines.extend(line for line, _ in chunk)
        for k, cells in enumerate(zip(*(row for _, row in chunk), strict=True)):
            if (part := parts[k]) is None:
                continue
            numbers = _numbers_in(cells)
            if numbers is None:
                parts[k] = None
            else:
                part.append(numbers)
    values = tuple(None if part is None else np.concatenate(part) for part in parts)
    return Sheet(path, names, lines, values, rows, headed, remarks)


def _numbers_in(cells: Sequence[str]) -> FloatArray | None:
    """Numbers of cells (n,), NaN where one is missing; None where one is neither."""
    together = "".join(cells)
    if together.isascii() and "_" not in together:
        # All of them at once, unless one of them is no number.
        with suppress(ValueError):
            numbers = np.array([*map(float, cells)])
            return None if np.isinf(numbers).any() else numbers
    numbers = np.array([number_in(cell) for cell in cells])
    not_finite = np.flatnonzero(~np.isfinite(numbers))
    return numbers if all(is_missing(cells[row]) for row in not_finite.tolist()) else None
