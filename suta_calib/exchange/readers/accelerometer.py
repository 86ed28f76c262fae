"""Any table of an accelerometer: a time, and accelerations along x, y and z."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from suta_calib.arrays import FloatArray
from suta_calib.exchange.column_names import COLUMNS, is_joint, renamed, seconds_in
from suta_calib.exchange.felt_gravity import ACCELERATION, AccelerometerReader
from suta_calib.exchange.option import Given
from suta_calib.exchange.sheet import Sheet
from suta_calib.words import listed

_AXIS: Final = re.compile(
    r"(?:.*[._/ ])?(?:a|(?:gF|acc|accel|acceleration|accelerometer)[._]?)([xyz])(?:\s*[\[(].*)?",
    re.IGNORECASE,
)
_TIME: Final = re.compile(
    r"#?\s*(?:t|time|timestamp|stamp|seconds|seconds_elapsed)(?:\s*[\[(].*)?", re.IGNORECASE
)


class AnyAccelerometerReader(AccelerometerReader):
    """Columns ``time, ax, ay, az``, or what else they are usually called."""

    name = "accelerometer"
    summary = "table of an accelerometer or IMU: columns time, ax, ay, az by any usual name"
    example = "imu.csv --format accelerometer --columns 1=time,5=ax,6=ay,7=az --out imu_rows.csv"
    options = (*AccelerometerReader.options, COLUMNS)
    suffixes = (".csv", ".txt", ".tsv", ".dat", ".log")

    def recognises(self, path: Path, head: str) -> bool:
        """By the names in its first line, which are no joint's."""
        del path
        cells = [cell.strip().strip('"') for cell in re.split(r"[,;\t]", head.partition("\n")[0])]
        if any(map(is_joint, cells)) or not any(map(_TIME.fullmatch, cells)):
            return False
        return len(_axes(cells)) == len(ACCELERATION)

    def columns(self, sheet: Sheet, given: Given) -> tuple[FloatArray, Sequence[int]]:
        """By name, or as they were given names."""
        names = renamed(sheet, given)
        axes = {str(name): names.index(name) for name in ACCELERATION if name in names}
        axes = axes if len(axes) == len(ACCELERATION) else _axes(names)
        # Who says that it is an accelerometer's need not call them otherwise.
        plain = [str(name).lower() for name in names]
        if not axes and {*"xyz"} <= {*plain}:
            axes = {a: plain.index(axis) for a, axis in zip(ACCELERATION, "xyz", strict=True)}
        times = [k for k, name in enumerate(names) if _TIME.fullmatch(name)]
        if len(axes) != len(ACCELERATION) or not times:
            raise sheet.refuse(
                f"columns {listed(list(sheet.names), 12)}",
                "columns time, ax, ay, az",
                hint=f"name them with {COLUMNS.switch} 1=time,2=ax,3=ay,4=az",
            )
        per_second = seconds_in(names[times[0]]) or 1.0
        return sheet.numbers(times[:1])[:, 0] / per_second, [axes[name] for name in ACCELERATION]


def _axes(names: Sequence[str]) -> dict[str, int]:
    """Columns of ``ax, ay, az`` by any usual name; of two with one axis, none."""
    columns_of_axis = dict[str, list[int]]()
    for k, name in enumerate(names):
        if match := _AXIS.fullmatch(name):
            columns_of_axis.setdefault(f"a{match[1].lower()}", []).append(k)
    return {axis: at[0] for axis, at in columns_of_axis.items() if len(at) == 1}
