"""Motions in files: where the tip was, and when."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.measurements.csv_table import (
    has_rotations,
    position_columns,
    positions,
    read_csv_table,
    rotations,
)
from suta_calib.model.arm import ArmModel

LEAST_ROWS: Final = 20


@dataclass(frozen=True, eq=False)
class Trajectory(Displayable):
    """A motion of the tip.

    Attributes:
        path: the file.
        time: (n,) s, increasing.
        position: (n, 3) m.
        rotation: (n, 3, 3); None where the file has none.
        angles: (n, joints) readings of an arm, rad; None where there are none.
        lines: (n,) of the file, from 1; None where it was not read from one.
    """

    path: Path
    time: FloatArray
    position: FloatArray
    rotation: FloatArray | None = None
    angles: FloatArray | None = None
    lines: tuple[int, ...] | None = None

    def origin(self, row: int) -> str:
        """Where a row comes from: file and line, or its number from 0."""
        return f"row {row}" if self.lines is None else f"{self.path.name}:{self.lines[row]}"


def read_trajectory(path: str | Path, arm: ArmModel | None = None) -> Trajectory:
    """Columns ``time,x,y,z`` (m; ``x_mm…``: mm), and ``qx,qy,qz,qw`` where it has orientations.

    With an arm the columns of its joints are read too; where there is no position, the arm gives
    it. Rows whose ``valid`` is 0, as ``suta-calib track`` writes them, are left out.

    Raises:
        SamplesError: unreadable, a column missing, a value that is none, time that does not
            increase, or fewer than 20 rows.
    """
    table = read_csv_table(Path(path)).valid()
    if len(table) < LEAST_ROWS:
        raise SamplesError(f"{len(table)} valid rows", f"at least {LEAST_ROWS}", file=table.path)
    time = table.time("a single motion, timed by one clock")
    angles = None
    if arm is not None and all(name in table.columns for name in arm.joints):
        angles = np.stack([table.numbers(name) for name in arm.joints], axis=-1)
        if not any(name in table.columns for name in position_columns()):
            rotation, position = arm.forward(angles)
            return Trajectory(table.path, time, position, rotation, angles, table.lines)
    turned = rotations(table) if has_rotations(table) else None
    return Trajectory(table.path, time, positions(table), turned, angles, table.lines)
