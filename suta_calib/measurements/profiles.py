"""Profiles of a line scanner: ``profiles.csv``, columns scan, x, z (m) or scan, x_mm, z_mm."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.measurements.csv_table import CsvTable, read_csv_table
from suta_calib.measurements.files import write_text
from suta_calib.units import from_mm, mm

# No laser line is so long, and no scanner sees so far, m.
LONGEST: Final = 5.0
# How cells of a point without a reading look, in lower case.
_NOTHING: Final = frozenset({"", "nan", "null", "none", "inf", "-inf"})


@dataclass(frozen=True, eq=False)
class Profiles(Displayable):
    """Points of the surface that a line scanner saw, in its plane y = 0. Immutable.

    Attributes:
        scan: (n,) name of the profile that each point belongs to.
        point: (n, 2) x along the line and z along the beam, m.
        path: the file they were read from, or None.
    """

    scan: NDArray[np.str_]
    point: FloatArray
    path: Path | None = None

    def __len__(self) -> int:
        return len(self.scan)

    def by_scan(self) -> dict[str, FloatArray]:
        """Points (k, 2) of every profile, in the order of the rows, by first appearance."""
        names, first, which = np.unique(self.scan, return_index=True, return_inverse=True)
        order = np.argsort(which, kind="stable")
        parts = np.split(self.point[order], np.cumsum(np.bincount(which))[:-1])
        return {str(names[k]): parts[k] for k in np.argsort(first)}


def profiles_of(scan: ArrayLike, point: ArrayLike) -> Profiles:
    """Profiles from arrays: (n,) names and (n, 2) points, m; points without a reading left out."""
    names, points = np.asarray(scan, dtype=np.str_), np.asarray(point, dtype=float)
    if points.shape != (len(names), 2):
        shapes = f"shapes {names.shape}, {points.shape}"
        raise SamplesError(shapes, "(n,), (n, 2)", where="profiles")
    return _checked(names, points, None)


def read_profiles(path: str | Path) -> Profiles:
    """Read ``profiles.csv``; other columns are ignored.

    A scanner writes empty cells, NaN, or x and z of zero where it saw nothing: such points are left
    out.

    Raises:
        SamplesError: unreadable, a column missing, one length in m and the other in mm, a cell
            that is no number, or points farther away than a scanner sees.
    """
    table = read_csv_table(Path(path))
    scan = table.labels("scan", "a column with the name of the profile")
    given = [name for name in ("x", "z", "x_mm", "z_mm") if name in table.columns]
    if given not in (["x", "z"], ["x_mm", "z_mm"]):
        raise SamplesError(
            f"the columns {', '.join(given) or 'scan only'}",
            "x and z in m, or x_mm and z_mm in mm",
            file=table.path,
            line=table.header_line,
            where="columns of the points",
            hint="a scanner's points are in its plane: x along the line, z along the beam",
        )
    points = np.column_stack([_numbers(table, name) for name in given])
    return _checked(scan, from_mm(points) if given[0] == "x_mm" else points, table.path)


def _numbers(table: CsvTable, name: str) -> FloatArray:
    """One column, NaN where a cell says that nothing was seen."""
    cells = table.cells(name)
    if not any(cell.lower() in _NOTHING for cell in cells):
        return table.numbers(name)
    written = np.array([cell.lower() not in _NOTHING for cell in cells])
    values = np.full(len(cells), np.nan)
    columns = {name: tuple(cell for cell, there in zip(cells, written, strict=True) if there)}
    lines = tuple(line for line, there in zip(table.lines, written, strict=True) if there)
    values[written] = CsvTable(table.path, columns, table.header_line, lines).numbers(name)
    return values


def _checked(scan: NDArray[np.str_], point: FloatArray, path: Path | None) -> Profiles:
    """The points that were seen, of a size that they can have."""
    valid = np.isfinite(point).all(axis=1) & point.any(axis=1)
    if not valid.any():
        raise SamplesError("no point", "points x, z of what was seen", file=path, where="profiles")
    scan, point = scan[valid], point[valid]
    if (largest := float(np.abs(point).max())) > LONGEST:
        row = int(np.argmax(np.abs(point).max(axis=1)))
        raise SamplesError(
            f"a point {largest:.4g} m from the scanner, in scan {scan[row]}",
            f"points within {LONGEST:g} m",
            file=path,
            where="profiles",
            hint="columns x and z are in m; are the numbers in mm? Then name them x_mm and z_mm",
        )
    # Nor so short: all points nearer to the scanner than this, m, are metres read as mm.
    if largest < 1e-3:
        raise SamplesError(
            f"all points within {mm(largest):.2g} mm of the scanner",
            "a line of centimetres",
            file=path,
            where="profiles",
            hint="columns x_mm and z_mm are in mm; are the numbers in m? Then name them x and z",
        )
    return Profiles(scan, point, path)


def profiles_text(profiles: Profiles) -> str:
    """Content of ``profiles.csv``, in mm to a tenth of a micrometre."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("scan", "x_mm", "z_mm"))
    for scan, (x, z) in zip(profiles.scan, mm(profiles.point), strict=True):
        writer.writerow([scan, f"{x:.4f}", f"{z:.4f}"])
    return text.getvalue()


def write_profiles(path: Path, profiles: Profiles) -> None:
    """Write ``profiles.csv``: `profiles_text`.

    Raises:
        OutputError: the file cannot be written; what was there is untouched.
    """
    write_text(path, profiles_text(profiles))
