"""A stationary stream: readings of an arm nobody touches, from a file with a column ``time``.

What ``suta-calib track --csv`` (or ``--parquet``) and ``suta-calib measure --raw`` write, or any
CSV with a time in s and readings in rad (m for a prismatic joint).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError, did_you_mean
from suta_calib.extras import load
from suta_calib.measurements.csv_table import CsvTable, read_csv_table

LEAST_ROWS: Final = 100
# Columns of recordings that are no joints.
NO_JOINTS: Final = frozenset(
    (
        *("sequence", "time", "host_time", "arrival", "x", "y", "z", "qx", "qy", "qz", "qw"),
        *("std_x", "std_y", "std_z", "valid", "flags", "errors", "direction", "protocol"),
    )
)
_PARQUET: Final = (".parquet", ".pq")
_LARGEST_ANGLE: Final = 8 * np.pi


@dataclass(frozen=True, eq=False)
class Stream:
    """Readings over time.

    Attributes:
        path: the file.
        joints: names of the columns.
        time: (n,) s, increasing.
        readings: (n, joints) rad or m.
        dropped: rows left out, because they are not valid or carry an error flag.
    """

    path: Path
    joints: tuple[str, ...]
    time: FloatArray
    readings: FloatArray
    dropped: int

    @property
    def period(self) -> float:
        """Median time between readings, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def gaps(self) -> int:
        """How many steps in time are longer than one and a half periods."""
        return int(np.sum(np.diff(self.time) > 1.5 * self.period))


def read_stream(path: Path, joints: Sequence[str] = ()) -> Stream:
    """Read a stationary stream.

    Args:
        path: CSV, or Parquet by its name (``.parquet``).
        joints: columns to read; where none are given, all that hold numbers and are no column of
            a recording by another name.

    Raises:
        SamplesError: unreadable, no column ``time`` or no joint, a value that is not a number,
            readings that can only be degrees, time that does not increase, fewer than 100 rows.
        MissingExtraError: a Parquet file, and pyarrow is not installed.
    """
    table = _read_parquet(path) if path.suffix.lower() in _PARQUET else read_csv_table(path)
    names = tuple(joints) or tuple(n for n in table.columns if n not in NO_JOINTS)
    if not names:
        raise SamplesError(
            f"only the columns {', '.join(table.columns)}",
            "one column per joint, in rad",
            file=path,
        )
    kept = _kept(table)
    if len(kept.lines) < LEAST_ROWS:
        raise SamplesError(
            f"{len(kept.lines)} valid rows", f"at least {LEAST_ROWS}: some seconds", file=path
        )
    time = kept.numbers("time", "a column time, in s")
    for row in np.flatnonzero(np.diff(time) <= 0):
        found = f"{kept.columns['time'][row + 1]} after {kept.columns['time'][row]}"
        raise kept.refuse(int(row) + 1, "time", found, "time that increases", "one clock")
    readings = np.stack([kept.numbers(n, "one column per joint, in rad") for n in names], axis=1)
    for row, column in np.argwhere(np.abs(readings) > _LARGEST_ANGLE):
        value = f"{readings[row, column]:.6g}"
        hint = "looks like degrees or counts: convert it"
        raise kept.refuse(int(row), names[column], value, "rad", hint)
    return Stream(path, names, time, readings, len(table) - len(kept))


def _kept(table: CsvTable) -> CsvTable:
    """The rows that are valid and carry no error."""
    valid, errors = table.columns.get("valid"), table.columns.get("errors")
    rows = [
        row
        for row in range(len(table))
        if not (valid and valid[row].lower() in ("0", "false")) and not (errors and errors[row])
    ]
    if len(rows) == len(table):
        return table
    columns = {name: tuple(cells[row] for row in rows) for name, cells in table.columns.items()}
    return CsvTable(table.path, columns, table.header_line, tuple(table.lines[row] for row in rows))


def _read_parquet(path: Path) -> CsvTable:
    """A Parquet file as the table a CSV file would give; a row's number stands for its line."""
    arrow, parquet = load("pyarrow", "parquet"), load("pyarrow.parquet", "parquet")
    try:
        columns = parquet.read_table(path).to_pydict()
    except FileNotFoundError:
        raise SamplesError("no such file", "a file that exists", file=path) from None
    except (OSError, arrow.ArrowException) as problem:
        reason = str(problem).splitlines()[0]
        raise SamplesError(
            f"a file that is not whole Parquet ({reason})", "a Parquet file", file=path
        ) from None
    if "time" not in columns:
        raise SamplesError(
            f"only the columns {', '.join(columns)}",
            "a column time, in s",
            file=path,
            hint=did_you_mean("time", columns),
        )
    # `str` of a float is its shortest exact form.
    texts = {n: tuple("" if v is None else str(v) for v in vs) for n, vs in columns.items()}
    return CsvTable(path, texts, 1, tuple(range(1, len(texts["time"]) + 1)))
