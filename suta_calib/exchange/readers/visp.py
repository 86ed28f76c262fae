"""ViSP: a folder with one small YAML file per pose, such as ``pose_fPe_1.yaml``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import is_folder, read_foreign_text
from suta_calib.exchange.imported import ImportedRows
from suta_calib.exchange.option import Given
from suta_calib.exchange.pose_series import PoseSeries, imported_series
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.rotations import rotations_from
from suta_calib.exchange.table_roles import UNIT
from suta_calib.exchange.tracked_bodies import BODY_OPTIONS
from suta_calib.measurements.yaml_nodes import plain_data

_NAME: Final = re.compile(r"(?:pose_)?(.+?)_?(\d{1,6})\.ya?ml")


class VispReader(Reader):
    """Pose vectors (x, y, z, θu) or 4x4 matrices; ``fPe`` is the hand's, ``cPo`` the target's."""

    name = "visp"
    summary = "ViSP: a folder of pose_fPe_1.yaml, pose_cPo_1.yaml, … (one pose per file)"
    example = "poses --format visp --out pairs.csv"
    options = (*BODY_OPTIONS, UNIT)

    def recognises(self, path: Path, head: str) -> bool:
        """A folder with two such files at least."""
        del head
        return is_folder(path) and len(_files(path)) > 1

    def read(self, path: Path, given: Given) -> ImportedRows:
        """Every file of the folder, in series by their names."""
        if not is_folder(path):
            raise ForeignFileError("no such file", "a folder with pose files", file=path)
        series: dict[str, dict[int, FloatArray]] = {}
        for file, name, number in _files(path):
            series.setdefault(name, {})[number] = _pose(file)
        if not series:
            raise ForeignFileError("no pose files", "pose_fPe_1.yaml, pose_cPo_1.yaml", file=path)
        by_name = {
            name: PoseSeries(
                np.stack([poses[k] for k in sorted(poses)]), sorted(poses), [1] * len(poses)
            )
            for name, poses in series.items()
        }
        return imported_series(path, self.name, by_name, given)


def _files(folder: Path) -> list[tuple[Path, str, int]]:
    """File, series and number of each pose in a folder."""
    matches = ((file, _NAME.fullmatch(file.name)) for file in sorted(folder.iterdir()))
    return [(file, match[1], int(match[2])) for file, match in matches if match]


def _pose(path: Path) -> FloatArray:
    """(3, 4) of a file."""
    data, _ = plain_data(path, read_foreign_text(path), ForeignFileError)
    shape, rows = (data.get("rows"), data.get("cols")), data.get("data")
    try:
        numbers = np.array(rows, float).ravel()
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if shape == (4, 4) and numbers.size == 16 and np.allclose(numbers[12:], (0, 0, 0, 1)):
        return numbers.reshape(4, 4)[:3]
    if shape == (6, 1) and numbers.size == 6:
        rotation = rotations_from("vector", numbers[None, 3:], path, [1])[0]
        return np.column_stack([rotation, numbers[:3]])
    expected = "rows: 6 and cols: 1 (x, y, z, θu), or a 4x4 matrix, with its data"
    raise ForeignFileError(f"rows: {shape[0]} and cols: {shape[1]}", expected, file=path)
