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


class PlainColumns(Mapping[str, tuple[str, ...]]):
    """Cells by column name.

    Args:
        header: names of the columns.
        text: all lines, each with its end.
        start: where in it the lines behind the header begin.
    """

    def __init__(self, header: list[str], text: str, start: int) -> None:
        self._place = {name: k for k, name in enumerate(header)}
        self._text, self._start = text, start

    @classmethod
    def of(cls, text: str) -> Self | None:
        """The columns of a plain file; None where something is to be skipped or explained."""
        if "\r" in text:
            text = text.replace("\r\n", "\n")
        ended = text.isascii() and text.endswith("\n")
        if not ended or any(mark in text for mark in _NOT_PLAIN):
            return None
        end = text.index("\n")
        header, commas = text[:end].split(","), text.count(",", 0, end)
        columns = cls(header, text, end + 1)
        if not (all(header) and len(columns) == len(header) and columns._body):
            return None
        lines = columns._body.split("\n")
        # One pass in C over what may be a million lines.
        plain = set(map(methodcaller("count", ","), lines)) == {commas}
        # Characters that the parser takes for one cell at most.
        longest_line = 100_000
        plain = plain and max(map(len, lines)) <= longest_line
        return columns if plain and (commas or all(lines)) else None

    @property
    def rows(self) -> int:
        """How many there are."""
        return self._body.count("\n") + 1

    def numbers(self, name: str) -> FloatArray | None:
        """One column (n,); None where one of its cells is no number."""
        return (self._numbers or {}).get(self._place[name])

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


def _is_number(cell: str) -> bool:
    try:
        return math.isfinite(float(cell))
    except ValueError:
        return False
