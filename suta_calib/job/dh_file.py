"""Denavit-Hartenberg tables as CSV files: ``joint, type, theta_deg, d_mm, a_mm, alpha_deg``.

A modified table says so in its header, ``a_prev_mm, alpha_prev_deg``: its a and α stand before the
joint. Lengths may be in m (``d_m``) and angles in rad (``theta_rad``), column by column. ``type``
is ``revolute`` where it is missing; ``fixed`` rows are what stands before the first joint or
behind the last one.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Final, get_args

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError, UrdfError
from suta_calib.measurements.csv_table import CsvTable, read_csv_table
from suta_calib.model.dh import Convention, DhMotion, DhRow, DhTable
from suta_calib.units import Unit, key, shown, stored

_MOTIONS: Final = get_args(DhMotion)
# What a and α are called in a table of each convention.
_ALONG_X: Final[dict[Convention, tuple[str, str]]] = {
    "classic": ("a", "alpha"),
    "modified": ("a_prev", "alpha_prev"),
}


def read_dh_table(path: str | Path) -> DhTable:
    """Read a DH table of either convention; the header says of which.

    Args:
        path: a CSV file with a header row, as this module describes it.

    Raises:
        SamplesError: the file cannot be read, a column is missing or there in two units, a cell is
            no number or no type, or the columns are of both conventions.
        UrdfError: no row moves, or two joints have one name.
    """
    table = read_csv_table(Path(path))
    convention = _convention(table)
    a, alpha = _ALONG_X[convention]
    numbers = [
        _column(table, "theta", "rad"),
        _column(table, "d", "m"),
        _column(table, a, "m"),
        _column(table, alpha, "rad"),
    ]
    names = table.labels("joint", "a column with the joints' names")
    rows = tuple(
        DhRow(str(name), _motion(table, k), *(float(column[k]) for column in numbers))
        for k, name in enumerate(names)
    )
    try:
        return DhTable(convention, rows)
    except UrdfError as problem:
        raise UrdfError.of(problem, table.path, None) from None


def dh_text(table: DhTable) -> str:
    """A table as the CSV that `read_dh_table` reads, in mm and degrees, with all their digits.

    Args:
        table: of either convention.
    """
    columns: list[tuple[str, Unit]] = [("theta", "rad"), ("d", "m")]
    columns += zip(_ALONG_X[table.convention], ("m", "rad"), strict=True)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["joint", "type", *(key(name, unit) for name, unit in columns)])
    for row in table.rows:
        cells = zip((row.theta, row.d, row.a, row.alpha), columns, strict=True)
        numbers = [repr(float(shown(value, unit))) for value, (_, unit) in cells]
        writer.writerow([row.joint, row.motion, *numbers])
    return text.getvalue()


def _convention(table: CsvTable) -> Convention:
    names = set(table.columns)
    classic, modified = (
        {f"{stem}_{unit}" for stem in stems for unit in ("mm", "m", "deg", "rad")} & names
        for stems in _ALONG_X.values()
    )
    if classic and modified:
        raise SamplesError(
            f"the columns {min(classic)} and {min(modified)}",
            "a and alpha of one convention",
            file=table.path,
            line=table.header_line,
            hint="a_prev, alpha_prev: the link before the joint (modified); a, alpha: the next one",
        )
    return "modified" if modified else "classic"


def _column(table: CsvTable, name: str, unit: Unit) -> FloatArray:
    """A column in SI, whichever unit its name says."""
    in_si, in_shown = f"{name}_{unit}", key(name, unit)
    if in_si in table.columns and in_shown in table.columns:
        raise SamplesError(
            f"the columns {in_si} and {in_shown}",
            "one of them",
            file=table.path,
            line=table.header_line,
        )
    if in_si in table.columns:
        return table.numbers(in_si)
    return stored(table.numbers(in_shown, f"a column {in_shown} or {in_si}"), unit)


def _motion(table: CsvTable, row: int) -> DhMotion:
    if "type" not in table.columns:
        return "revolute"
    cell = table.cells("type")[row]
    for motion in _MOTIONS:
        if cell == motion:
            checked: DhMotion = motion
            return checked
    raise table.refuse(row, "type", repr(cell), ", ".join(_MOTIONS))
