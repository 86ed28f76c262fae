"""Qualisys: the TSV that Qualisys Track Manager exports, bodies (6D) or markers (3D)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, Final

import numpy as np

from suta_calib.exchange.bodies import Body, Recording
from suta_calib.exchange.cells import TableRow
from suta_calib.exchange.cut_off import check_count
from suta_calib.exchange.instrument import InstrumentReader, body_of
from suta_calib.exchange.option import Given
from suta_calib.measurements.csv_table import number_in
from suta_calib.units import from_mm

# X Y Z, roll pitch yaw, residual, and nine numbers of a matrix, column after column.
_OF_BODY: Final = 16
_MATRIX: Final = 7
_OF_MARKER: Final = 3


class QualisysReader(InstrumentReader):
    """Bodies with their rotation matrices, or markers as points, in mm."""

    name: ClassVar[str] = "qualisys"
    summary: ClassVar[str] = "Qualisys: TSV of Track Manager, bodies (6D) or markers (3D)"
    example: ClassVar[str] = "run_6D.tsv --format qualisys --body probe --reference base"
    separator: ClassVar[str] = "\t"

    def recognises(self, path: Path, head: str) -> bool:
        """It begins with how many frames there are."""
        del path
        return head.startswith("NO_OF_FRAMES\t")

    def recording(self, path: Path, rows: Sequence[TableRow], given: Given) -> Recording:
        """Bodies or markers by name; frames in which one was not seen have none of it."""
        first = next((k for k, row in enumerate(rows) if _is_data(row)), len(rows))
        header = {row.cells[0]: row.cells[1:] for row in rows[:first]}
        names = [name for name in header.get("BODY_NAMES", ()) if name]
        width = _OF_BODY
        if not names:
            names, width = [name for name in header.get("MARKER_NAMES", ()) if name], _OF_MARKER
        data = rows[first:]
        if not names or not data:
            problem = "no BODY_NAMES and no MARKER_NAMES" if not names else "no frames"
            raise self.strange(path, problem, "an export with its header", rows[0].line)
        stated = number_in(next(iter(header.get("NO_OF_FRAMES", ())), ""))
        check_count(path, len(data), stated, "frames", given)
        # Frame and time may stand in front of what was measured.
        wide = max(len("\t".join(row.cells).rstrip("\t").split("\t")) for row in data)
        ahead = wide - width * len(names)
        if ahead < 0:  # the last body was never seen
            ahead = len(data[0].cells) - width * len(names)
        if not 0 <= ahead <= _AHEAD:
            problem = f"{wide} columns for {len(names)} of {width} each"
            raise self.strange(path, problem, "those, and at most frame and time", data[0].line)
        bodies: dict[str, Body] = {}
        for k, name in enumerate(names):
            start = ahead + k * width
            position = range(start, start + 3)
            # What was not seen is all zeros in older exports, and empty in newer ones.
            if width == _OF_MARKER:
                blank = [_unseen(row, start, start, start + _OF_MARKER) for row in data]
                bodies[name] = body_of(path, blank, position, (), "", from_mm(1.0))
                continue
            matrix = range(start + _MATRIX, start + _OF_BODY)
            blank = [_unseen(row, start, start + _MATRIX, start + _OF_BODY) for row in data]
            bodies[name] = body_of(path, blank, position, matrix, "columns", from_mm(1.0))
        rate = number_in(next(iter(header.get("FREQUENCY", ())), ""))
        time = np.arange(len(data)) / rate if rate > 0 else None
        return Recording(path, bodies, time, "in mm, as Track Manager exports them")


_AHEAD: Final = 2


def _is_data(row: TableRow) -> bool:
    return number_in(row.cells[0]) == number_in(row.cells[0])


def _unseen(row: TableRow, start: int, first: int, stop: int) -> TableRow:
    """The row, without the numbers from ``start`` on where those from ``first`` on are zero."""
    if any(number_in(cell) != 0.0 for cell in row.cells[first:stop]):
        return row
    gone = ("",) * (stop - start)
    return TableRow(row.line, (*row.cells[:start], *gone, *row.cells[stop:]))
