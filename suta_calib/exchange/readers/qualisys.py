"""Qualisys: the TSV that Qualisys Track Manager exports, bodies (6D) or markers (3D)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from suta_calib.exchange.cells import TableRow
from suta_calib.exchange.option import Given
from suta_calib.exchange.tracked_bodies import Body, InstrumentReader, Recording, body_of
from suta_calib.exchange.truncated import check_count
from suta_calib.measurements.csv_table import number_in
from suta_calib.units import from_mm


class QualisysReader(InstrumentReader):
    """Bodies with their rotation matrices, or markers as points, in mm."""

    name = "qualisys"
    summary = "Qualisys: TSV of Track Manager, bodies (6D) or markers (3D)"
    example = "run_6D.tsv --format qualisys --body probe --reference base"
    signature = re.compile(r"\ANO_OF_FRAMES\t")
    separator = "\t"

    def recording(self, path: Path, rows: Sequence[TableRow], given: Given) -> Recording:
        """Bodies or markers by name; frames in which one was not seen have none of it."""
        first = next((k for k, row in enumerate(rows) if _is_data(row)), len(rows))
        header = {row.cells[0]: row.cells[1:] for row in rows[:first]}
        names = [name for name in header.get("BODY_NAMES", ()) if name]
        # X Y Z, roll pitch yaw, residual, and nine numbers of a matrix, column after column.
        width, matrix = 16, 7
        if not names:
            names, width = [name for name in header.get("MARKER_NAMES", ()) if name], 3
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
        if not 0 <= ahead <= 2:
            problem = f"{wide} columns for {len(names)} bodies or markers of {width} columns each"
            raise self.strange(
                path, problem, "exactly these, and at most frame and time", data[0].line
            )
        bodies: dict[str, Body] = {}
        for k, name in enumerate(names):
            start = ahead + k * width
            turned = range(start + matrix, start + width)
            # What was not seen is all zeros in older exports, and empty in newer ones.
            shown = turned or range(start, start + width)
            rows_of_body = [
                row
                if any(number_in(cell) != 0.0 for cell in row.cells[shown.start : shown.stop])
                else row.without(start, start + width)
                for row in data
            ]
            place, form = range(start, start + 3), "columns" if turned else ""
            bodies[name] = body_of(path, rows_of_body, place, turned, form, from_mm(1.0))
        rate = number_in(next(iter(header.get("FREQUENCY", ())), ""))
        time = np.arange(len(data)) / rate if rate > 0 else None
        return Recording(path, bodies, time, "in mm, as Track Manager exports them")


def _is_data(row: TableRow) -> bool:
    return number_in(row.cells[0]) == number_in(row.cells[0])
