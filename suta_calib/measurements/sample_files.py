"""Samples from CSV files and back: one column per joint, plus what the observation needs."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import quaternion_from_rotation
from suta_calib.measurements.csv_table import (
    CsvTable,
    has_rotations,
    position_columns,
    positions,
    read_csv_table,
    rotation_columns,
    rotations,
)
from suta_calib.measurements.files import write_text
from suta_calib.measurements.samples import Samples

# Encoders report raw readings, which may lie outside the joint's limits: only what no arm in
# radians or metres can mean is refused.
_REVOLUTE_MARGIN = 0.5
_UNLIMITED_REVOLUTE = 8 * math.pi
_PRISMATIC_WIDTHS = 10.0
_PRISMATIC_MARGIN = 0.5


@dataclass(frozen=True)
class JointRange:
    """What is known of a joint before its readings are read.

    Attributes:
        name: the joint's name, which is also its column's.
        unit: ``rad``, or ``m`` for a prismatic joint.
        lower: lower limit in that unit, -inf where there is none.
        upper: upper limit in that unit, inf where there is none.
    """

    name: str
    unit: Literal["rad", "m"]
    lower: float
    upper: float

    def __str__(self) -> str:
        return f"[{self.lower:.4g}, {self.upper:.4g}] {self.unit}"


@dataclass(frozen=True)
class SampleColumns:
    """Columns that a kind of observation needs beside the joints.

    Attributes:
        labels: label columns, such as ``("placement", "repeat", "landmark")``.
        optional_labels: label columns that are read where every file has them.
        position: whether ``x, y, z`` (m), or ``x_mm, y_mm, z_mm``, are required.
        orientation: whether ``qx, qy, qz, qw`` are read.
    """

    labels: tuple[str, ...] = ()
    position: bool = False
    orientation: Literal["none", "optional", "required"] = "none"
    optional_labels: tuple[str, ...] = ()


def read_samples(
    paths: Sequence[Path], joints: Sequence[JointRange], columns: SampleColumns
) -> Samples:
    """Read one or more samples CSV files into one `Samples`.

    Args:
        paths: the files, in the order their rows shall have.
        joints: the joints of the chain, base to tip; the order of the columns of ``q``.
        columns: what else is needed; every other column is ignored.

    Warns:
        SutaCalibWarning: quaternions that are more than 1 % away from unit length.

    Raises:
        SamplesError: a file cannot be read, lacks a column, holds a value that is not a finite
            number or an empty label, has a reading that looks like degrees or millimetres, or
            only some of the files have orientations.
    """
    if not paths:
        raise SamplesError("no files", "at least one samples file")
    _check_names(joints, columns)
    tables = [read_csv_table(path) for path in paths]
    there = [n for n in columns.optional_labels if all(n in table.columns for table in tables)]
    columns = replace(columns, labels=(*columns.labels, *there))
    parts = [_samples(table, joints, columns) for table in tables]
    for path, part in zip(paths, parts, strict=True):
        if (part.rotation is None) != (parts[0].rotation is None):
            with_, without = (path, paths[0]) if parts[0].rotation is None else (paths[0], path)
            raise SamplesError(
                f"no orientation, but {with_} has one",
                "the columns qx, qy, qz, qw in all of these files or in none",
                file=without,
            )
    return Samples.concatenate(parts)


def _samples(table: CsvTable, joints: Sequence[JointRange], columns: SampleColumns) -> Samples:
    oriented = columns.orientation == "required" or (
        columns.orientation == "optional" and has_rotations(table)
    )
    needed = f"a label column; this kind needs {', '.join(columns.labels)}"
    return Samples.from_arrays(
        [joint.name for joint in joints],
        np.array([_readings(table, joint) for joint in joints]).reshape(-1, len(table)).T,
        labels={name: table.labels(name, needed) for name in columns.labels},
        position=positions(table) if columns.position else None,
        rotation=rotations(table) if oriented else None,
        origin=table.origin,
    )


def _readings(table: CsvTable, joint: JointRange) -> FloatArray:
    """Readings of one joint, (n,), refused where they can only be degrees or millimetres."""
    values = table.numbers(joint.name, f"one column per joint of the chain, in {joint.unit}")
    if joint.unit == "rad":
        limit = max(abs(joint.lower), abs(joint.upper), 2 * math.pi) + _REVOLUTE_MARGIN
        implausible = np.abs(values) > (limit if math.isfinite(limit) else _UNLIMITED_REVOLUTE)
        meant = "degrees: convert to radians"
    else:
        beyond = np.maximum(joint.lower - values, values - joint.upper)
        width = joint.upper - joint.lower
        implausible = beyond > max(_PRISMATIC_WIDTHS * width, _PRISMATIC_MARGIN)
        meant = "millimetres: convert to m"
    for row in np.flatnonzero(implausible):
        expected = f"{joint.unit}, joint range {joint}"
        found, hint = f"{values[row]:.6g}", f"looks like {meant}"
        raise table.refuse(int(row), joint.name, found, expected, hint)
    return values


def _check_names(joints: Sequence[JointRange], columns: SampleColumns) -> None:
    """Refuse a joint whose column would also have to hold something else."""
    taken = {*columns.labels}
    taken |= {*position_columns()} if columns.position else set()
    taken |= {*rotation_columns()} if columns.orientation != "none" else set()
    for joint in joints:
        if joint.name in taken:
            raise SamplesError(
                f"a joint named {joint.name!r}",
                f"joint names other than the columns {', '.join(sorted(taken))}",
                hint="rename the joint in the URDF",
            )


def write_samples(path: Path, samples: Samples) -> None:
    """Write a samples CSV: joints, ``x,y,z`` in m, ``qx,qy,qz,qw``, then the labels.

    Numbers have as many digits as it takes to read the same number back.

    Raises:
        OutputError: the file cannot be written; what was there is untouched.
        SamplesError: two columns would have the same name.
    """
    columns: list[tuple[str, NDArray[Any]]] = [*zip(samples.joints, samples.q.T, strict=True)]
    if samples.position is not None:
        columns += zip("xyz", samples.position.T, strict=True)
    if samples.rotation is not None:
        quaternion = quaternion_from_rotation(samples.rotation)
        columns += zip(rotation_columns(), quaternion.T, strict=True)
    columns += samples.labels.items()
    names = [name for name, _ in columns]
    if len(set(names)) < len(names):
        raise SamplesError(f"columns {', '.join(names)}", "each name once", file=path)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(zip(*(values for _, values in columns), strict=True))
    write_text(path, text.getvalue())
