"""Whether a text file was cut off: a half-copied number looks like a number.

A file that ends with the end of a line is cut between its rows at most. Where the last line has no
end, the file may be cut inside the last number, and 1.208077 reads as 1.2. Such a file is read only
where its last cell is complete for certain; `COMPLETE` is how the user says that it is.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path
from typing import Final

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import rows_of_text
from suta_calib.exchange.option import Given, Option
from suta_calib.measurements.csv_table import number_in
from suta_calib.measurements.files import lines_of

COMPLETE: Final = Option(
    "whole", "The file is complete, although its end looks incomplete.", flag=True
)
_FIXED: Final = re.compile(r"[+-]?\d*[.,](\d+)((?:[eE][+-]\d+)?)", re.ASCII)
_NUMBER: Final = re.compile(r"[+-]?[\d.,]+([eE][+-]?\d+)?", re.ASCII)
_OPENING, _CLOSING = "([{", ")]}"
_LONGEST: Final = 40


def check_end_of_rows(
    path: Path, text: str, separator: str, given: Given, *, fixed_width: bool = False
) -> None:
    """Refuse rows of cells of which the last may be cut off.

    The last row is complete where its line has an end, or where it has as many cells as the row
    before and its last cell cannot be the beginning of a longer one.
    """
    if COMPLETE in given or text.endswith(("\n", "\r")):
        return
    # Of a long file its end is enough; blank lines in front keep the numbers of the lines.
    enough = 100_000
    start = text.find("\n", len(text) - enough) + 1 if len(text) > enough else 0
    tail = "\n" * text.count("\n", 0, start) + text[start:]
    before, line = ["", *lines_of(tail)][-2:]
    # Blanks are no row, unless rows begin with them.
    indented = before[:1].isspace() and bool(before.strip())
    if line.lstrip().startswith(("#", "%")) or not (line.strip() or indented):
        return
    if not line.strip():
        problem = "spaces at the end of the file, where a row should begin"
        raise cut_off(path, len(lines_of(tail)), problem, "a complete row, or the end of the file")
    *above, last = rows_of_text(path, tail, separator)
    width = len(last.cells)
    same_width = takewhile(lambda row: len(row.cells) == width, reversed(above))
    earlier = [row.cells for row in same_width]
    if above and width < len(above[-1].cells):
        expected = f"{len(above[-1].cells)}, as in the row before"
        raise cut_off(path, last.line, f"a last row of {width} cells", expected)
    # Blanks behind each row are its end as well.
    blanks = before.rstrip("\r\n").endswith(" ") <= line.endswith(" ")
    if blanks and _is_complete(line, separator, last.cells, earlier, fixed_width=fixed_width):
        return
    expected = "a line break after it, as after all other lines"
    raise _open_end(path, last.line, last.cells[-1], expected)


def _is_complete(
    line: str,
    separator: str,
    last: Sequence[str],
    earlier: Sequence[Sequence[str]],
    *,
    fixed_width: bool,
) -> bool:
    """Whether the last cell of the last row is no beginning of a longer one."""
    if not earlier:
        return False
    if line.endswith('"') or (separator == " " and line[-1].isspace()):
        return True
    cell, cells_before = last[-1], [cells[-1] for cells in earlier]
    if not cell:
        return not any(cells_before)
    if fixed_width:
        return {len(cell)} == set(map(len, cells_before))
    if _ends_matrix(last, len(earlier) + 1):
        return True
    # Up to the header, whose cells are no numbers.
    numbers = [*takewhile(_NUMBER.fullmatch, cells_before)]
    forms = {*map(_form, numbers)}
    # Rows before the last one whose decimals say how many the last one has: four of equal length by
    # chance are rare, and `measurements.csv_table` asks for as many.
    enough = 4
    return len(numbers) >= enough and forms == {_form(cell)} != {None}


def _form(cell: str) -> tuple[int, int] | None:
    """Decimals, and length of the exponent, of a number that may be of a fixed format."""
    match = _FIXED.fullmatch(cell)
    # More decimals than programs write where their number is fixed; the shortest text that gives a
    # number back has up to 17, and as many as it happens to need.
    most_decimals = 12
    if match is None or len(match[1]) > most_decimals:
        return None
    return len(match[1]), len(match[2])


def _ends_matrix(cells: Sequence[str], rows: int) -> bool:
    """Whether they are the last row, 0 0 0 1, of a 4x4 transform, stacked or in one line."""
    if len(cells) != 16 and (len(cells) != 4 or rows % 4):
        return False
    decimals = {len(cell.partition(".")[2]) for cell in cells[-4:]}
    return len(decimals) == 1 and [*map(number_in, cells[-4:])] == [0, 0, 0, 1]


def check_end_of_program(
    path: Path,
    text: str,
    given: Given,
    comment: str,
    opening: re.Pattern[str],
    closing: re.Pattern[str],
    last_word: re.Pattern[str],
) -> None:
    """Refuse a program that was cut off: an open block, bracket or statement at its end."""
    if COMPLETE in given:
        return
    lines = [line.partition(comment)[0].strip() for line in lines_of(text)]
    begun = [line for line in lines if opening.match(line)]
    ended = sum(closing.match(line) is not None for line in lines)
    if ended < len(begun):
        problem = f"no end of the block {begun[ended][:_LONGEST]!r}"
        raise cut_off(path, len(lines), problem, "a complete program")
    last = lines[-1] if lines else ""
    if text.endswith(("\n", "\r")) or not last or last_word.match(last):
        return
    balance = sum(last.count(sign) for sign in _OPENING) - sum(map(last.count, _CLOSING))
    if balance > 0 or not last.endswith((";", *_CLOSING)):
        raise _open_end(path, len(lines), last, "a complete statement")


def check_last_line(path: Path, text: str, given: Given) -> None:
    """Refuse a text whose last line has no end, unless it closes a list or a mapping."""
    last = lines_of(text)[-1].rstrip(" ")
    if COMPLETE not in given and not last.endswith(("\n", "\r", *_CLOSING)):
        raise _open_end(path, len(lines_of(text)), last, "a line break after it")


def check_count(path: Path, count: int, stated: float, what: str, given: Given) -> None:
    """Refuse fewer rows than the file says that it has."""
    if COMPLETE not in given and count < stated:
        raise cut_off(path, None, f"{count} {what}", f"{stated:.0f}, as the file states")


def _open_end(path: Path, line: int, last: str, expected: str) -> ForeignFileError:
    problem = f"{last[-_LONGEST:]!r} at the end of the file, without a line break"
    return cut_off(path, line, problem, expected)


def cut_off(path: Path, line: int | None, problem: str, expected: str) -> ForeignFileError:
    """Error that a file seems cut off, to be raised by the caller."""
    hint = (
        "check whether the file was cut off while it was written or copied. If nothing is "
        f"missing, give {COMPLETE.switch}"
    )
    if line is not None:
        hint += ", or add a line break at its end"
    return ForeignFileError(problem, expected, file=path, line=line, hint=hint)
