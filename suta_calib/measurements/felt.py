"""What accelerometers on links felt: columns of a samples file, and which rows are at rest."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.measurements.csv_table import CsvTable, number_in

Three = tuple[str, str, str]
# Zero errors and scales of cheap sensors change what is felt at rest by a few per cent.
_AT_REST: Final = 0.08
_FIRST: Final = re.compile(
    r"(?:^|[_.\s])(?:a|acc|accel|acceleration|accelerometer|gravity)[_.]?x$", re.IGNORECASE
)


def accelerations(table: CsvTable, names: Three) -> FloatArray:
    """(n, 3) what one felt, in the unit of its columns; zeros in rows that leave a cell empty.

    Raises:
        SamplesError: no such column, or a cell with something else than a finite number.
    """
    expected = f"the columns {', '.join(names)} of an accelerometer"
    cells = [table.cells(name, expected) for name in names]
    vectors = np.array([[*map(number_in, column)] for column in cells])
    empty = np.array([[cell.lower() in ("", "nan") for cell in column] for column in cells])
    for k, row in np.argwhere(~np.isfinite(vectors) & ~empty):
        number = "a finite number, or nothing where the sensor has no reading"
        raise table.refuse(int(row), names[k], repr(cells[k][row]), number)
    vectors[:, empty.any(axis=0)] = 0.0
    return vectors.T.copy()


def at_rest(vectors: FloatArray) -> BoolArray:
    """(n,) where an accelerometer felt as much as in most rows: gravity alone."""
    length = np.linalg.norm(vectors, axis=1)
    felt = length > 0
    usual = float(np.median(length[felt])) if felt.any() else 1.0
    return np.asarray(felt & (np.abs(length / usual - 1.0) <= _AT_REST))


def unlike_gravity(length: float, usual: float) -> str:
    """Why one that usually feels so much felt something else than gravity; empty where not."""
    ratio = length / usual
    return "" if abs(ratio - 1.0) <= _AT_REST else _why(ratio)


def _why(ratio: float) -> str:
    # From m/s² to g, or back, is a factor of ten; nothing at rest is off by a half.
    if not 0.5 < ratio < 2.0:
        return "Are g and m/s² mixed?"
    return "The sensor moved or shook: let it rest."


def up_felt(vectors: FloatArray) -> FloatArray:
    """(n, 3) of unit length where an accelerometer was at rest, zeros elsewhere."""
    rest = at_rest(vectors)
    length = np.linalg.norm(vectors, axis=1)
    return np.where(rest[:, None], vectors / np.where(rest, length, 1.0)[:, None], 0.0)


def averaged(up: FloatArray, rests: IntArray) -> FloatArray:
    """(n, 3) mean of each rest, for all of its rows; zeros where none of them has a reading.

    Args:
        up: (n, 3) as of `up_felt`.
        rests: (n,) one number, from 0, for rows that were read while nothing moved.
    """
    sums = np.stack([np.bincount(rests, column) for column in up.T], axis=1)
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return (sums / np.where(length > 0, length, 1.0))[rests]


def look_like_accelerometers(tables: Sequence[CsvTable], taken: Collection[str]) -> Iterator[Three]:
    """Columns of all files that are called as an accelerometer's, and felt gravity in most rows."""
    for first in tables[0].columns:
        if not _FIRST.search(first):
            continue
        x, y, z = (first[:-1] + chr(ord(first[-1]) + k) for k in range(3))
        there = all(name in table.columns for name in (x, y, z) for table in tables)
        if not there or not {x, y, z}.isdisjoint(taken):
            continue
        try:
            felt = np.concatenate([accelerations(table, (x, y, z)) for table in tables])
        except SamplesError:
            continue
        # Share of the rows that an arm which is measured at rest has in any case.
        if np.mean(at_rest(felt)) > 0.9:
            yield x, y, z


def rows_not_used(name: str, vectors: FloatArray, origin: Sequence[str]) -> Iterator[str]:
    """In sentences, rows in which one has no reading, or felt other than gravity."""
    rest, length = at_rest(vectors), np.linalg.norm(vectors, axis=1)
    missing, moved = np.flatnonzero(length == 0), np.flatnonzero((length > 0) & ~rest)
    usual = float(np.median(length[rest])) if rest.any() else 1.0
    without = "There the link stands as the model has it."
    if len(missing):
        yield (
            f"{len(missing)} of {len(vectors)} rows ({origin[missing[0]]} is the first) have no "
            f"reading of {name}. {without}"
        )
    if len(moved):
        yield (
            f"In {len(moved)} of {len(vectors)} rows ({origin[moved[0]]} is the first) {name} "
            f"felt other than gravity: {length[moved[0]] / usual:.3g} times as much as in most. "
            f"{_why(length[moved[0]] / usual)} These readings are not used. {without}"
        )
