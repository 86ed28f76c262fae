"""CSV files as programs write them: every line a row, every comma the end of a cell.

They have so many rows that to look at each cell would take longest of all: numbers are read by
NumPy's own reader, and text is cut into cells only where somebody asks for it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import cached_property
from io import BytesIO
from operator import methodcaller
from typing import Final, Self

import numpy as np

from suta_calib.arrays import FloatArray

# What a cell of a plain file does not have: quotes, comments, and blanks of any sort around it.
_NOT_PLAIN: Final = (
    *('"', "#", ";", "\0"),
    *(c for c in map(chr, range(128)) if c.isspace() and c != "\n"),
)
# All that decimal numbers consist of, and what stands between them.
_OF_NUMBERS: Final = b"0123456789+-.eE,\n"
# Characters that the parser takes for one cell at most.
_LONGEST_LINE: Final = 100_000


class PlainColumns(Mapping[str, tuple[str, ...]]):
    """Cells by column name.

    Args:
        header: names of the columns.
        text: all lines, each with its end.
        start: where in it the lines behind the header begin.
        read: (rows, columns) numbers of all cells, where they have been read.
    """

    def __init__(
        self, header: list[str], text: str, start: int, read: FloatArray | None = None
    ) -> None:
        self._place = {name: k for k, name in enumerate(header)}
        self._text, self._start, self._read = text, start, read

    @classmethod
    def of(cls, text: str) -> Self | None:
        """The columns of a plain file; None where something is to be skipped or explained."""
        if "\r" in text:
            text = text.replace("\r\n", "\n")
        if (numbers := cls._of_numbers(text)) is not None:
            return numbers
        ended = text.isascii() and text.endswith("\n")
        if not ended or any(mark in text for mark in _NOT_PLAIN):
            return None
        end = text.index("\n")
        header, commas = text[:end].split(","), text.count(",", 0, end)
        columns = cls(header, text, end + 1)
        if not _names_columns(header) or not columns._body:
            return None
        lines = columns._body.split("\n")
        # One pass in C over what may be a million lines.
        if set(map(methodcaller("count", ","), lines)) != {commas}:
            return None
        if max(map(len, lines)) > _LONGEST_LINE:
            return None
        if not commas and not all(lines):
            return None
        return columns

    @classmethod
    def _of_numbers(cls, text: str) -> Self | None:
        """The columns of a file of nothing but decimal numbers: NumPy alone looks at its lines.

        Large files are not copied to look at them.
        """
        head, _, rest = text[:_LONGEST_LINE].partition("\n")
        header, start = head.split(","), len(head) + 1
        plain = head.isascii() and not any(mark in head for mark in _NOT_PLAIN)
        first = rest.partition("\n")[0].split(",")
        if not (plain and _names_columns(header) and all(map(_is_number, first))):
            return None
        data = text.encode()
        if data.translate(None, _OF_NUMBERS) != data[:start].translate(None, _OF_NUMBERS):
            return None
        if not data.endswith(b"\n"):
            return None
        lines = BytesIO(data)
        lines.seek(start)
        try:
            # Refuses lines of different lengths, and goes over empty ones.
            read = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)
        except ValueError:
            return None
        if read.shape != (data.count(b"\n", start), len(header)):
            return None
        return cls(header, text, start, read)

    @property
    def rows(self) -> int:
        """How many there are."""
        return self._body.count("\n") + 1 if self._read is None else len(self._read)

    def numbers(self, name: str) -> FloatArray | None:
        """One column (n,); None where one of its cells is no number."""
        place = self._place[name]
        if self._read is not None:
            return self._read[:, place]
        if self._numbers is None or place not in self._numbers:
            return None
        return self._numbers[place]

    @cached_property
    def _body(self) -> str:
        """All lines behind the header, without the end of the last."""
        return self._text[self._start : -1]

    @cached_property
    def _cells(self) -> list[str]:
        return self._body.replace("\n", ",").split(",")

    @cached_property
    def _numbers(self) -> dict[int, FloatArray] | None:
        """By place, the columns that begin with a number; None where one of them goes on otherwise.

        NumPy reads the digits as Python does, but knows no ``1_000``.
        """
        first = self._body.partition("\n")[0].split(",")
        columns = [k for k, cell in enumerate(first) if _is_number(cell)]
        if not columns or "_" in self._body:
            return None
        try:
            # Bytes it takes in great pieces, and text line by line.
            text = BytesIO(self._body.encode())
            read = np.loadtxt(text, delimiter=",", comments=None, usecols=columns, ndmin=2)
        except ValueError:
            return None
        return dict(zip(columns, np.ascontiguousarray(read.T), strict=True))

    def __getitem__(self, name: str) -> tuple[str, ...]:
        return tuple(self._cells[self._place[name] :: len(self._place)])

    def __contains__(self, name: object) -> bool:
        # Whether there is a column is no reason to cut its cells.
        return name in self._place

    def __iter__(self) -> Iterator[str]:
        return iter(self._place)

    def __len__(self) -> int:
        return len(self._place)


def _names_columns(header: list[str]) -> bool:
    return all(header) and len(set(header)) == len(header)


def _is_number(cell: str) -> bool:
    try:
        return math.isfinite(float(cell))
    except ValueError:
        return False
