"""Delimited text and spreadsheets: separator, decimal sign and header, seen or asked for."""

from __future__ import annotations

import re
import zipfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import (
    MOST_BYTES,
    Row,
    is_missing,
    read_bounded,
    read_foreign_text,
    rows_of_text,
)
from suta_calib.exchange.option import Given, Option
from suta_calib.extras import load
from suta_calib.measurements.csv_table import number_in
from suta_calib.words import listed

_SEPARATORS: Final = {
    "tab": "\t",
    "semicolon": ";",
    "comma": ",",
    "bar": "|",
    "blank": " ",
}
_DECIMALS: Final = {"point": ".", "comma": ","}
SEPARATOR: Final = Option("separator", "Between cells.", choices=tuple(_SEPARATORS))
DECIMAL: Final = Option("decimal", "Decimal sign.", choices=tuple(_DECIMALS))
HEADER: Final = Option("header", "Whether the first row names the columns.", choices=("yes", "no"))
SKIP: Final = Option("skip", "Lines before the table that are no part of it.", "N")
SHEET: Final = Option("sheet", "Sheet of a spreadsheet, by name.", "NAME")
DELIMITED_OPTIONS: Final = (SEPARATOR, DECIMAL, HEADER, SKIP, SHEET)
SPREADSHEETS: Final = (".xlsx", ".xlsm")
_DECIMAL_COMMA: Final = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?", re.ASCII)
# Rows that tell how a file is laid out.
_ENOUGH: Final = 200
_MOST_ROWS: Final = 2_000_000


@dataclass(frozen=True, eq=False)
class Sheet:
    """A table of text, its columns named.

    Attributes:
        path: the file.
        names: of the columns: those of the header, or ``1``, ``2``, … where there is none.
        rows: the data, at least one row, each with as many cells as there are names.
        headed: whether the names are the file's.
        seen: how it was taken apart, one sentence each.
    """

    path: Path
    names: tuple[str, ...]
    rows: tuple[Row, ...]
    headed: bool
    seen: tuple[str, ...]

    @property
    def lines(self) -> tuple[int, ...]:
        """(n,) line of each row."""
        return tuple(row.line for row in self.rows)

    def from_column(self, first: int) -> Sheet:
        """Without the columns in front of one, which is counted from 1."""
        rows = tuple(replace(row, cells=row.cells[first - 1 :]) for row in self.rows)
        return replace(self, names=self.names[first - 1 :], rows=rows)

    def cells(self, column: int) -> list[str]:
        """(n,) cells of a column."""
        return [row.cells[column] for row in self.rows]


def read_sheet(path: Path, given: Given) -> Sheet:
    """Read delimited text or a spreadsheet.

    Args:
        path: the file; ``.xlsx`` is a spreadsheet.
        given: `DELIMITED_OPTIONS`.

    Raises:
        ForeignFileError: unreadable, no table, a row of another length, or a file that may be
            taken apart in several ways that give different numbers.
        MissingExtraError: a spreadsheet, without the package that reads them.
    """
    if path.suffix.lower() in SPREADSHEETS:
        rows = _spreadsheet(path, given.text(SHEET))
        seen: tuple[str, ...] = ()
    else:
        text = read_foreign_text(path)
        separator, decimal = _signs(path, text, given)
        rows = _split(path, text, separator, decimal, _skipped(given))
        seen = (f"Cells between {separator}s, decimal {decimal}.",)
    rows = [row for row in rows if any(row.cells)]
    if not rows:
        raise ForeignFileError("no row with anything in it", "a table", file=path)
    headed = {"yes": True, "no": False}.get(given.text(HEADER)) if HEADER in given else None
    if headed is None:
        headed = _is_header(rows)
    names = rows[0].cells if headed else tuple(str(k + 1) for k in range(len(rows[0].cells)))
    data = rows[1:] if headed else rows
    if not data:
        raise ForeignFileError("a header and no data", "at least one row", file=path)
    width = len(names)
    for k, row in enumerate(data):
        # Many programs end every line with a separator, some only those of the data.
        cells = row.cells
        while len(cells) > width and not cells[-1]:
            cells = cells[:-1]
        if len(cells) != width:
            raise ForeignFileError(
                f"{len(cells)} {'cell' if len(cells) == 1 else 'cells'}",
                f"{width}, as in {'the header' if headed else 'the first row'}",
                file=path,
                line=row.line,
                hint=_why_uneven(len(cells), width, last=row is data[-1]),
            )
        data[k] = Row(row.line, cells)
    _check_names(path, rows[0].line, names)
    said = "The first row names the columns." if headed else "No row names the columns."
    return Sheet(path, names, tuple(data), headed, (*seen, said))


def _why_uneven(cells: int, width: int, *, last: bool) -> str:
    """What to do about a row with more or fewer cells than the first one."""
    if cells == 2 * width:
        return "decimal commas between commas? write the table again with semicolons between cells"
    if last and cells < width:
        return "was the file cut off while it was written? remove its last line, or write it again"
    return (
        "say how many lines are no part of the table with --skip N, or what is between cells with "
        "--separator"
    )


def _skipped(given: Given) -> int:
    text = given.text(SKIP, "0")
    if not (text.isascii() and text.isdigit()):
        raise given.refuse(SKIP, repr(text), "a number of lines")
    return int(text)


def _split(path: Path, text: str, separator: str, decimal: str, skip: int) -> list[Row]:
    rows = [row for row in rows_of_text(path, text, _SEPARATORS[separator]) if row.line > skip]
    if decimal == "comma":
        rows = [replace(row, cells=tuple(map(_with_point, row.cells))) for row in rows]
    return rows


def _with_point(cell: str) -> str:
    return cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell


def _signs(path: Path, text: str, given: Given) -> tuple[str, str]:
    """Separator and decimal sign: the only ones that make the most of the file's cells numbers."""
    lines = text[: 400 * _ENOUGH].splitlines(keepends=True)
    whole = lines[:-1] if len(lines) > 1 and len(text) > 400 * _ENOUGH else lines
    head, skip = "".join(whole[: _ENOUGH + _skipped(given)]), _skipped(given)
    separators = [given.text(SEPARATOR)] if SEPARATOR in given else list(_SEPARATORS)
    decimals = [given.text(DECIMAL)] if DECIMAL in given else list(_DECIMALS)
    ranked: list[tuple[tuple[float, float], tuple[str, str], list[tuple[float, ...]]]] = []
    for separator in separators:
        for decimal in decimals:
            try:
                rows = _split(path, head, separator, decimal, skip)
            except ForeignFileError:
                continue
            if not rows:
                continue
            numbers = [tuple(map(number_in, row.cells)) for row in rows[1:] or rows]
            flat = [n == n for row in numbers for n in row]
            usual = Counter(map(len, numbers)).most_common(1)[0]
            regular = usual[1] / len(numbers)
            if usual[0] >= 2 or len(separators) == 1:
                share = sum(flat) / max(len(flat), 1)
                ranked.append(((round(regular, 2), round(share, 3)), (separator, decimal), numbers))
    if not ranked:
        raise ForeignFileError(
            "no rows of cells",
            f"a table with {listed(list(_SEPARATORS))} between its cells",
            file=path,
            hint="say what is between cells with --separator",
        )
    best = max(ranked, key=lambda each: (each[0][1], each[0][0]))
    rivals = [
        signs
        for rank, signs, numbers in ranked
        if rank == best[0] and repr(numbers) != repr(best[2]) and best[0][1] > 0
    ]
    if rivals:
        ways = " or ".join(f"--separator {s} --decimal {d}" for s, d in [best[1], *rivals])
        said = "cells that may be taken apart in several ways"
        raise ForeignFileError(said, "one way", file=path, hint=f"say {ways}")
    return best[1]


def _is_header(rows: Sequence[Row]) -> bool:
    """Whether the first row holds text where the next one holds numbers."""
    first, following = rows[0], rows[1:2]
    text = [cell != "" and number_in(cell) != number_in(cell) for cell in first.cells]
    if not following:
        return all(text)
    return any(
        of_text
        and not is_missing(cell)
        and (is_missing(below) or number_in(below) == number_in(below))
        for of_text, cell, below in zip(text, first.cells, following[0].cells, strict=False)
    )


def _check_names(path: Path, line: int, names: Sequence[str]) -> None:
    for name in names:
        if name and names.count(name) > 1:
            raise ForeignFileError(
                f"the column {name!r} more than once",
                "each column once",
                file=path,
                line=line,
                hint="an instrument's own file? suta-calib import --list names those with bodies",
            )


def _spreadsheet(path: Path, sheet: str) -> list[Row]:
    """Rows of one sheet, formulas as the values that were last computed."""
    openpyxl = load("openpyxl", "formats")
    read_bounded(path)
    try:
        with zipfile.ZipFile(path) as archive:
            # Its few bytes may unpack to as many as one likes.
            if sum(entry.file_size for entry in archive.infolist()) > 4 * MOST_BYTES:
                raise ForeignFileError(
                    f"a spreadsheet of more than {4 * MOST_BYTES / 1e6:.0f} MB unpacked",
                    "a table of a few hundred thousand rows",
                    file=path,
                )
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
    except ForeignFileError:
        raise
    except Exception as problem:  # noqa: BLE001 (its readers raise whatever they meet)
        said = f"a file that is no spreadsheet ({type(problem).__name__})"
        raise ForeignFileError(said, "an .xlsx file", file=path) from None
    try:
        if not sheet and len(book.sheetnames) > 1:
            raise ForeignFileError(
                f"{len(book.sheetnames)} sheets: {listed(book.sheetnames)}",
                "one, or the name of one",
                file=path,
                hint="say which with --sheet NAME",
            )
        name = sheet or book.sheetnames[0]
        if name not in book.sheetnames:
            said = f"no sheet {name!r}"
            raise ForeignFileError(said, f"one of {listed(book.sheetnames)}", file=path)
        rows = []
        for number, values in enumerate(book[name].iter_rows(values_only=True), 1):
            if number > _MOST_ROWS:
                raise ForeignFileError(f"more than {_MOST_ROWS} rows", "fewer", file=path)
            cells = tuple("" if value is None else str(value).strip() for value in values)
            if any(cells):
                rows.append(Row(number, cells))
        return rows
    except ForeignFileError:
        raise
    except Exception as problem:  # noqa: BLE001 (as above: sheets are read when they are asked for)
        said = f"a damaged spreadsheet ({type(problem).__name__})"
        raise ForeignFileError(said, "an .xlsx file", file=path) from None
    finally:
        book.close()
