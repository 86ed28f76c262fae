"""Vicon: the CSV that Nexus and Tracker export, segments (objects) and trajectories."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import LENGTH_UNITS, TableRow
from suta_calib.exchange.option import Given
from suta_calib.exchange.table_roles import ROTATION
from suta_calib.exchange.tracked_bodies import (
    BODY_OPTIONS,
    Body,
    InstrumentReader,
    Recording,
    body_of,
)
from suta_calib.exchange.truncated import COMPLETE
from suta_calib.measurements.csv_table import number_in
from suta_calib.units import from_deg
from suta_calib.words import listed

_BODIES: Final = ("Segments", "Objects")
_MARKERS: Final = ("Trajectories",)
_BLOCKS: Final = (*_BODIES, *_MARKERS, "Joints", "Model Outputs", "Devices")
# How Nexus names the columns of a segment in front of its own name.
_GLOBAL: Final = "Global Angle "


class ViconReader(InstrumentReader):
    """Segments with their angles, markers as points; a file may have a block of each."""

    name = "vicon"
    summary = "Vicon: CSV of Nexus or Tracker, segments or objects, trajectories"
    example = "trial.csv --format vicon --body probe:probe --rotation vector"
    signature = re.compile(rf"\A\s*(?:{'|'.join(_BLOCKS)}).*Sub Frame", re.DOTALL)
    options = (*BODY_OPTIONS, ROTATION, COMPLETE)

    def recording(self, path: Path, rows: Sequence[TableRow], given: Given) -> Recording:
        """Segments and markers by name, as many rows as the first block has."""
        bodies: dict[str, Body] = {}
        rate, count = 0.0, 0
        for kind, block in _blocks(rows):
            if kind not in (*_BODIES, *_MARKERS):
                continue
            # Rate, names, axes, units, and a frame.
            if len(block) < 5 or "Frame" not in block[2].cells:
                line = block[0].line if block else rows[0].line
                problem = f"a block {kind} without its header"
                raise self.strange(path, problem, "rate, names, axes, units and frames", line)
            block_bodies = dict(self._bodies(path, block, given))
            if count and count != len(block) - 4:
                problem = f"{len(block) - 4} frames, but {count} in the block before"
                raise self.strange(path, problem, "as many frames", block[0].line)
            bodies |= block_bodies
            rate, count = number_in(block[0].cells[0]), len(block) - 4
        if not bodies:
            problem = "no block of " + listed([*_BODIES, *_MARKERS])
            raise self.strange(path, problem, "at least one", rows[0].line)
        time = np.arange(count) / rate if rate > 0 else None
        return Recording(path, bodies, time, "in the units of the file")

    def _bodies(
        self, path: Path, block: Sequence[TableRow], given: Given
    ) -> Iterator[tuple[str, Body]]:
        """Each name stands above its first column; units stand below the axes."""
        names, axes, units, data = block[1].cells, block[2].cells, block[3].cells, block[4:]
        starts = [k for k, name in enumerate(names) if name]
        for start, stop in pairwise([*starts, len(axes)]):
            name = names[start].removeprefix(_GLOBAL)
            at = {axes[k]: k for k in range(start, min(stop, len(axes)))}
            place = ("TX", "TY", "TZ") if "TX" in at else ("X", "Y", "Z")
            if not all(axis in at and at[axis] < len(units) for axis in place):
                continue
            unit = units[at[place[0]]]
            if unit not in LENGTH_UNITS:
                raise self.strange(path, f"lengths in {unit!r}", "mm or m", block[3].line)
            position, scale = [at[axis] for axis in place], LENGTH_UNITS[unit]
            if "RX" not in at:
                yield name, body_of(path, data, position, (), "", scale)
                continue
            turn = [at[axis] for axis in ("RX", "RY", "RZ", "RW") if axis in at]
            form = "xyzw" if "RW" in at else _quaternion_form(path, given, block[2].line)
            degrees = units[at["RX"]].startswith("deg") and form != "xyzw"
            angle = from_deg(1.0) if degrees else 1.0
            yield name, body_of(path, data, position, turn, form, scale, angle)


def _quaternion_form(path: Path, given: Given, line: int) -> str:
    """What RX, RY and RZ are: the file does not say."""
    if ROTATION not in given:
        problem = "RX, RY, RZ, which could be a rotation vector or Euler angles"
        expected = "the kind of rotation"
        hint = (
            "give --rotation vector (the default of Tracker and Nexus), or the order of the "
            "angles: --rotation XYZ|ZYX|…"
        )
        raise ForeignFileError(problem, expected, file=path, line=line, hint=hint)
    form = given.text(ROTATION)
    if form in ("xyzw", "wxyz", "rows", "columns"):
        raise given.refuse(ROTATION, form, "vector, or an order of Euler angles")
    return form


def _blocks(rows: Sequence[TableRow]) -> Iterator[tuple[str, Sequence[TableRow]]]:
    """Name of each block, and the rows below it."""
    starts = [k for k, row in enumerate(rows) if row.cells[0] in _BLOCKS and not any(row.cells[1:])]
    for start, stop in pairwise([*starts, len(rows)]):
        yield rows[start].cells[0], rows[start + 1 : stop]
