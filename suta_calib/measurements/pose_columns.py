"""Positions and orientations in the columns of a CSV file.

Columns are ``x, y, z`` in m or ``x_mm, y_mm, z_mm``, and ``qx, qy, qz, qw``; a prefix such as
``a_`` tells several poses in one file apart (``a_x``, ``a_x_mm``, ``a_qx``).
"""

from __future__ import annotations

import warnings

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rotation_from_quaternion
from suta_calib.measurements.csv_table import CsvTable
from suta_calib.units import from_mm

_QUATERNION = ("qx", "qy", "qz", "qw")
_UNIT_NORM_TOLERANCE = 0.01
_ZERO_NORM = 1e-3


class SutaCalibWarning(UserWarning):
    """Input that can be used, but that the user should look at."""


def position_columns(prefix: str = "") -> tuple[str, ...]:
    """Names of every column that `positions` may read."""
    return tuple(f"{prefix}{axis}{unit}" for unit in ("", "_mm") for axis in "xyz")


def rotation_columns(prefix: str = "") -> tuple[str, ...]:
    """Names of every column that `rotations` reads."""
    return tuple(prefix + name for name in _QUATERNION)


def positions(table: CsvTable, prefix: str = "") -> FloatArray:
    """Positions, (n, 3) in m.

    Raises:
        SamplesError: a column is missing or not finite, or there are both metres and millimetres.
    """
    names = position_columns(prefix)
    metres, millimetres = names[:3], names[3:]
    in_mm = any(name in table.columns for name in millimetres)
    if in_mm and any(name in table.columns for name in metres):
        raise SamplesError(
            f"columns {', '.join(name for name in names if name in table.columns)}",
            f"either {', '.join(metres)} (m) or {', '.join(millimetres)}",
            file=table.path,
            line=table.header_line,
        )
    expected = f"columns {', '.join(metres)} in m, or {', '.join(millimetres)}"
    chosen = millimetres if in_mm else metres
    read = np.stack([table.numbers(name, expected) for name in chosen], axis=-1)
    return from_mm(read) if in_mm else read


def has_rotations(table: CsvTable, prefix: str = "") -> bool:
    """Whether any of the quaternion's columns is there."""
    return any(name in table.columns for name in rotation_columns(prefix))


def rotations(table: CsvTable, prefix: str = "") -> FloatArray:
    """Rotation matrices, (n, 3, 3), of the quaternions ``qx, qy, qz, qw``.

    Warns:
        SutaCalibWarning: a quaternion's length is more than 1 % away from one; it is normalised.

    Raises:
        SamplesError: a column is missing or not finite, or a quaternion is zero.
    """
    names = rotation_columns(prefix)
    expected = f"the orientation as a quaternion {', '.join(names)}"
    quaternion = np.stack([table.numbers(name, expected) for name in names], axis=-1)
    with np.errstate(over="ignore"):
        length = np.linalg.norm(quaternion, axis=-1)
    for row in np.flatnonzero((length < _ZERO_NORM) | ~np.isfinite(length)):
        found = f"a quaternion of length {length[row]:.3g}"
        raise table.refuse(int(row), names[0], found, "a quaternion of length 1")
    odd = np.flatnonzero(np.abs(length - 1) > _UNIT_NORM_TOLERANCE)
    if odd.size:
        warnings.warn(
            f"{table.path}:{table.lines[odd[0]]}: found a quaternion of length "
            f"{length[odd[0]]:.3f} ({odd.size} such rows); expected length 1; normalised",
            SutaCalibWarning,
            stacklevel=3,
        )
    return rotation_from_quaternion(quaternion / length[:, None])
