"""Any text table or spreadsheet: joint readings, positions, poses in any of the usual forms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import LENGTH_UNITS, is_plain_file
from suta_calib.exchange.column_names import (
    CLOCKS,
    COLUMNS,
    JOINT_NAMES,
    TUM,
    is_joint,
    renamed,
    seconds_in,
)
from suta_calib.exchange.delimited import DELIMITED_OPTIONS, read_sheet
from suta_calib.exchange.felt_gravity import STANDARD_GRAVITY
from suta_calib.exchange.imported import (
    GRID_HINT,
    ORIGIN,
    ImportedRows,
    distance_notes,
    from_origin,
    origin_of,
)
from suta_calib.exchange.joint_readings import READING_OPTIONS, Readings
from suta_calib.exchange.nameless_poses import nameless_pose
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.reader import TABLE, Reader
from suta_calib.exchange.rotations import NUMBERS, rotations_from
from suta_calib.exchange.sheet import Sheet
from suta_calib.exchange.table_roles import (
    ANGLES,
    GUESS,
    LENGTHS,
    OF_MATRIX,
    ROLE_OPTIONS,
    UNIT,
    PoseColumns,
    guessed_angle,
    guessed_length,
    named_poses,
    plain_name,
)
from suta_calib.exchange.tracked_bodies import BODY_OPTIONS, PAIR, REFERENCE, Body, Recording
from suta_calib.measurements.csv_table import SIGMA, SIGMAS
from suta_calib.measurements.sample_files import PAYLOAD, PAYLOAD_PLACE, TEMPERATURE
from suta_calib.terms import KINDS
from suta_calib.units import from_deg
from suta_calib.words import listed

JOINTS: Final = Option(
    "joints", "Columns that are joint readings; globs.", "joint_*,…", several=True
)
FROM: Final = Option(
    "pose_from", "Number of the first column of the pose; the columns before it are ignored.", "N"
)
# Behind the name of a joint: which way it came, which is no reading.
_DIRECTION: Final = ".direction"
# Numbers of samples that are neither labels nor readings.
_NO_JOINTS: Final = (TEMPERATURE, PAYLOAD, *(place.name for place in PAYLOAD_PLACE))
# More than any joint turns that is read in rad, twice round and a little.
_FEW_TURNS: Final = 13.0

ALTERNATING: Final = Option(
    "alternating", "Rows are in turn poses of the hand (a_) and of the target (b_).", flag=True
)


class TableReader(Reader):
    """Rows of numbers, with or without names."""

    name = TABLE
    summary = (
        "any text table or .xlsx: joints, points, poses as 7, 12, 16 numbers, 4x4 blocks, angles"
    )
    example = "poses.txt --format table --unit mm --rotation wxyz --out poses.csv"
    options = (
        UNIT,
        COLUMNS,
        JOINTS,
        FROM,
        ORIGIN,
        *ROLE_OPTIONS,
        *DELIMITED_OPTIONS,
        *READING_OPTIONS,
        *BODY_OPTIONS,
        ALTERNATING,
    )

    def read(self, path: Path, given: Given) -> ImportedRows:
        """Rows in SI; those in which a number is missing are left out and counted."""
        columns, other = _understood(path, given), given.path(REFERENCE)
        if other is not None and is_plain_file(other):
            if other.samefile(path):
                expected = "another file, whose rows were taken at the same times"
                raise given.refuse(REFERENCE, f"{other}, which is the file itself", expected)
            columns.relative_to(_understood(other, given), given.text(REFERENCE))
        return columns.imported()


def _understood(path: Path, given: Given) -> _Columns:
    sheet = read_sheet(path, given)
    if FROM in given:
        count = len(sheet.names)
        expected = f"the number of a column, from 1 to {count}"
        sheet = sheet.from_column(given.whole(FROM, "", 1, count, expected))
    if sheet.comment:
        by_comment = sheet.named_by_comment()
        names = renamed(by_comment, given)
        if named_poses(by_comment, names, given) or any(map(is_joint, names)):
            sheet = by_comment
    names = renamed(sheet, given)
    poses = named_poses(sheet, names, given)
    named = COLUMNS in given or JOINTS in given
    # Beside a matrix stand joints, which may have been given names.
    wide = len(names) > OF_MATRIX[-1] and not sheet.headed
    if not poses and (wide or not named):
        matrix = len(names) in OF_MATRIX and not any(map(is_joint, names))
        if not sheet.headed or FROM in given or matrix:
            pose, sheet = nameless_pose(sheet, given)
            poses = [pose] if pose is not None else []
            asked = zip(names, sheet.names, strict=True) if named else ()
            names = [new if old.isdigit() else old for old, new in asked] or list(sheet.names)
    return _Columns(sheet, names, poses, given)


class _Columns:
    """A sheet whose columns are understood: their names, and which of them are poses."""

    def __init__(
        self, sheet: Sheet, names: Sequence[str], poses: Sequence[PoseColumns], given: Given
    ) -> None:
        self._sheet, self._names, self._poses, self._given = sheet, names, poses, given
        asked = dict.fromkeys(given.texts(UNIT))
        lengths = [unit for unit in asked if unit in LENGTHS]
        angles = [unit for unit in asked if unit not in LENGTHS]
        for units in (lengths, angles):
            if len(units) > 1:
                raise given.refuse(
                    UNIT, " and ".join(units), "one unit for lengths and one for angles"
                )
        self._length, self._angle = "".join(lengths), "".join(angles)
        self._notes: list[str] = []
        self._remarks = list(sheet.remarks)
        self._angles_used = False
        self._readings: set[int] = set()
        self._others: dict[str, Body] = {}
        self._guessing = GUESS in given
        # Of the position of each pose, by its prefix.
        self._units: dict[str, str] = {}

    def relative_to(self, other: _Columns, name: str) -> None:
        """Another file of the same rows holds the body that this one's pose is told relative to."""
        for table in (self, other):
            if len(table._poses) != 1:
                description = f"{len(table._poses)} poses per row"
                raise ForeignFileError(
                    description, "one pose per row in both files", file=table._sheet.path
                )
        rows = len(self._sheet)
        if len(other._sheet) != rows:
            problem = f"{len(other._sheet)} rows"
            expected = f"{rows} rows, as in {self._sheet.path}, because the rows belong together"
            raise ForeignFileError(problem, expected, file=other._sheet.path)
        clocks = self._clock(), other._clock()
        if (row := _first_disagreement(*clocks)) is not None:
            problem = "a row with another time"
            expected = f"the times of {self._sheet.path}, because the rows belong together"
            hint = "remove the rows that only one of the files has"
            raise ForeignFileError(
                problem, expected, file=other._sheet.path, line=other._sheet.lines[row], hint=hint
            )
        self._others[name] = other._body(other._poses[0])

    def _clock(self) -> FloatArray | None:
        """(n,) when the rows were taken, in whatever unit; None where they do not say."""
        for k, name in enumerate(self._names):
            if plain_name(name)[0].lower() in CLOCKS:
                return self._sheet.values[k]
        return None

    def imported(self) -> ImportedRows:
        """The rows, in SI."""
        beside, complete = self._beside()
        if not self._poses and not self._readings:
            raise self._nothing()
        self._check_units()
        if ORIGIN in self._given and not self._poses:
            raise self._given.refuse(ORIGIN, "an origin, but no positions", "columns x, y, z")
        bodies = {pose.prefix or "pose": self._body(pose) for pose in self._poses} | self._others
        for body in bodies.values():
            complete &= body.observed
        rows = np.flatnonzero(complete)
        complete_bodies = {name: body.take(rows) for name, body in bodies.items()}
        columns = {name: values[rows] for name, values in beside.items()}
        for pose in self._poses:
            if len(rows):
                self._question(complete_bodies[pose.prefix or "pose"].position, pose)
        made = self._together(complete_bodies, columns)
        if self._guessing:
            self._remarks += [self._pose_remark(pose) for pose in self._poses]
        return replace(
            made,
            dropped=len(complete) - len(rows),
            notes=(*self._notes, *self._given.guesses),
            remarks=tuple(dict.fromkeys(self._remarks)),
        )

    def _together(
        self, bodies: Mapping[str, Body], columns: Mapping[str, NDArray[Any]]
    ) -> ImportedRows:
        path = self._sheet.path
        if not bodies:
            return ImportedRows(source=path, form=TABLE, columns=dict(columns))
        if ALTERNATING in self._given:
            bodies, columns = self._by_turns(bodies, columns)
        recording = Recording(path, bodies, None, "as in the file", dict(columns))
        if set(bodies) == set(PAIR):
            return recording.pairs(TABLE)
        alone = next(iter(bodies)) if len(bodies) == 1 else ""
        return recording.imported(TABLE, self._given, alone if alone in PAIR else "")

    def _by_turns(
        self, bodies: Mapping[str, Body], columns: Mapping[str, NDArray[Any]]
    ) -> tuple[dict[str, Body], dict[str, NDArray[Any]]]:
        """The rows in turn as the hand's and the target's; a column beside them is the hand's."""
        (body,) = bodies.values() if len(bodies) == 1 else (None,)
        count = 0 if body is None else len(body.position)
        if body is None or count % 2 or count < len(self._sheet):
            problem = f"{len(bodies)} poses in each of {count} complete rows"
            expected = "one pose a row, an even number of rows, and nothing missing"
            raise self._given.refuse(ALTERNATING, problem, expected)
        turns = zip(PAIR, (np.arange(0, count, 2), np.arange(1, count, 2)), strict=True)
        return (
            {prefix: body.take(rows) for prefix, rows in turns},
            {name: values[::2] for name, values in columns.items()},
        )

    def _body(self, pose: PoseColumns) -> Body:
        path = self._sheet.path
        position = self._sheet.numbers(pose.position)
        unit = self._length or pose.unit
        if not unit:
            # Of a grid's coordinates the differences say it.
            origin = origin_of(self._given, position)
            near = position if origin is None else position - origin
            unit = guessed_length(self._sheet, near, self._given) if self._guessing else "m"
        self._units[pose.prefix] = unit
        if self._length and pose.unit and self._length != pose.unit:
            problem = f"columns with {pose.unit} in their names, but --unit {self._length}"
            raise self._sheet.refuse(problem, "the same unit in both")
        if ORIGIN in self._given and (len(self._poses) > 1 or REFERENCE in self._given):
            raise self._given.refuse(ORIGIN, "an origin, but several poses per row", "one")
        position = LENGTH_UNITS.get(unit, 1.0) * position
        position, remarks = from_origin(path, self._sheet.lines, position, self._given)
        self._remarks += remarks
        if not pose.form:
            return Body(position)
        numbers = self._sheet.numbers(pose.rotation)
        if NUMBERS[pose.form] == 3:
            unit = self._angle or pose.angle or self._unstated_angle(pose.form, numbers)
            numbers = from_deg(numbers) if unit == "deg" else numbers
        return Body(position, rotations_from(pose.form, numbers, path, self._sheet.lines))

    def _unstated_angle(self, form: str, numbers: FloatArray) -> str:
        """The unit of angles (n, 3) of which nobody says it."""
        if self._guessing:
            return guessed_angle(self._sheet, form, numbers, self._given)
        most = float(np.nanmax(np.abs(numbers), initial=0.0))
        if most > _FEW_TURNS / 2:
            raise self._degrees("angles of an orientation", most)
        self._remarks.append(
            f"Angles up to {most:.4g} were treated as rad; choose another unit with --unit."
        )
        return "rad"

    def _question(self, position: FloatArray, pose: PoseColumns) -> None:
        """Lengths of an odd size: refused where nobody said their unit, noted where one did."""
        unit = self._length or pose.unit
        if self._guessing and not unit:
            return
        notes = distance_notes(position, f"lengths in {unit or 'm'}")
        if notes and not unit:
            # Distance, in whatever unit, of all positions from the origin that is more than any
            # arm's in mm.
            far = float(np.linalg.norm(position, axis=1).min()) > 1e4
            grid = f"; {GRID_HINT}" if far and ORIGIN not in self._given else ""
            problem = f"{notes[0][0].lower()}{notes[0][1:]}"
            hint = f"give --unit mm or --unit m; nothing is scaled automatically{grid}"
            raise self._sheet.refuse(problem, "their unit", hint=hint)
        self._notes += notes
        size = float(np.median(np.linalg.norm(position, axis=1))) if len(position) else 0.0
        near = np.abs(np.linalg.norm(position, axis=1) - STANDARD_GRAVITY) < 0.3
        if size and near.mean() > 0.5 and not pose.rotation:
            self._remarks.append(
                f"Most positions are {size:.3g} m away, and gravity is 9.81 m/s²: if they are "
                "accelerations, give --format accelerometer."
            )

    def _beside(self) -> tuple[dict[str, NDArray[Any]], BoolArray]:
        """Columns that are no pose, and the rows in which none of their numbers is missing."""
        sheet, complete = self._sheet, np.ones(len(self._sheet), dtype=bool)
        taken = {k for pose in self._poses for k in (*pose.position, *pose.rotation)}
        columns: dict[str, NDArray[Any]] = {}
        labels = {*_labels(), "frame"} - {"time"}
        readings = Readings.of(self._given, self._angle or "rad")
        joints = self._readings = self._joints(readings.names)
        for k, name in enumerate(self._names):
            # Of a table without names only what is asked for has one.
            if k in taken or not name or (name.isdigit() and name == sheet.names[k]):
                continue
            bare, unit = plain_name(name)
            if k in joints:
                self._angles_used |= unit not in LENGTHS
                numbers = sheet.numbers([k])[:, 0]
                complete &= np.isfinite(numbers)
                of = replace(readings, unit=self._angle or unit or "rad")
                columns[bare if unit else name] = self._joint(of, bare, numbers, unit)
                continue
            if bare.lower() in (SIGMA, *SIGMAS):
                numbers = sheet.numbers([k])[:, 0]
                complete &= np.isfinite(numbers)
                length = unit or self._length or next((p.unit for p in self._poses if p.unit), "m")
                columns[bare.lower()] = LENGTH_UNITS.get(length, 1.0) * numbers
                continue
            values = sheet.values[k]
            if values is not None and (per_second := seconds_in(name)):
                name, values = "time", values / per_second
            if values is not None and name in _measured():
                complete &= np.isfinite(values)
                columns[name] = values
                continue
            # A label stays as it is written: 1, not 1.0.
            if values is None or name in labels or not np.isfinite(values).all():
                columns[name] = np.array(sheet.cells(k))
            else:
                columns[name] = values
        return columns, complete

    def _joints(self, stated: Set[str]) -> set[int]:
        """Columns that are joint readings: as was said, or by what joints are usually called.

        A column that was given a name of its own, which is no label, is one too, and so is one of
        which something is ``stated``.
        """
        renamed = set(self._given.pairs(COLUMNS).values()) - _labels()
        by_name = JOINTS not in self._given
        patterns = JOINT_NAMES if by_name else self._given.texts(JOINTS)
        columns = set()
        for k, name in enumerate(self._names):
            bare, unit = plain_name(name)
            matching = any(fnmatchcase(spelling, p) for p in patterns for spelling in (name, bare))
            # A column whose name says an angle's unit; not that of an angle's uncertainty.
            angle = by_name and unit in ANGLES and "sigma" not in name.lower()
            if (matching or angle or {name, bare} & renamed) and not name.endswith(_DIRECTION):
                columns.add(k)
        if by_name and not (columns or self._poses) and self._angle:
            # Nothing else in the file can be in such a unit.
            likely = self._likely()
            columns = {self._names.index(name) for name in likely}
            if likely:
                self._remarks.append(
                    f"Columns treated as joint readings in {self._angle}: {listed(likely, 16)}; "
                    f"choose others with {JOINTS.switch}."
                )
        return columns | {k for k, n in enumerate(self._names) if {n, plain_name(n)[0]} & stated}

    def _check_units(self) -> None:
        """Refuse a unit of what is not there: its numbers would stay as they are."""
        turned = any(NUMBERS.get(pose.form) == 3 for pose in self._poses)
        for unit, used, what, where in (
            (self._angle, self._angles_used or turned, "joint readings", JOINTS),
            (self._length, bool(self._poses), "a position", COLUMNS),
        ):
            if unit and not used:
                problem = f"{UNIT.switch} {unit}, but no columns of {what}"
                expected = "columns in this unit"
                likely = ",".join(self._likely()) if where is JOINTS else ""
                hint = f"name them with {where.switch} {likely or where.metavar}"
                raise self._sheet.refuse(problem, expected, hint=hint)

    def _likely(self) -> list[str]:
        """Columns of numbers that are neither a pose nor a label: joint readings, perhaps."""
        taken = {k for pose in self._poses for k in (*pose.position, *pose.rotation)}
        labels = {*_labels(), *CLOCKS, *_NO_JOINTS}
        return [
            name
            for k, name in enumerate(self._names)
            if k not in taken and name.lower() not in labels and self._sheet.values[k] is not None
        ]

    def _joint(self, readings: Readings, joint: str, numbers: FloatArray, unit: str) -> FloatArray:
        if unit in LENGTHS:  # a joint that slides
            return LENGTH_UNITS[unit] * numbers
        angles = readings.angles(joint, numbers)
        most = float(np.nanmax(np.abs(angles), initial=0.0))
        if readings.unit != "rad" or most <= _FEW_TURNS:
            return angles
        if self._angle or unit:
            self._notes.append(
                f"Readings of {joint} reach {most:.0f} rad: check whether they are degrees."
            )
            return angles
        # More than any joint turns that is read in degrees: ticks, perhaps.
        most_degrees = 720.0
        if not self._guessing or most > most_degrees:
            raise self._degrees(f"readings of {joint}", most)
        self._given.note_guess(UNIT, "deg", f"readings of {joint} up to {most:.4g}")
        return replace(readings, unit="deg").angles(joint, numbers)

    def _degrees(self, of: str, most: float) -> ForeignFileError:
        problem, expected = f"{of} up to {most:.4g}, which look like degrees", "their unit"
        hint = "give --unit deg, --unit ticks or --unit rad; nothing is scaled automatically"
        return self._sheet.refuse(problem, expected, hint=hint)

    def _pose_remark(self, pose: PoseColumns) -> str:
        names = [self._names[k] for k in (*pose.position, *pose.rotation)]
        unit = self._units[pose.prefix]
        form = f", --rotation {pose.form}" if pose.form else ""
        return f"Columns read as a pose: {', '.join(names)}; --unit {unit}{form}."

    def _nothing(self) -> ForeignFileError:
        sheet = self._sheet
        trajectory = len(sheet.names) == len(TUM) and not sheet.headed
        columns = ",".join(f"{k}={name}" for k, name in enumerate(("time", *"xyz", *TUM[4:]), 1))
        likely = ",".join(self._likely()) if sheet.headed else ""
        joints = f"name joint readings with {JOINTS.switch} {likely}, or " if likely else "name "
        return sheet.refuse(
            f"{len(sheet.names)} columns: {listed(list(sheet.names), 16)}",
            "columns of a pose or of joints by name; or 3, 6, 7, 12 or 16 numbers",
            hint=f"{joints}the columns with --columns NAME=joint_1,…, with x, y, z, qx, qy, qz, qw "
            f"for a pose, or give the first column of a pose with {FROM.switch} N"
            + (f"; {COLUMNS.switch} {columns} for a TUM trajectory" if trajectory else ""),
        )


def _first_disagreement(a: FloatArray | None, b: FloatArray | None) -> int | None:
    """The first row at which two clocks (n,) are more than half a step apart; None where none is.

    They may have begun at other times.
    """
    if a is None or b is None or len(a) < 2:
        return None
    step = float(np.nanmedian(np.abs(np.diff(a))))
    off = np.abs((a - a[0]) - (b - b[0]))
    disagreeing = np.flatnonzero(off > step / 2)
    return int(disagreeing[0]) if len(disagreeing) else None


def _measured() -> set[str]:
    """Columns of samples with numbers that belong to every row of a kind, such as ``ax``."""
    return {column.name for kind in KINDS.values() for column in kind.columns.numbers}


def _labels() -> set[str]:
    """Columns of samples that are no readings of joints, nor poses, whatever the kind."""
    labels = {"time", "image", SIGMA, *SIGMAS}
    for kind in KINDS.values():
        columns = kind.columns
        labels |= {*columns.labels, *columns.optional_labels, *columns.common_labels}
    return labels
