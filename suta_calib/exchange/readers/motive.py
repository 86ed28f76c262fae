"""OptiTrack: the CSV that Motive exports (format versions 1.2 and later)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

from suta_calib.exchange.cells import LENGTH_UNITS, TableRow
from suta_calib.exchange.option import Given
from suta_calib.exchange.tracked_bodies import (
    Body,
    InstrumentReader,
    Recording,
    body_of,
    column_of_time,
)
from suta_calib.exchange.truncated import check_count
from suta_calib.measurements.csv_table import number_in

_KINDS: Final = frozenset({"Rigid Body", "Marker"})
_POSITION: Final = ("position x", "position y", "position z")
_ROTATION: Final = ("rotation x", "rotation y", "rotation z", "rotation w")


class MotiveReader(InstrumentReader):
    """Rigid bodies as quaternions, markers as points."""

    name = "motive"
    summary = "OptiTrack: CSV of Motive, rigid bodies (quaternions) and markers"
    example = "take.csv --format motive --body probe --reference base --out poses.csv"
    signature = re.compile(r"\AFormat Version,.*Take Name", re.DOTALL)

    def recording(self, path: Path, rows: Sequence[TableRow], given: Given) -> Recording:
        """Bodies and markers by name, as in the file."""
        header = dict(pairwise(rows[0].cells))
        unit = header.get("Length Units", "")
        if unit.lower() not in LENGTH_UNITS:
            raise self.strange(path, f"lengths in {unit!r}", "Meters or Millimeters", rows[0].line)
        at = next((k for k, row in enumerate(rows) if row.cells[0] == "Frame"), 0)
        if not 3 <= at < len(rows) - 1:
            problem = "no rows of names before a row that begins with Frame"
            raise self.strange(path, problem, "an export with its header", rows[-1].line)
        axes, kinds, data = rows[at], rows[at - 1].cells, rows[at + 1 :]
        stated = number_in(header.get("Total Exported Frames", ""))
        check_count(path, len(data), stated, "frames", given)
        kind = next((k for k in range(1, at - 1) if not _KINDS.isdisjoint(rows[k].cells)), None)
        if kind is None:
            raise self.strange(path, "no rigid body and no marker", "at least one", axes.line)
        types, names = rows[kind].cells, rows[kind + 1].cells
        columns: dict[str, dict[str, int]] = {}
        for k in range(2, min(map(len, (types, names, kinds, axes.cells)))):
            if types[k] in _KINDS and names[k]:
                of = f"{kinds[k]} {axes.cells[k]}".lower()
                columns.setdefault(names[k], {}).setdefault(of, k)
        angles = header.get("Rotation Type", "Quaternion")
        bodies: dict[str, Body] = {}
        for name, where in columns.items():
            if not all(key in where for key in _POSITION):
                continue
            turned = "rotation x" in where
            if turned and (not all(key in where for key in _ROTATION) or angles != "Quaternion"):
                problem = f"orientations of {name} as {angles}"
                raise self.strange(
                    path, problem, "an export with Rotation Type: Quaternion", axes.line
                )
            position = [where[key] for key in _POSITION]
            rotation = [where[key] for key in _ROTATION] if turned else []
            scale = LENGTH_UNITS[unit.lower()]
            bodies[name] = body_of(path, data, position, rotation, "xyzw", scale)
        if not bodies:
            problem = "bodies and markers without positions"
            raise self.strange(path, problem, "an export of positions", axes.line)
        time = next((k for k, cell in enumerate(axes.cells) if cell.startswith("Time")), None)
        unit_source = f"in {unit.lower()}, as the file states"
        return Recording(path, bodies, column_of_time(path, data, time), unit_source)
