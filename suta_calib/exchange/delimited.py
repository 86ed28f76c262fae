"""Delimited text and spreadsheets: separator, decimal sign and header, seen or asked for."""

from __future__ import annotations

import re
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from functools import partial
from itertools import islice, product
from pathlib import Path
from typing import Any, Final

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import (
    MOST_BYTES,
    is_missing,
    read_bounded,
    read_foreign_text,
    split_lines,
)
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.sheet import RawRow, Sheet, sheet_of
from suta_calib.exchange.truncated import COMPLETE, check_end_of_rows
from suta_calib.measurements.csv_table import number_in
from suta_calib.measurements.files import lines_of
from suta_calib.optional_packages import load
from suta_calib.words import listed

_SEPARATORS: Final = {"tab": "\t", "semicolon": ";", "comma": ",", "bar": "|", "blank": " "}
_DECIMALS: Final = {"point": ".", "comma": ","}
SEPARATOR: Final = Option("separator", "Separator between cells.", choices=tuple(_SEPARATORS))
DECIMAL: Final = Option("decimal", "Decimal sign.", choices=tuple(_DECIMALS))
HEADER: Final = Option("header", "Whether the first row names the columns.", choices=("yes", "no"))
SKIP: Final = Option("skip", "Number of lines before the table that do not belong to it.", "N")
SHEET: Final = Option("sheet", "Name of the sheet in a spreadsheet.", "NAME")
DELIMITED_OPTIONS: Final = (SEPARATOR, DECIMAL, HEADER, SKIP, SHEET, COMPLETE)
SPREADSHEETS: Final = (".xlsx", ".xlsm")
_DECIMAL_COMMA: Final = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?", re.ASCII)
# Of a table; what has more is a matrix, or its rows are its columns.
_MOST_COLUMNS: Final = 10_000


def read_sheet(path: Path, given: Given) -> Sheet:
    """Read delimited text, or a spreadsheet, which ``.xlsx`` is."""
    text, separator, remarks = "", "", tuple[str, ...]()
    everything: Callable[[], Iterator[RawRow]]
    if path.suffix.lower() in SPREADSHEETS:
        everything = _spreadsheet(path, given.text(SHEET)).__iter__
    else:
        text = read_foreign_text(path)
        name, decimal = _signs(path, text, given)
        separator = _SEPARATORS[name]
        check_end_of_rows(path, text, separator, given)
        remarks = (f"Cells separated by {name}s, decimal {decimal}.",)
        everything = partial(_split, path, text, name, decimal, _skipped(given))
    head = [(line, tuple(cell.strip() for cell in row)) for line, row in islice(everything(), 2)]
    if not head:
        raise ForeignFileError("only empty rows", "a table", file=path)
    headed = _is_header([row for _, row in head])
    if HEADER in given:
        headed = given.text(HEADER) == "yes"
    line, first = head[0]
    if len(first) > _MOST_COLUMNS:
        raise _too_wide(path, line, len(first))
    names = first if headed else tuple(str(k + 1) for k in range(len(first)))
    if headed and len(head) == 1:
        raise ForeignFileError("a header without data", "at least one row", file=path)

    def data() -> Iterator[RawRow]:
        return _even(path, len(names), islice(everything(), int(headed), None), headed=headed)

    remarks += ("The first row names the columns." if headed else "No row with column names.",)
    for column, times in Counter(names).items():
        if column and times > 1:
            hint = (
                "if this is an instrument's own file, suta-calib import --list shows the "
                "formats with bodies"
            )
            problem = f"the column {column!r} more than once"
            raise ForeignFileError(
                problem, "each column only once", file=path, line=line, hint=hint
            )
    sheet = sheet_of(path, names, data, headed=headed, remarks=remarks)
    if headed or not text or HEADER in given:
        return sheet
    return replace(sheet, comment=_comment(text, line, separator, len(names)))


def _comment(text: str, begin: int, separator: str, width: int) -> tuple[str, ...]:
    """Cells of the comment right above line ``begin``, if they are names of so many columns."""
    above = [line.strip() for line in lines_of(text[:100_000])[: begin - 1]]
    line = next((line for line in reversed(above) if line), "")
    if not line.startswith(("#", "%")):
        return ()
    content = line.lstrip("#% ")
    for cells in (content.split(None if separator == " " else separator), content.split()):
        names = tuple(cell.strip() for cell in cells)
        numbers = [number_in(name) for name in names]
        if len(names) == width == len(set(names)) and all(n != n for n in numbers):
            return names
    return ()


def _too_wide(path: Path, line: int, columns: int) -> ForeignFileError:
    """Error about a row with too many cells, to be raised by the caller."""
    problem, expected = f"{columns} columns", f"at most {_MOST_COLUMNS}"
    hint = "check whether rows and columns are exchanged"
    return ForeignFileError(problem, expected, file=path, line=line, hint=hint)


def _even(path: Path, width: int, rows: Iterator[RawRow], *, headed: bool) -> Iterator[RawRow]:
    """Rows of as many cells as there are columns."""
    for line, cells in rows:
        if len(cells) == width:
            yield line, cells
            continue
        # Many programs end every line with a separator, some only those of the data.
        count = len(cells)
        while count > width and not cells[count - 1].strip():
            count -= 1
        if count != width:
            last = next(rows, None) is None
            problem = f"{count} {'cell' if count == 1 else 'cells'}"
            expected = f"{width}, as in {'the header' if headed else 'the first row'}"
            hint = _why_uneven(count, width, last=last)
            raise ForeignFileError(problem, expected, file=path, line=line, hint=hint)
        yield line, cells[:count]


def _why_uneven(cells: int, width: int, *, last: bool) -> str:
    """What to do about a row with more or fewer cells than the first one."""
    if cells == 2 * width:
        return (
            "decimal commas and commas between cells? Write the table again with semicolons "
            "between cells"
        )
    if last and cells < width:
        return (
            "check whether the file was cut off while it was written. Remove its last line, "
            "or write it again"
        )
    return (
        "give the number of lines before the table with --skip N, or the separator of the cells "
        "with --separator"
    )


def _skipped(given: Given) -> int:
    return given.whole(SKIP, "0", 0, 10**9, "a number of lines")


def _split(path: Path, text: str, separator: str, decimal: str, skip: int) -> Iterator[RawRow]:
    """Rows in which something stands, behind those that are to be skipped."""
    for line, cells in split_lines(path, text, _SEPARATORS[separator]):
        if line <= skip or not (cells[0].strip() or any(map(str.strip, cells))):
            continue
        yield line, [*map(_with_point, cells)] if decimal == "comma" else cells


def _with_point(cell: str) -> str:
    return cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell.strip()) else cell


def _signs(path: Path, text: str, given: Given) -> tuple[str, str]:
    """Separator and decimal sign: the only ones that make the most of the file's cells numbers."""
    # Rows from which the layout of a file is recognised.
    enough = 200
    lines = text[: 400 * enough].splitlines(keepends=True)
    whole_lines = lines[:-1] if len(lines) > 1 and len(text) > 400 * enough else lines
    head, skip = "".join(whole_lines[: enough + _skipped(given)]), _skipped(given)
    separators = [given.text(SEPARATOR)] if SEPARATOR in given else list(_SEPARATORS)
    decimals = [given.text(DECIMAL)] if DECIMAL in given else list(_DECIMALS)
    ranked: list[tuple[tuple[float, float], tuple[str, str], list[tuple[float, ...]]]] = []
    for signs in product(separators, decimals):
        rows = list[Sequence[str]]()
        with suppress(ForeignFileError):
            rows = [row for _, row in _split(path, head, *signs, skip)]
        if not rows:
            continue
        numbers = [tuple(map(number_in, row)) for row in rows[1:] or rows]
        flat = [n == n for row in numbers for n in row]
        usual, times = Counter(map(len, numbers)).most_common(1)[0]
        if usual >= 2 or len(separators) == 1:
            share = sum(flat) / max(len(flat), 1)
            rank = round(times / len(numbers), 2), round(share, 3)
            ranked.append((rank, signs, numbers))
    if not ranked:
        problem = "no rows of cells"
        expected = f"a table with {listed(list(_SEPARATORS))} between its cells"
        hint = "give the separator of the cells with --separator"
        raise ForeignFileError(problem, expected, file=path, hint=hint)
    best = max(ranked, key=lambda candidate: (candidate[0][1], candidate[0][0]))
    rivals = [
        signs
        for rank, signs, numbers in ranked
        if rank == best[0] and repr(numbers) != repr(best[2]) and best[0][1] > 0
    ]
    if rivals:
        ways = " or ".join(f"--separator {s} --decimal {d}" for s, d in [best[1], *rivals])
        problem = "cells that can be separated in several ways"
        raise ForeignFileError(problem, "only one way", file=path, hint=f"give {ways}")
    return best[1]


def _is_header(rows: Sequence[Sequence[str]]) -> bool:
    """Whether the first row holds text where the next one holds numbers."""
    first, following = rows[0], rows[1:2]
    text = [cell != "" and number_in(cell) != number_in(cell) for cell in first]
    if not following:
        return all(text)
    return any(
        of_text
        and not is_missing(cell)
        and (is_missing(below) or number_in(below) == number_in(below))
        for of_text, cell, below in zip(text, first, following[0], strict=False)
    )


@contextmanager
def _read_errors(path: Path, what: str) -> Iterator[None]:
    """The readers of spreadsheets raise whatever they meet."""
    try:
        yield
    except ForeignFileError:
        raise
    except Exception as problem:  # noqa: BLE001
        description = f"{what} ({type(problem).__name__})"
        raise ForeignFileError(description, "an .xlsx file", file=path) from None


def _spreadsheet(path: Path, sheet: str) -> list[RawRow]:
    """Rows of one sheet, formulas as the values that were last computed."""
    openpyxl = load("openpyxl", "formats")
    read_bounded(path)
    with _read_errors(path, "a file that is not a spreadsheet"):
        with zipfile.ZipFile(path) as archive:
            # Its few bytes may unpack to as many as one likes.
            if sum(entry.file_size for entry in archive.infolist()) > 4 * MOST_BYTES:
                problem = f"a spreadsheet of more than {4 * MOST_BYTES / 1e6:.0f} MB unpacked"
                expected = "a table with at most a few hundred thousand rows"
                raise ForeignFileError(problem, expected, file=path)
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
    # Sheets are read when they are asked for.
    with closing(book), _read_errors(path, "a damaged spreadsheet"):
        if not sheet and len(book.sheetnames) > 1:
            problem = f"{len(book.sheetnames)} sheets: {listed(book.sheetnames)}"
            hint = "choose it with --sheet NAME"
            raise ForeignFileError(problem, "one sheet, or the name of one", file=path, hint=hint)
        name = sheet or book.sheetnames[0]
        if name not in book.sheetnames:
            expected = f"one of {listed(book.sheetnames)}"
            raise ForeignFileError(f"no sheet {name!r}", expected, file=path)
        return _rows_of_sheet(path, book[name])


def _rows_of_sheet(path: Path, sheet: Any) -> list[RawRow]:
    rows, count = list[RawRow](), 0
    # Of a spreadsheet, empty cells between others included.
    most_rows, most_cells = 2_000_000, 10_000_000
    # The size that the file states may be anything: its cells are read as they come.
    sheet.reset_dimensions()
    for number, values in enumerate(sheet.iter_rows(values_only=True), 1):
        count += len(values)
        if len(values) > _MOST_COLUMNS:
            raise _too_wide(path, number, len(values))
        if number > most_rows or count > most_cells:
            description = f"more than {most_rows:,} rows or {most_cells:,} cells"
            raise ForeignFileError(description, "fewer", file=path)
        cells = tuple("" if value is None else str(value).strip() for value in values)
        if any(cells):
            rows.append((number, cells))
    # Empty cells at the end of a row are not in the file.
    width = max((len(cells) for _, cells in rows), default=0)
    if width * len(rows) > most_cells:
        raise ForeignFileError(f"{width} columns in {len(rows)} rows", "fewer", file=path)
    return [(number, (*cells, *[""] * (width - len(cells)))) for number, cells in rows]
