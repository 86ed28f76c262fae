"""Samples from CSV files and back: one column per joint, plus what the observation needs."""

from __future__ import annotations

import csv
import io
import math
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from suta_calib.arguments import checked
from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError, SutaCalibWarning
from suta_calib.geometry.numbers import quaternion_from_rotation
from suta_calib.measurements.csv_table import (
    SIGMAS,
    CsvTable,
    NumberColumn,
    has_rotations,
    numbers,
    position_columns,
    position_sigma_columns,
    position_sigmas,
    positions,
    read_csv_table,
    rotation_columns,
    rotations,
)
from suta_calib.measurements.felt import Three, accelerations, look_like_accelerometers
from suta_calib.measurements.files import write_text
from suta_calib.measurements.samples import STROKE, TEMPERATURES, Samples
from suta_calib.units import FARTHEST

TEMPERATURE = "temperature"
# Of the rows of a recording in motion, s.
TIME = "time"
# What the tip carries: a mass, and where its centre is in the frame of the tip.
PAYLOAD = "payload_kg"
PAYLOAD_PLACE = tuple(NumberColumn(f"payload_{axis}", "m") for axis in "xyz")


@dataclass(frozen=True)
class JointRange(Displayable):
    """What is known of a joint before its readings are read.

    Attributes:
        name: the joint's name, which is also its column's.
        unit: ``rad``, or ``m`` for a prismatic joint.
        lower: lower limit in that unit, -inf where there is none.
        upper: upper limit in that unit, inf where there is none.
        followers: joints of the chain without a column of their own, which follow this reading.
        optional: whether it is zero where the file has no such column: of another chain, which only
            hangs on this one's joints.
        short: what its column may be called too; empty for nothing else.
    """

    name: str
    unit: Literal["rad", "m"]
    lower: float
    upper: float
    followers: tuple[str, ...] = ()
    optional: bool = False
    short: str = ""

    @property
    def called(self) -> tuple[str, ...]:
        """What its column may be called, but for a unit."""
        return (self.name, self.short) if self.short else (self.name,)

    def __str__(self) -> str:
        return f"[{self.lower:.4g}, {self.upper:.4g}] {self.unit}"


@dataclass(frozen=True)
class SampleColumns(Displayable):
    """Columns that a kind of observation needs beside the joints.

    Attributes:
        labels: label columns, such as ``("placement", "repeat", "landmark")``.
        optional_labels: label columns that are read where every file has them.
        common_labels: label columns that all the files have, or none of them.
        numbers: columns of measured lengths, angles and plain numbers.
        pixels: whether points of a board are seen in pictures, which have a file of their own.
        time: whether ``time``, s, is read.
        position: whether ``x, y, z`` (m), or ``x_mm, y_mm, z_mm``, are required.
        position_sigma: whether their standard deviations, ``sigma_x, sigma_y, sigma_z`` or one
            ``sigma`` (m, or in mm with ``_mm``), are read; all the files have them, or none.
        orientation: whether ``qx, qy, qz, qw`` are read.
        about: what each of them holds, by its name, or by ``x, y, z`` and ``qx, qy, qz, qw``.
    """

    labels: tuple[str, ...] = ()
    position: bool = False
    position_sigma: bool = False
    orientation: Literal["none", "optional", "required"] = "none"
    optional_labels: tuple[str, ...] = ()
    common_labels: tuple[str, ...] = ()
    numbers: tuple[NumberColumn, ...] = ()
    about: Mapping[str, str] = field(default_factory=dict)
    pixels: bool = False
    time: bool = False


@checked
def read_samples(
    paths: str | Path | Sequence[str | Path],
    joints: Sequence[JointRange],
    columns: SampleColumns,
    felt: Sequence[Three] = (),
) -> Samples:
    """Read one or more samples CSV files into one `Samples`.

    Args:
        paths: the file, or the files in the order their rows shall have.
        joints: the joints of the chain, base to tip; the order of the columns of ``q``.
        columns: what else is needed; every other column is ignored, but ``JOINT.direction``, where
            all files have it: from which side that joint came; ``temperature``, °C; ``payload_kg``
            and ``payload_x, payload_y, payload_z``, m (or in mm with ``_mm``): what the tip
            carries, and where in its frame. All files have such a column or none. Where all have
            ``time``, s, each file is a recording in motion. Rows of one file with the same value of
            ``stroke`` err together (`Term.clusters`); without one, a row is by itself. A joint's
            readings may be in degrees or mm where its column says so: ``JOINT_deg``, ``JOINT_mm``.
        felt: columns of accelerometers on links, x, y and z; a row may leave them empty. Columns
            that look like another one, such as ``NAME_ax, NAME_ay, NAME_az``, are read too.

    Warns:
        SutaCalibWarning: quaternions that are more than 1 % away from unit length; readings of a
            prismatic joint that are far beyond its range; a file without rows beside others.

    Raises:
        SamplesError: a file cannot be read, lacks a column, holds a value that is not a finite
            number or an empty label, has a reading that looks like degrees or millimetres or is
            whole turns beyond its range, or only some of the files have orientations.
    """
    given = [Path(path) for path in ([paths] if isinstance(paths, str | Path) else paths)]
    if not given:
        raise SamplesError("no files", "at least one samples file")
    paths = _filled(given)
    check_joint_names([joint.name for joint in joints], columns)
    tables = [read_csv_table(path) for path in paths]
    there = [n for n in columns.optional_labels if all(n in table.columns for table in tables)]
    there += [name for name in columns.common_labels if _everywhere(tables, name)]
    names = {j.name for j in joints}
    # A column that need not be there, and has the name of a joint, holds that joint's readings.
    there_too = [
        n
        for n in columns.numbers
        if n.required or (names.isdisjoint(n.names) and _everywhere(tables, *n.names))
    ]
    columns = replace(columns, labels=(*columns.labels, *there), numbers=tuple(there_too))
    for joint in joints:
        if joint.optional:
            _everywhere(tables, *NumberColumn(joint.name, joint.unit).names)
    tables = [_with_full_names(table, joints) for table in tables]
    with_direction = {
        j.name for j in joints if all(_direction(j.name) in t.columns for t in tables)
    }
    warm = TEMPERATURE not in names and _everywhere(tables, TEMPERATURE)
    timed = _are_timed(tables, names | {*columns.labels, *(c.name for c in columns.numbers)})
    loaded = _payload_columns(tables, names)
    taken = {*names, *(name for number in columns.numbers for name in number.names)}
    taken |= {name for three in felt for name in three}
    felt = [*felt, *look_like_accelerometers(tables, taken)]
    weighed = columns.position_sigma and _everywhere(tables, *position_sigma_columns())
    columns = replace(columns, position_sigma=weighed)
    parts = [
        replace(
            _samples(table, joints, columns, with_direction, warm, loaded, timed),
            felt={",".join(three): accelerations(table, three) for three in felt},
        )
        for table in tables
    ]
    if STROKE not in names and any(STROKE in table.columns for table in tables):
        parts = [_with_strokes(p, t) for p, t in zip(parts, tables, strict=True)]
    for path, part in zip(paths, parts, strict=True):
        if (part.rotation is None) != (parts[0].rotation is None):
            with_, without = (path, paths[0]) if parts[0].rotation is None else (paths[0], path)
            raise SamplesError(
                f"no orientation, although {with_} has one",
                "the columns qx, qy, qz, qw in all of these files or in none",
                file=without,
            )
    samples = Samples.concatenate(parts)
    _tell_of_slides(samples, joints)
    return samples


def has_readings(path: Path, joints: Sequence[JointRange]) -> bool:
    """Whether a samples file has a column for each of these joints that it must have."""
    columns = read_csv_table(path).columns
    return all(
        any(n in columns for name in joint.called for n in NumberColumn(name, joint.unit).names)
        for joint in joints
        if not joint.optional
    )


def _filled(paths: list[Path]) -> list[Path]:
    """The files without those that hold a header only, where another one holds samples.

    A new job begins with such a file, and samples may be added beside it.
    """
    filled = [path for path in paths if not has_no_rows(path)] if len(paths) > 1 else paths
    if not filled:
        return paths
    for path in paths:
        if path not in filled:
            found = "a header without data; the other files of the same row are read"
            warnings.warn(f"{path}: found {found}", SutaCalibWarning, stacklevel=3)
    return filled


def has_no_rows(path: Path) -> bool:
    """Whether a samples file holds a header and no data, as a new job's begin."""
    if not path.is_file():
        return False  # a pipe can be read once
    try:
        with path.open(encoding="utf-8-sig") as file:
            lines = list(islice((line for line in file if line.strip()), 2))
    except (OSError, UnicodeDecodeError):
        return False
    return len(lines) == 1 and not lines[0].startswith("#")


def has_column(path: Path, name: str) -> bool:
    """Whether a samples file has a column of this name."""
    return name in read_csv_table(path).columns


def _tell_of_slides(samples: Samples, joints: Sequence[JointRange]) -> None:
    """Warn of a prismatic joint that is read where it cannot have been, unless its zero is else."""
    for joint, q in zip(joints, samples.q.T, strict=True):
        width = joint.upper - joint.lower
        if joint.unit == "rad" or not 0.0 < width < math.inf:
            continue
        beyond = np.maximum(joint.lower - q, q - joint.upper)
        # So far beyond its range, in units of it, that no zero which is set a little otherwise puts
        # it there. A revolute joint's may be anywhere on its turn.
        rows = np.flatnonzero(beyond > 0.5 * width)
        if len(rows):
            warnings.warn(
                f"{samples.origin[rows[0]]}: found {q[rows[0]]:.4g} m for {joint.name}; expected "
                f"its range {joint}. {len(rows)} of {len(q)} samples are beyond it, by up to "
                f"{beyond.max():.3g} m. Check whether the column belongs to another joint, is in "
                "another unit, or has another zero. The values are used unchanged",
                SutaCalibWarning,
                stacklevel=3,
            )


def _samples(
    table: CsvTable,
    joints: Sequence[JointRange],
    columns: SampleColumns,
    with_direction: Collection[str],
    warm: bool,
    loaded: tuple[NumberColumn, ...],
    timed: bool,
) -> Samples:
    oriented = columns.orientation == "required" or (
        columns.orientation == "optional" and has_rotations(table)
    )
    needed = f"a label column; this kind needs {', '.join(columns.labels)}"
    return Samples.from_arrays(
        [joint.name for joint in joints],
        _readings(table, joints),
        labels={name: table.labels(name, needed) for name in columns.labels},
        numbers={column.name: numbers(table, column) for column in columns.numbers},
        position=positions(table) if columns.position else None,
        rotation=rotations(table) if oriented else None,
        origin=table.origin,
        direction=_directions(table, joints, with_direction) if with_direction else None,
        temperature=_temperatures(table) if warm else None,
        position_sigma=position_sigmas(table) if columns.position_sigma else None,
        payload=_payloads(table, loaded) if loaded else None,
        time=table.numbers(TIME, "a column time, in s, of a moving arm")
        if columns.time or timed
        else None,
    )


def _with_strokes(samples: Samples, table: CsvTable) -> Samples:
    """The samples with their strokes, each told from those of other files."""
    cells = table.columns.get(STROKE, ("",) * len(table))
    strokes = [
        f"{table.path}/{cell}" if cell else origin
        for cell, origin in zip(cells, samples.origin, strict=True)
    ]
    return replace(samples, labels={**samples.labels, STROKE: np.array(strokes, dtype=np.str_)})


def _are_timed(tables: Sequence[CsvTable], taken: Collection[str]) -> bool:
    """Whether all rows have a time in s, as those of recordings do; a date of a touch is none."""
    if TIME in taken or not all(TIME in table.columns for table in tables):
        return False
    try:
        return all(np.isfinite(table.numbers(TIME, "s")).all() for table in tables)
    except SamplesError:
        return False


def _payload_columns(tables: Sequence[CsvTable], joints: set[str]) -> tuple[NumberColumn, ...]:
    """The columns of what the tip carries: none, the mass, or the mass and its place."""
    mass = NumberColumn(PAYLOAD)
    if joints & {PAYLOAD, *(name for column in PAYLOAD_PLACE for name in column.names)}:
        return ()
    loaded = _everywhere(tables, PAYLOAD)
    placed = [_everywhere(tables, *column.names) for column in PAYLOAD_PLACE]
    if (any(placed) and not loaded) or len({*placed}) > 1:
        needed = (PAYLOAD, *(column.names[-1] for column in PAYLOAD_PLACE))
        there = [n for n in tables[0].columns if n.startswith("payload_")]
        raise SamplesError(
            f"only the columns {', '.join(there)} of what the tip carries",
            f"{PAYLOAD} alone, or {', '.join(needed)}",
            file=tables[0].path,
            line=tables[0].header_line,
        )
    return (mass, *PAYLOAD_PLACE) if all(placed) else (mass,) if loaded else ()


def _payloads(table: CsvTable, columns: Sequence[NumberColumn]) -> FloatArray:
    """(n, 4) kg, and the place in the frame of the tip, m: its origin where no column says."""
    payload = np.zeros((len(table), 4))
    for k, column in enumerate(columns):
        payload[:, k] = numbers(table, column)
    for row in np.flatnonzero(payload[:, 0] < 0):
        raise table.refuse(int(row), PAYLOAD, f"{payload[row, 0]:g}", "a mass in kg, 0 or more")
    for row, k in np.argwhere(np.abs(payload[:, 1:]) > FARTHEST):
        found = f"{payload[row, k + 1]:g} m"
        raise table.refuse(int(row), columns[k + 1].name, found, f"a place within {FARTHEST:g} m")
    return payload


def _temperatures(table: CsvTable) -> FloatArray:
    """(n,) °C, refused where no arm could be so cold or so hot."""
    low, high = TEMPERATURES
    expected = f"°C, from {low:g} to {high:g}"
    temperatures = table.numbers(TEMPERATURE, expected)
    for row in np.flatnonzero((temperatures < low) | (temperatures > high)):
        hint = "looks like kelvin: subtract 273.15" if temperatures[row] > high else ""
        raise table.refuse(int(row), TEMPERATURE, f"{temperatures[row]:.6g}", expected, hint)
    return temperatures


def _direction(joint: str) -> str:
    """The column that says from which side a joint came, as its last motion went."""
    return f"{joint}.direction"


def _directions(
    table: CsvTable, joints: Sequence[JointRange], with_direction: Collection[str]
) -> FloatArray:
    """(n, joints) of -1, 0 and 1; 0 for a joint of which nothing is said."""
    directions = np.zeros((len(table), len(joints)))
    for k, joint in enumerate(joints):
        if joint.name not in with_direction:
            continue
        expected = "1 (it came from smaller readings), -1 (from larger ones) or 0 (not known)"
        directions[:, k] = table.numbers(_direction(joint.name), expected)
        for row in np.flatnonzero(~np.isin(directions[:, k], (-1.0, 0.0, 1.0))):
            value = f"{directions[row, k]:.6g}"
            raise table.refuse(int(row), _direction(joint.name), value, expected)
    return directions


def _expected(joint: JointRange) -> str:
    mimics = f", which {', '.join(joint.followers)} mimics" if joint.followers else ""
    shown = NumberColumn(joint.name, joint.unit).names[-1]
    also = f" (or {shown})" if shown != joint.name else ""
    return f"one column per joint of the chain, in {joint.unit}{also}{mimics}"


def _everywhere(tables: Sequence[CsvTable], *names: str) -> bool:
    """Whether all tables have one of these columns; refused where only some of them do."""
    has = [any(name in table.columns for name in names) for table in tables]
    if any(has) and not all(has):
        other = tables[has.index(True)].path
        raise SamplesError(
            f"no column {names[0]!r}, although {other} has one",
            f"the column {names[0]} in all of these files or in none",
            file=tables[has.index(False)].path,
        )
    return all(has)


def check_readings(q: FloatArray, joints: Sequence[JointRange], origin: Sequence[str]) -> None:
    """Refuse readings that can only be degrees, millimetres or whole turns off.

    Args:
        q: (n, joints) rad or m.
        joints: what is known of them.
        origin: (n,) where each row came from.

    Raises:
        SamplesError: names the first of them, and what it looks like.
    """
    lower, upper = _plausible(tuple(joints))
    lower, upper = _plausible(tuple(joints))
    # Asked of thousands of readings of the same data.
    if ((q < lower) | (q > upper)).any():
        for k, row, expected, hint in _unusable(q.T, joints):
            where = f"{origin[row]}, {joints[k].name}"
            raise SamplesError(f"{q[row, k]:.6g}", expected, where=where, hint=hint)


def _readings(table: CsvTable, joints: Sequence[JointRange]) -> FloatArray:
    """(n, joints), refused where they can only be degrees, millimetres or whole turns off."""
    q = np.array([_reading(table, joint) for joint in joints])
    for k, row, expected, hint in _unusable(q, joints):
        name = joints[k].name
        if "convert to" in hint and name in table.columns:
            hint += f", or call the column {name}_{'deg' if joints[k].unit == 'rad' else 'mm'}"
        raise table.refuse(row, name, f"{q[k, row]:.6g}", expected, hint)
    return q.reshape(-1, len(table)).T


def _with_full_names(table: CsvTable, joints: Sequence[JointRange]) -> CsvTable:
    """The table with the full names of joints whose columns have the short ones."""
    full = {
        short: long
        for joint in joints
        if joint.short
        for suffix in ("", "_deg", "_mm", ".direction")
        for short, long in [(f"{joint.short}{suffix}", f"{joint.name}{suffix}")]
        if short in table.columns and long not in table.columns
    }
    if not full:
        return table
    return replace(table, columns={full.get(n, n): cells for n, cells in table.columns.items()})


def _reading(table: CsvTable, joint: JointRange) -> FloatArray:
    """(n,) rad or m, also of a column ``JOINT_deg`` or ``JOINT_mm``."""
    column = NumberColumn(joint.name, joint.unit)
    if any(name in table.columns for name in column.names):
        return numbers(table, column)
    if joint.optional:
        return np.zeros(len(table))
    return table.numbers(joint.name, _expected(joint))


def _unusable(q: FloatArray, joints: Sequence[JointRange]) -> Iterator[tuple[int, int, str, str]]:
    """Joint and row of implausible readings (joints, n), what is expected, and what they may be."""
    for k, joint in enumerate(joints):
        for row in np.flatnonzero(_implausible(q[k], joint)).tolist():
            yield k, row, f"{joint.unit}, joint range {joint}", _what_it_is(q, k, joints)


def _implausible(values: FloatArray, joint: JointRange) -> NDArray[np.bool_]:
    lower, upper = _plausible((joint,))
    return np.asarray((values < lower) | (values > upper))


@lru_cache(maxsize=64)
def _plausible(joints: tuple[JointRange, ...]) -> tuple[FloatArray, FloatArray]:
    """(joints,) the least and the greatest reading that need not be in another unit, rad or m."""
    # Encoders report raw readings, which may lie outside the joint's limits: only what no arm in
    # radians or metres can mean is refused.
    limits = list[tuple[float, float]]()
    for joint in joints:
        if joint.unit == "rad":
            limit = max(abs(joint.lower), abs(joint.upper), 2 * math.pi) + 0.5
            limit = limit if math.isfinite(limit) else 8 * math.pi
            limits.append((-limit, limit))
        else:
            beyond = max(10.0 * (joint.upper - joint.lower), 0.5)
            limits.append(
                (max(joint.lower - beyond, -FARTHEST), min(joint.upper + beyond, FARTHEST))
            )
    lower, upper = np.array(limits).reshape(-1, 2).T
    return lower, upper


def _what_it_is(q: FloatArray, k: int, joints: Sequence[JointRange]) -> str:
    """What implausible readings of the k-th joint look like, beside those of all, (joints, n)."""
    if joints[k].unit == "m":
        if _implausible(q[k] / 1e3, joints[k]).any():
            return "check whether the column belongs to another joint"
        return "looks like millimetres: convert to m"
    turning = [i for i, joint in enumerate(joints) if joint.unit == "rad"]
    turns = {i: _turns_beyond(q[i], joints[i]) for i in turning}
    # Other joints must have moved by 0.2 rad in their ranges to be plainly no degrees.
    in_rad = [i for i in turning if turns[i] == 0 and np.ptp(q[i]) > 0.2]
    more = turns[k]
    if not (more and in_rad and None not in turns.values()):
        # Two turns in degrees are more than joints have.
        if np.abs(q[k]).max() > 720.0:
            return "looks like ticks of an encoder: suta-calib import --unit ticks converts them"
        return "looks like degrees: convert to radians"
    count = "a whole turn" if abs(more) == 1 else f"{abs(more)} whole turns"
    than, do = ("more", "subtract") if more > 0 else ("less", "add")
    return (
        f"{count} ({360 * abs(more)} deg) {than} than its range, although the other joints are "
        f"in rad: {do} it, or set the encoder's zero"
    )


def _turns_beyond(values: FloatArray, joint: JointRange) -> int | None:
    """Whole turns by which all readings beyond a range are beyond it; None for no such number."""
    outside = values[(values < joint.lower) | (values > joint.upper)]
    if not _implausible(values, joint).any():
        return 0
    # A counter may be off by two turns.
    for turns in range(-2, 3):
        back = outside - 2 * math.pi * turns
        inside = (joint.lower <= back) & (back <= joint.upper)
        if math.isfinite(joint.upper - joint.lower) and inside.all():
            return turns
    return None


def check_joint_names(joints: Sequence[str], columns: SampleColumns) -> None:
    """Refuse a joint whose column would also have to hold something else."""
    taken = {*columns.labels, *columns.common_labels}
    taken |= {name for column in columns.numbers if column.required for name in column.names}
    taken |= {*position_columns()} if columns.position else set()
    taken |= {*position_sigma_columns()} if columns.position_sigma else set()
    taken |= {*rotation_columns()} if columns.orientation != "none" else set()
    taken |= {TIME} if columns.time else set()
    for joint in joints:
        if joint in taken:
            raise SamplesError(
                f"a joint named {joint!r}",
                f"joint names that differ from the columns {', '.join(sorted(taken))}",
                hint="rename the joint in the URDF",
            )


def write_samples(path: Path, samples: Samples) -> None:
    """Write a samples CSV: joints, ``x,y,z`` in m, ``qx,qy,qz,qw``, numbers, labels, what is told.

    Standard deviations of coordinates are ``sigma_x, sigma_y, sigma_z``, m.

    Numbers have as many digits as it takes to read the same number back.

    Raises:
        OutputError: the file cannot be written; what was there is untouched.
        SamplesError: two columns would have the same name.
    """
    times = [] if samples.time is None else [(TIME, samples.time)]
    columns: list[tuple[str, NDArray[Any]]] = [
        *times,
        *zip(samples.joints, samples.q.T, strict=True),
    ]
    if samples.position is not None:
        columns += zip("xyz", samples.position.T, strict=True)
    if samples.rotation is not None:
        quaternion = quaternion_from_rotation(samples.rotation)
        columns += zip(rotation_columns(), quaternion.T, strict=True)
    if samples.position_sigma is not None:
        columns += zip(SIGMAS, samples.position_sigma.T, strict=True)
    columns += samples.numbers.items()
    columns += samples.labels.items()
    if samples.direction is not None:
        sides = samples.direction.astype(int)
        columns += zip(map(_direction, samples.joints), sides.T, strict=True)
    if samples.temperature is not None:
        columns.append((TEMPERATURE, samples.temperature))
    if samples.payload is not None:
        loaded = (PAYLOAD, *(column.name for column in PAYLOAD_PLACE))
        columns += zip(loaded, samples.payload.T, strict=True)
    for three, vectors in samples.felt.items():
        columns += zip(three.split(","), vectors.T, strict=True)
    names = [name for name, _ in columns]
    if len(set(names)) < len(names):
        raise SamplesError(f"columns {', '.join(names)}", "each name only once", file=path)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(zip(*(values for _, values in columns), strict=True))
    write_text(path, text.getvalue())
