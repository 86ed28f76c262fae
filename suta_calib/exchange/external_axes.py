"""External axes in programs of robots: a track, a turntable, or the seventh joint of an arm.

A controller writes them behind the arm's own axes, in mm or in degrees, and does not say which.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.option import Given, Option
from suta_calib.units import from_deg, from_mm

EXTERNAL_UNIT: Final = Option(
    "external_unit",
    "Unit of each external axis: mm or deg; unused for an axis that does not move the arm.",
    "E1=mm,…",
    several=True,
)
_UNITS: Final = ("mm", "deg", "unused")


@dataclass(frozen=True, eq=False)
class ExternalAxes:
    """What the positions of a program say about external axes.

    Attributes:
        path: the program, for messages.
        lines: (n,) line of each position.
        values: (n,) of each axis by its name in the controller, in the controller's unit; NaN where
            a position does not have the axis.
    """

    path: Path
    lines: Sequence[int]
    values: Mapping[str, FloatArray]

    @classmethod
    def of(
        cls, path: Path, lines: Sequence[int], rows: Sequence[Mapping[str, float]]
    ) -> ExternalAxes:
        """From the numbers by name of each position; an axis at 9E9 is none."""
        names = sorted({name for row in rows for name in row})
        numbers = {name: np.array([row.get(name, np.nan) for row in rows]) for name in names}
        # What ABB writes for an axis that there is not: 9E9.
        absent = 8e9
        for values in numbers.values():
            values[np.abs(values) > absent] = np.nan
        return cls(path, lines, numbers)

    def used(self, names: Sequence[str], count: int) -> list[str]:
        """Axes that are not zero in all positions.

        Where more names are given, also some that are zero: the seventh joint of an arm may be.
        """
        moved = [name for name, values in self.values.items() if np.any(np.nan_to_num(values))]
        still = [
            name
            for name, values in self.values.items()
            if name not in moved and np.isfinite(values).all()
        ]
        return sorted(moved + still[: max(0, len(names) - count - len(moved))])

    def columns(
        self, axes: Sequence[str], names: Sequence[str], given: Given, *, required: bool
    ) -> tuple[dict[str, FloatArray], list[str]]:
        """Columns of axes in m or rad by name, and what the user must know of them."""
        units = self._units(given)
        columns, notes = dict[str, FloatArray](), list[str]()
        for axis, name in zip_longest(axes, names[: len(axes)], fillvalue=""):
            values, unit = self.values[axis], units.get(axis, "")
            if unit == "unused":
                continue
            finite = values[np.isfinite(values)]
            extent = f"{finite.min():g} to {finite.max():g}"
            # A joint of an arm reaches so many degrees; a track's millimetres are soon more.
            if not unit and name and np.abs(finite).max() <= 360.0:
                unit = "deg"
                notes.append(
                    f"{name} is the external axis {axis} ({extent}). Its numbers are treated as "
                    f"degrees. If they are mm, give {EXTERNAL_UNIT.switch} {axis}=mm."
                )
            hint = (
                f"give {EXTERNAL_UNIT.switch} {axis}=mm, {axis}=deg, or {axis}=unused if it does "
                "not move the arm"
            )
            if not unit and not required:
                notes.append(f"The external axis {axis}, {extent}, is not used: {hint}.")
                continue
            if not unit:
                line = self._first(np.nan_to_num(values) != 0.0)
                problem = f"the external axis {axis}, {extent}, in mm or degrees"
                raise ForeignFileError(problem, "its unit", file=self.path, line=line, hint=hint)
            if len(finite) < len(values):
                line, expected = self._first(np.isnan(values)), "the same axes in all positions"
                problem = (
                    f"a position without the external axis {axis}, although other positions have it"
                )
                raise ForeignFileError(problem, expected, file=self.path, line=line, hint=hint)
            columns[name or axis] = (from_mm if unit == "mm" else from_deg)(values)
            if not name:
                notes.append(
                    f"The external axis {axis} moves ({extent} {unit}). Either the arm's URDF "
                    f"needs a joint {axis}, or the base of the arm is at several places in these "
                    "rows."
                )
        return columns, notes

    def _units(self, given: Given) -> dict[str, str]:
        """By axis; one unit alone is that of all."""
        units: dict[str, str] = {}
        for part in given.texts(EXTERNAL_UNIT):
            axis, equals, unit = map(str.strip, part.rpartition("="))
            if unit not in _UNITS:
                raise given.refuse(EXTERNAL_UNIT, repr(unit), f"one of {', '.join(_UNITS)}")
            if equals and axis not in self.values:
                there = ", ".join(self.values) or "none"
                raise given.refuse(EXTERNAL_UNIT, f"the axis {axis!r}", f"one of {there}")
            units |= dict.fromkeys([axis] if equals else self.values, unit)
        return units

    def _first(self, rows: BoolArray) -> int:
        """Line of the first of some rows."""
        return self.lines[int(np.flatnonzero(rows)[0])]
