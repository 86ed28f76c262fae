"""NDI: CSV and TSV of ToolViewer, Track and the combined API's sample program."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from suta_calib.exchange.cells import TableRow, is_missing
from suta_calib.exchange.option import Given
from suta_calib.exchange.tracked_bodies import (
    Body,
    InstrumentReader,
    Recording,
    body_of,
    column_of_time,
)
from suta_calib.measurements.csv_table import number_in
from suta_calib.units import from_mm

_POSE: Final = ("q0", "qx", "qy", "qz", "tx", "ty", "tz")
_STATES: Final = ("state", "status", "transformstatus")
_NAMES: Final = ("toolinfo", "tool", "toolid", "tool id", "name")
_HANDLES: Final = ("porthandle", "toolhandle", "handle", "port")
_VALID_STATES: Final = frozenset({"ok", "valid", "enabled", "tracked", "00", "0x00", "visible"})


class NdiReader(InstrumentReader):
    """Tools as quaternions, scalar first, and positions in mm, several side by side."""

    name = "ndi"
    summary = "NDI: CSV or TSV of ToolViewer, Track or the combined API"
    example = "track.csv --format ndi --body 8700340 --reference 8700339"

    def recognises(self, path: Path, head: str) -> bool:
        """A header with Q0 … Tz behind one another, and the state of a tool."""
        del path
        for line in head.lower().splitlines():
            plain = line.replace("\t", ",").replace(" ", "")
            if ",".join(_POSE) in plain:
                return any(state in plain.split(",") for state in _STATES)
        return False

    def separator_of(self, text: str) -> str:
        """Tabs where the header has them."""
        return "\t" if "\t" in text[: text.lower().find("tz") + 2] else self.separator

    def recording(self, path: Path, rows: Sequence[TableRow], given: Given) -> Recording:
        """Tools by what the file calls them."""
        del given
        at = next((k for k, row in enumerate(rows) if _starts(row)), None)
        if at is None or at + 1 >= len(rows):
            problem = "no header with Q0, Qx, Qy, Qz, Tx, Ty, Tz, or no rows below it"
            raise self.strange(path, problem, "an export of tools", rows[0].line)
        header = [cell.lower() for cell in rows[at].cells]
        data = rows[at + 1 :]
        bodies: dict[str, Body] = {}
        before = 0
        for start in _starts(rows[at]):
            span = range(before, start)
            state = next((k for k in reversed(span) if header[k] in _STATES), None)
            name = _name(rows[at], data[0], header, span) or f"tool {len(bodies) + 1}"
            if name in bodies:
                name = f"{name} ({len(bodies) + 1})"
            rows_of_tool = [_without_missing(row, start, state) for row in data]
            quaternion, position = range(start, start + 4), range(start + 4, start + 7)
            bodies[name] = body_of(path, rows_of_tool, position, quaternion, "wxyz", from_mm(1.0))
            before = start + len(_POSE)
        seconds, fraction = (
            column_of_time(path, data, header.index(key) if key in header else None)
            for key in ("timespec_s", "timespec_ns")
        )
        time = None if seconds is None else seconds + (0.0 if fraction is None else 1e-9 * fraction)
        if time is None and "time" in header:
            time = column_of_time(path, data, header.index("time"))
        return Recording(path, bodies, time, "in mm, as NDI exports them")


def _starts(row: TableRow) -> list[int]:
    """Where Q0 … Tz begin in a header."""
    cells = tuple(cell.lower() for cell in row.cells)
    return [k for k in range(len(cells)) if cells[k : k + len(_POSE)] == _POSE]


def _name(header: TableRow, first: TableRow, small: Sequence[str], span: range) -> str:
    """What stands in the columns in front of a tool's pose, or above them."""
    for names in (_NAMES, _HANDLES):
        for k in reversed(span):
            if small[k] in names and k < len(first.cells) and not is_missing(first.cells[k]):
                return first.cells[k]
    # ToolViewer puts the name of the port itself into the header.
    return next((header.cells[k] for k in reversed(span) if small[k].startswith("port ")), "")


def _without_missing(row: TableRow, start: int, state: int | None) -> TableRow:
    """The row, without numbers of a tool that was not seen."""
    state_text = row.cells[state].lower() if state is not None and state < len(row.cells) else "ok"
    pose = row.cells[start : start + len(_POSE)]
    # What NDI's interface writes for a number that it does not have is beyond any place.
    nowhere = any(abs(number_in(cell)) > 1e12 for cell in pose)
    visible = state_text in _VALID_STATES and not nowhere
    return row if visible else row.without(start, start + len(_POSE))
