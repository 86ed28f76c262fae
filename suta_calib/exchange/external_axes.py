"""External axes in programs of robots: a track, a turntable, or the seventh joint of an arm.

A controller writes them behind the arm's own axes, in mm or in degrees, and does not say which.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
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

        Args:
            names: of joints, as the user gave them.
            count: of the arm's own axes.
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
        """Columns of axes in m or rad by name, and what the user must know of them.

        Args:
            axes: that are used.
            names: of joints for these axes, as the user gave them; empty where there are none.
            given: `EXTERNAL_UNIT`.
            required: whether rows mean nothing without these axes.

        Raises:
            ForeignFileError: an axis whose unit nobody says, or that some positions do not have.
            InputError: a unit that is none, or of an axis that there is not.
        """
        units = self._units(given)
        columns, notes = dict[str, FloatArray](), list[str]()
        # Degrees that a joint of an arm reaches; a track's millimetres are soon more.
        most_degrees = 360.0
        for k, axis in enumerate(axes):
            values, unit = self.values[axis], units.get(axis, "")
            finite = values[np.isfinite(values)]
            extent = f"{finite.min():g} to {finite.max():g}"
            if unit == "unused":
                continue
            named = bool(names)
            if not unit and named and np.abs(finite).max() <= most_degrees:
                unit = "deg"
                notes.append(
                    f"{names[k]} is the external axis {axis} ({extent}); its numbers are taken "
                    f"as degrees. If they are mm, give {EXTERNAL_UNIT.switch} {axis}=mm."
                )
            hint = (
                f"say {EXTERNAL_UNIT.switch} {axis}=mm, {axis}=deg, or {axis}=unused where it does "
                "not move the arm"
            )
            if not unit:
                if not required:
                    notes.append(f"The external axis {axis}, {extent}, is left out: {hint}.")
                    continue
                problem = f"the external axis {axis}, {extent}, in mm or degrees"
                raise ForeignFileError(
                    problem, "its unit", file=self.path, line=self._line(axis), hint=hint
                )
            if len(finite) < len(values):
                line = self.lines[int(np.flatnonzero(np.isnan(values))[0])]
                problem = f"a position without the external axis {axis}, which other positions have"
                raise ForeignFileError(
                    problem, "the same axes in all positions", file=self.path, line=line, hint=hint
                )
            columns[names[k] if named else axis] = (from_mm if unit == "mm" else from_deg)(values)
            if not named:
                notes.append(
                    f"The external axis {axis} moves ({extent} {unit}). Either the arm's URDF "
                    f"needs a joint {axis}, or the base of the arm stands at several places in "
                    "these rows."
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

    def _line(self, axis: str) -> int:
        """Of the first position in which an axis is not zero."""
        return self.lines[int(np.flatnonzero(np.nan_to_num(self.values[axis]))[0])]
