"""OpenCV: YAML that ``cv::FileStorage`` writes, with 4x4 matrices by name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import read_foreign_text
from suta_calib.exchange.imported import ImportedRows
from suta_calib.exchange.option import Given
from suta_calib.exchange.pose_series import PoseSeries, imported_series
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.table_roles import UNIT
from suta_calib.exchange.tracked_bodies import BODY_OPTIONS
from suta_calib.exchange.truncated import COMPLETE, check_count, check_last_line
from suta_calib.measurements.yaml_file import KeyPath
from suta_calib.measurements.yaml_nodes import plain_data
from suta_calib.words import listed

# A series and the number of one of its matrices: T1_0, pose12.
_NAME: Final = re.compile(r"(.*?)_?(\d{1,6})")
# Keys that say how many matrices a series has.
_COUNTS: Final = ("frameCount", "frame_count", "nframes", "count")


class OpencvStorageReader(Reader):
    """Matrices of one name and a running number are the poses of one body; two series are pairs."""

    name = "opencv-yaml"
    summary = "OpenCV FileStorage (YAML): 4x4 matrices T1_0, T1_1, …, one or two series"
    example = "poses.yml --format opencv-yaml --unit m --out pairs.csv"
    signature = re.compile(r"\A\s*%YAML:1\.0|<opencv_storage>|!!opencv-matrix")
    options = (*BODY_OPTIONS, UNIT, COMPLETE)
    suffixes = (".yml", ".yaml", ".xml")

    def read(self, path: Path, given: Given) -> ImportedRows:
        """Pairs ``a_…``, ``b_…`` of two series of as many matrices, or the series of ``--body``."""
        text = read_foreign_text(path)
        if text.lstrip().startswith("<"):
            raise ForeignFileError(
                "OpenCV's XML format",
                "its YAML format",
                file=path,
                hint="write the storage as .yml",
            )
        check_last_line(path, text, given)
        data, lines = plain_data(path, text, ForeignFileError)
        matrices_by_name = _matrices(path, data, lines)
        if not matrices_by_name:
            problem = f"no numbered 4x4 matrices among {listed(list(data))}"
            expected = "poses as T1_0, T1_1, …"
            hint = "a camera in such a file is read by the option --camera"
            raise ForeignFileError(problem, expected, file=path, hint=hint)
        # Of one series or of all: nothing says which.
        counts = [data[key] for key in _COUNTS if isinstance(data.get(key), int)]
        total = sum(map(len, matrices_by_name.values()))
        check_count(path, total, max(counts, default=0), "matrices", given)
        notes = [
            f"{key} is {stated}, but there are {len(matrices)} matrices {name}."
            for key, stated in data.items()
            for name, matrices in matrices_by_name.items()
            if key in _COUNTS and stated != len(matrices)
        ]
        series = {
            name: PoseSeries(
                np.array([numbers for _, (_, numbers) in ordered]).reshape(-1, 3, 4),
                [number for number, _ in ordered],
                [lines[(key,)] for _, (key, _) in ordered],
            )
            for name, matrices in matrices_by_name.items()
            for ordered in [sorted(matrices.items())]
        }
        rows = imported_series(path, self.name, series, given)
        return replace(rows, notes=(*notes, *rows.notes))


def _matrices(
    path: Path, data: Mapping[str, Any], lines: Mapping[KeyPath, int]
) -> dict[str, dict[int, tuple[str, list[float]]]]:
    """Matrices by series and number: the key of each, and twelve numbers by rows."""
    shapes = ((3, 4), (4, 4))
    by_series: dict[str, dict[int, tuple[str, list[float]]]] = {}
    matrices = [
        (key, match, value if isinstance(value, dict) else {})
        for key, value in data.items()
        if (match := _NAME.fullmatch(key))
    ]
    transforms = {match[1] for _, match, value in matrices if _shape(value) in shapes}
    for key, match, value in matrices:
        if match[1] not in transforms:
            continue
        numbers: Any = value.get("data")
        (rows, columns), problem = _shape(value), ""
        if (rows, columns) not in shapes or not isinstance(numbers, list):
            problem = f"a matrix of {rows} x {columns}" if value else "no matrix"
            expected = "a 4x4 matrix"
        elif len(numbers) != rows * columns or not all(map(_is_finite, numbers)):
            problem, expected = "other data", f"{rows * columns} finite numbers"
        elif numbers[12:] not in ([], [0.0, 0.0, 0.0, 1.0]):
            problem, expected = "a last row that is not 0 0 0 1", "a transform"
        if problem:
            line = lines[(key,)]
            raise ForeignFileError(problem, expected, file=path, line=line, where=key)
        series = by_series.setdefault(match[1] or "T", {})
        series[int(match[2])] = key, [*map(float, numbers[:12])]
    return by_series


def _shape(value: Mapping[str, Any]) -> tuple[Any, Any]:
    return value.get("rows"), value.get("cols")


def _is_finite(number: object) -> bool:
    return isinstance(number, int | float) and bool(np.isfinite(number))
