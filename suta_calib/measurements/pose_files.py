"""CSV files of the closed problems: poses of a tool, pairs of poses, points.

Lengths are in m unless the columns are named ``…_mm``; unknown columns are ignored.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError, SutaCalibWarning
from suta_calib.measurements.csv_table import (
    CsvTable,
    position_sigma_columns,
    position_sigmas,
    positions,
    read_csv_table,
    rotations,
)
from suta_calib.units import from_mm, mm
from suta_calib.words import listed

# Typical distances that speak of the other unit: no tracker looks 30 m far, nor 3 mm only.
FAR: Final = 30.0
NEAR: Final = from_mm(3.0)
# A rigid body keeps its size: between these factors one of two sets is in another unit.
OTHER_UNIT: Final = (300.0, 3000.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class _PoseRows:
    """What was read from a file: lines (n,) of the rows in it, and what speaks of another unit."""

    path: Path
    lines: tuple[int, ...]
    unit_notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class ToolPoses(Displayable, _PoseRows):
    """``T_tracker_tool`` of a tool that pivots.

    Attributes:
        rotation: (n, 3, 3).
        position: (n, 3), m.
        point: (n,) label of the post touched; None where the file has no such column.
    """

    rotation: FloatArray
    position: FloatArray
    point: NDArray[np.str_] | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class PosePairs(_PoseRows):
    """``T_base_hand`` and ``T_eye_target``, row for row taken at the same time.

    Attributes:
        hand: rotations (n, 3, 3) and positions (n, 3), m.
        target: the same of the target in the eye.
        eye: (n,) label of the eye that saw it; None where the file has no such column.
        marks: (n,) label of the target that was seen; likewise.
    """

    hand: tuple[FloatArray, FloatArray]
    target: tuple[FloatArray, FloatArray]
    eye: NDArray[np.str_] | None = None
    marks: NDArray[np.str_] | None = None

    @property
    def several(self) -> bool:
        """Whether the rows name an eye or a target."""
        return self.eye is not None or self.marks is not None


@dataclass(frozen=True, eq=False, kw_only=True)
class HandPoses(Displayable, _PoseRows):
    """``T_base_hand`` with the picture that was taken there.

    Attributes:
        pose: rotations (n, 3, 3) and positions (n, 3), m.
        image: (n,) the picture's name.
        eye: (n,) label of the eye that took it; None where every eye may have taken one.
    """

    pose: tuple[FloatArray, FloatArray]
    image: NDArray[np.str_]
    eye: NDArray[np.str_] | None = None

    def of_eye(self, label: str) -> IntArray:
        """Rows of the pictures of an eye, (k,).

        Raises:
            SamplesError: there are none.
        """
        if self.eye is None:
            return np.arange(len(self.image), dtype=np.intp)
        rows = np.flatnonzero(self.eye == label)
        if not len(rows):
            names = listed([*dict.fromkeys(self.eye.tolist())])
            raise SamplesError(
                f"no row of eye {label}", f"one of {names}", file=self.path, where="column 'eye'"
            )
        return rows


@dataclass(frozen=True, eq=False, kw_only=True)
class ScanPoses(_PoseRows):
    """``T_base_hand`` with the profile of a line scanner that was taken there.

    Attributes:
        pose: rotations (n, 3, 3) and positions (n, 3), m.
        scan: (n,) the profile's name.
    """

    pose: tuple[FloatArray, FloatArray]
    scan: NDArray[np.str_]


@dataclass(frozen=True, eq=False, kw_only=True)
class PointSet(_PoseRows):
    """Points in one frame.

    Attributes:
        position: (n, 3), m.
        sigma: (n, 3) standard deviation of each coordinate that the file states, m; None where it
            states none.
    """

    position: FloatArray
    sigma: FloatArray | None = None


def _table(source: str | Path | CsvTable) -> CsvTable:
    return source if isinstance(source, CsvTable) else read_csv_table(Path(source))


def read_tool_poses(source: str | Path | CsvTable) -> ToolPoses:
    """Columns ``x,y,z,qx,qy,qz,qw``, and ``point`` where several posts were touched.

    Raises:
        SamplesError: unreadable, a column missing, a value that is none, a zero quaternion, both
            units of length, or fewer than three different rows.

    Warns:
        SutaCalibWarning: quaternions not of length 1, lengths that look like another unit, or
            rows that repeat another exactly.
    """
    table = _table(source)
    (rotation, position), notes = _poses(table)
    point = table.labels("point") if "point" in table.columns else None
    _check_different(table, position, rotation)
    return ToolPoses(**_read(table, notes), rotation=rotation, position=position, point=point)


def read_pose_pairs(source: str | Path | CsvTable) -> PosePairs:
    """Columns ``a_x,a_y,a_z,a_qx,a_qy,a_qz,a_qw`` and the same with ``b_``.

    And ``eye`` and ``target`` where several eyes looked, or at several targets.

    Raises, warns: as `read_tool_poses`.
    """
    table = _table(source)
    (hand, of_hand), (target, of_target) = _poses(table, "a_"), _poses(table, "b_")
    _check_different(table, *hand, *target)
    labels = (table.labels(n) if n in table.columns else None for n in ("eye", "target"))
    eye, marks = labels
    return PosePairs(
        **_read(table, of_hand + of_target), hand=hand, target=target, eye=eye, marks=marks
    )


def read_hand_poses(source: str | Path | CsvTable) -> HandPoses:
    """Columns ``a_x,a_y,a_z,a_qx,a_qy,a_qz,a_qw`` (or ``x,…``) and ``image``.

    And ``eye`` where every eye has rows, or names of pictures, of its own.

    Raises:
        SamplesError: as `read_tool_poses`, or a picture of an eye twice.

    Warns:
        SutaCalibWarning: as `read_tool_poses`.
    """
    table = _table(source)
    pose, notes = _poses(table, _prefix(table, "a_"))
    image = table.labels("image", "a column with the name of the picture taken at each pose")
    eye = table.labels("eye") if "eye" in table.columns else None
    first: dict[tuple[str, str], int] = {}
    eyes = [""] * len(image) if eye is None else eye.tolist()
    for row, key in enumerate(zip(image.tolist(), eyes, strict=True)):
        if key in first:
            problem = f"{key[0]!r} as in line {table.lines[first[key]]}"
            raise table.refuse(row, "image", problem, "each picture only once")
        first[key] = row
    of_eye = np.unique(eyes, return_inverse=True)[1].astype(float)
    _check_different(table, *pose, of_eye)
    return HandPoses(**_read(table, notes), pose=pose, image=image, eye=eye)


def read_scan_poses(source: str | Path | CsvTable) -> ScanPoses:
    """Columns ``x,y,z,qx,qy,qz,qw`` (or ``a_x,…``) and ``scan``.

    Raises:
        SamplesError: as `read_tool_poses`, or a scan twice.

    Warns:
        SutaCalibWarning: as `read_tool_poses`.
    """
    table = _table(source)
    pose, notes = _poses(table, _prefix(table, ""))
    scan = table.labels("scan", "a column with the name of the profile taken at each pose")
    first: dict[str, int] = {}
    for row, name in enumerate(scan.tolist()):
        if name in first:
            problem = f"{name!r} as in line {table.lines[first[name]]}"
            raise table.refuse(row, "scan", problem, "each scan only once")
        first[name] = row
    _check_different(table, *pose)
    return ScanPoses(**_read(table, notes), pose=pose, scan=scan)


def _prefix(table: CsvTable, otherwise: str) -> str:
    """What stands before the names of the hand's columns: ``a_``, or nothing."""
    there = [p for p in ("a_", "") if {f"{p}x", f"{p}x_mm"} & set(table.columns)]
    return there[0] if there else otherwise


def read_points(source: str | Path | CsvTable) -> PointSet:
    """Columns ``x,y,z`` in m, or ``x_mm,y_mm,z_mm``, and what is stated of their uncertainty.

    That is in columns ``sigma_x,sigma_y,sigma_z``, or one ``sigma`` of all three; m, or mm with
    ``_mm`` after their names.

    Raises:
        SamplesError: unreadable, a column missing, a value that is none, both units of length, or
            a standard deviation that is not positive.

    Warns:
        SutaCalibWarning: lengths that look like another unit.
    """
    table = _table(source)
    return _points(table, positions(table))


def read_corresponding_points(
    source_a: str | Path | CsvTable, source_b: str | Path | CsvTable
) -> tuple[PointSet, PointSet]:
    """Two files of points whose rows correspond.

    Raises:
        SamplesError: as `read_points`; numbers of rows that differ, fewer than three different
            points, or sizes that differ as much as millimetres and metres do.

    Warns:
        SutaCalibWarning: lengths that look like another unit.
    """
    tables = [_table(source_a), _table(source_b)]
    both = [positions(table) for table in tables]
    a, b = tables
    if len(a) != len(b):
        raise SamplesError(
            _rows(len(b)),
            f"{len(a)} rows, as in {a.path}, because the rows belong together",
            file=b.path,
        )
    for table, points in zip(tables, both, strict=True):
        _count_different(table, points, "points")
    (smaller, _), (larger, file) = sorted(
        (_size(points), table.path) for table, points in zip(tables, both, strict=True)
    )
    ratio = larger / smaller if smaller else 1.0
    if OTHER_UNIT[0] < ratio < OTHER_UNIT[1]:
        other = a.path if file == b.path else b.path
        raise SamplesError(
            f"points {ratio:.0f} times as far apart as in {other}",
            "the same distances in both: lengths are m, or mm in columns x_mm, y_mm, z_mm",
            file=file,
            hint="one of the files is in another unit than its column names",
        )
    return _points(a, both[0]), _points(b, both[1])


def _read(table: CsvTable, notes: tuple[str, ...]) -> dict[str, Any]:
    return {"path": table.path, "lines": table.lines, "unit_notes": notes}


def _points(table: CsvTable, position: FloatArray) -> PointSet:
    stated = any(name in table.columns for name in position_sigma_columns())
    sigma = position_sigmas(table) if stated else None
    return PointSet(**_read(table, _hint_at_unit(table, position)), position=position, sigma=sigma)


def _poses(
    table: CsvTable, prefix: str = ""
) -> tuple[tuple[FloatArray, FloatArray], tuple[str, ...]]:
    position = positions(table, prefix)
    notes = _hint_at_unit(table, position, prefix) or _hint_at_other_file(table, position, prefix)
    return (rotations(table, prefix), position), notes


def _hint_at_unit(table: CsvTable, positions: FloatArray, prefix: str = "") -> tuple[str, ...]:
    """Warn where lengths look like another unit, and say so to whoever judges the answer."""
    in_mm = f"{prefix}x_mm" in table.columns
    first = f"{prefix}x_mm" if in_mm else f"{prefix}x"
    distance = float(np.median(np.linalg.norm(positions, axis=1)))
    if not in_mm and distance > FAR:
        guess, other = f"{distance:.0f} m away; looks like millimetres", "_mm"
    elif in_mm and 0.0 < distance < NEAR:
        guess, other = f"{mm(distance):.2g} mm away; looks like metres", ""
    else:
        return ()
    columns = ", ".join(f"{prefix}{axis}{other}" for axis in "xyz")
    note = (
        f"{table.path}:{table.header_line}: column {first!r}: found positions about {guess}: "
        f"name the columns {columns}"
    )
    _warn(note)
    return (f"{note}.",)


def _hint_at_other_file(table: CsvTable, positions: FloatArray, prefix: str) -> tuple[str, ...]:
    """The same of lengths in m that are too small: another program's metres, read as mm."""
    distance = float(np.median(np.linalg.norm(positions, axis=1)))
    if f"{prefix}x_mm" in table.columns or not 0.0 < distance < NEAR:
        return ()
    note = (
        f"{table.path}: found positions about {mm(distance):.2g} mm away, nearer than a tracker or "
        "a camera can see. If metres were read as mm, multiply the file's positions by 1000"
    )
    _warn(note)
    return (f"{note}.",)


def _check_different(table: CsvTable, *parts: FloatArray) -> None:
    """Refuse poses that are all copies of one or two; warn about copies."""
    numbers = np.hstack([part.reshape(len(table), -1) for part in parts])
    copies = len(table) - _count_different(table, numbers, "poses")
    if copies:
        _warn(
            f"{table.path}: found {_rows(copies)} that repeat another exactly. The recording may "
            "have stopped. They are counted as independent measurements, which makes ± too small"
        )


def _count_different(table: CsvTable, numbers: FloatArray, what: str) -> int:
    # Different rows that any of these problems needs.
    least_rows = 3
    # Of many rows few have a number in common, and sorting numbers takes a tenth of sorting rows.
    repeated = numbers
    for k in range(numbers.shape[1]):
        _, which, times = np.unique(repeated[:, k], return_inverse=True, return_counts=True)
        repeated = repeated[times[which] > 1]
    different = len(table) - len(repeated) + len(np.unique(repeated, axis=0))
    if len(table) >= least_rows > different:
        raise SamplesError(
            f"{_rows(len(table))}, of which all but {different} repeat another",
            f"at least {least_rows} different {what}",
            file=table.path,
        )
    return different


def _size(points: FloatArray) -> float:
    """Typical distance from the middle, whatever a few rows say."""
    return float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))


def _rows(count: int) -> str:
    return f"{count} row" if count == 1 else f"{count} rows"


def _warn(message: str) -> None:
    # The reader's caller is who gave the file; the command line shows only the message.
    warnings.warn(message, SutaCalibWarning, stacklevel=5)
