"""Leica GSI-8 and GSI-16: points of total stations and laser trackers."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import read_foreign_text
from suta_calib.exchange.imported import (
    GRID_HINT,
    ORIGIN,
    ImportedRows,
    distance_notes,
    from_origin,
    pose_columns,
)
from suta_calib.exchange.option import Given
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.truncated import COMPLETE, check_end_of_rows
from suta_calib.measurements.files import lines_of
from suta_calib.units import from_deg, from_mm

# Word index, four characters of which the last is the unit, sign, 8 or 16 characters of data.
_WORD: Final = re.compile(
    r"(\d\d)[\d.]{3}([\d.])([+-])([0-9A-Za-z._-]{16}|[0-9A-Za-z._-]{8})(?=\s|$)"
)
_POINT: Final = "11"
_HORIZONTAL, _ZENITH, _SLOPE = "21", "22", "31"
_EAST, _NORTH, _HEIGHT = "81", "82", "83"


def _sexagesimal(number: float) -> float:
    """dddmmsss, the last digit a tenth of a second."""
    digits = int(abs(number))
    degrees, minutes, tenths = digits // 100_000, digits // 1000 % 100, digits % 1000
    return from_deg(math.copysign(degrees + minutes / 60 + tenths / 36_000, number))


# The unit of the last digit, by its code: lengths in m, angles in rad.
_LENGTH: Final[Mapping[str, Callable[[float], float]]] = {
    code: from_mm(size).__mul__ for code, size in (("0", 1.0), ("6", 0.1), ("8", 0.01))
}
_ANGLE: Final[Mapping[str, Callable[[float], float]]] = {
    "2": lambda number: number * 1e-5 * math.pi / 200,
    "3": lambda number: from_deg(number * 1e-5),
    "4": _sexagesimal,
}


class LeicaGsiReader(Reader):
    """Coordinates where the words hold them, or else directions with slope distances."""

    name = "leica-gsi"
    summary = "Leica GSI-8 and GSI-16 of total stations: points by name"
    example = "points.gsi --format leica-gsi --out points.csv"
    signature = re.compile(r"\A\*?1[01][\d.]{4}[+-]")
    options = (ORIGIN, COMPLETE)
    suffixes = (".gsi", ".txt", ".dat")

    def read(self, path: Path, given: Given) -> ImportedRows:
        """``point`` and ``x, y, z`` in m: east, north, up. Lines without a place are left out."""
        text = read_foreign_text(path)
        check_end_of_rows(path, text, " ", given, fixed_width=True)
        labels, places = list[str](), list[list[float]]()
        lines, left_out = list[int](), 0
        for number, line in enumerate(lines_of(text), 1):
            content = line.strip().removeprefix("*")
            if not content:
                continue
            words = {m[1]: (m[2], m[3], m[4]) for m in _WORD.finditer(content)}
            if _POINT not in words:
                problem = f"{content[:40]!r}, which does not contain the word {_POINT} of a point"
                raise ForeignFileError(problem, "a GSI line", file=path, line=number)
            if len({len(digits) for _, _, digits in words.values()}) > 1:
                mixed = "words of both 8 and 16 characters"
                raise ForeignFileError(mixed, "words of one length", file=path, line=number)
            place = _place(path, number, words)
            if place is None:
                left_out += 1
                continue
            labels.append(words[_POINT][2].lstrip("0") or "0")
            places.append(place)
            lines.append(number)
        position, remarks = from_origin(path, lines, np.array(places).reshape(-1, 3), given)
        notes = distance_notes(position, "lengths in the units of the words")
        if notes and not remarks:
            notes = (f"{notes[0]} Or {GRID_HINT}.",)
        return ImportedRows(
            source=path,
            form=self.name,
            columns={"point": np.array(labels, dtype=np.str_), **pose_columns(position, None)},
            dropped=left_out,
            notes=notes,
            remarks=remarks,
        )


def _place(path: Path, line: int, words: dict[str, tuple[str, str, str]]) -> list[float] | None:
    """East, north, up, m; None where a line holds neither coordinates nor directions."""

    def value(index: str, units: Mapping[str, Callable[[float], float]]) -> float:
        unit, sign, digits = words[index]
        problem, expected = "", ""
        if not digits.isdigit():
            problem, expected = repr(digits), "digits"
        elif unit not in units:
            problem, expected = f"the unit {unit!r}", f"one of {', '.join(units)}"
        if problem:
            raise ForeignFileError(problem, expected, file=path, line=line, where=f"word {index}")
        return units[unit](math.copysign(float(int(digits)), -1.0 if sign == "-" else 1.0))

    if all(index in words for index in (_EAST, _NORTH, _HEIGHT)):
        return [value(index, _LENGTH) for index in (_EAST, _NORTH, _HEIGHT)]
    if not all(index in words for index in (_HORIZONTAL, _ZENITH, _SLOPE)):
        return None
    horizontal, zenith = value(_HORIZONTAL, _ANGLE), value(_ZENITH, _ANGLE)
    slope = value(_SLOPE, _LENGTH)
    level = slope * math.sin(zenith)
    return [level * math.sin(horizontal), level * math.cos(horizontal), slope * math.cos(zenith)]
