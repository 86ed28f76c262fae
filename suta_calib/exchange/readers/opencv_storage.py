"""OpenCV: YAML that ``cv::FileStorage`` writes, with 4x4 matrices by name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.bodies import BODY, BODY_OPTIONS, REFERENCE, Body, Recording
from suta_calib.exchange.cells import read_foreign_text
from suta_calib.exchange.cut_off import COMPLETE, check_count, check_end_of_yaml
from suta_calib.exchange.imported import ImportedRows, checked_places, distance_note, pose_columns
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.rotations import rotations_from
from suta_calib.exchange.table_roles import UNIT
from suta_calib.measurements.yaml_file import KeyPath
from suta_calib.measurements.yaml_nodes import plain_data
from suta_calib.units import from_mm
from suta_calib.words import listed

# A series and the number of one of its matrices: T1_0, pose12.
_NAME: Final = re.compile(r"(.*?)_?(\d{1,6})")
# Keys that say how many matrices a series has.
_COUNTS: Final = ("frameCount", "frame_count", "nframes", "count")
_PREFIXES: Final = ("a_", "b_")


class OpencvStorageReader(Reader):
    """Matrices of one name and a running number are the poses of one body; two series are pairs."""

    name: ClassVar[str] = "opencv-yaml"
    summary: ClassVar[str] = (
        "OpenCV FileStorage (YAML): 4x4 matrices T1_0, T1_1, …, one or two series"
    )
    example: ClassVar[str] = "poses.yml --format opencv-yaml --unit m --out pairs.csv"
    options: ClassVar[tuple[Option, ...]] = (*BODY_OPTIONS, UNIT, COMPLETE)
    suffixes: ClassVar[tuple[str, ...]] = (".yml", ".yaml", ".xml")

    def recognises(self, path: Path, head: str) -> bool:
        """OpenCV's first line, or its matrices."""
        del path
        begin = head.lstrip()
        storage = begin.startswith("%YAML:1.0") or "<opencv_storage>" in head
        return storage or "!!opencv-matrix" in head

    def read(self, path: Path, given: Given) -> ImportedRows:
        """Pairs ``a_…``, ``b_…`` of two series of as many matrices, or the series of ``--body``."""
        text = read_foreign_text(path)
        if text.lstrip().startswith("<"):
            raise ForeignFileError(
                "OpenCV's XML", "its YAML", file=path, hint="write the storage as .yml"
            )
        check_end_of_yaml(path, text, given)
        data, lines = plain_data(path, text, ForeignFileError)
        series = _series(path, data, lines)
        if not series:
            raise ForeignFileError(
                f"no 4x4 matrices with a number in their names among {listed(list(data))}",
                "poses as T1_0, T1_1, …",
                file=path,
                hint="a camera in such a file is read where --camera asks for one",
            )
        # Of one series or of all: nothing says which.
        counts = [data[key] for key in _COUNTS if isinstance(data.get(key), int)]
        check_count(path, sum(map(len, series.values())), max(counts, default=0), "matrices", given)
        unit = given.text(UNIT, "m")
        if unit not in ("m", "mm"):
            raise given.refuse(UNIT, repr(unit), "m or mm")
        bodies = {name: _body(path, matrices, lines, unit) for name, matrices in series.items()}
        unit_text = f"in {unit}" + ("" if UNIT in given else f", unless {UNIT.switch} says else")
        numbers = {tuple(sorted(matrices)) for matrices in series.values()}
        pair = len(bodies) == len(_PREFIXES) and BODY not in given
        if len(numbers) > 1 and (pair or REFERENCE in given):
            lengths = " and ".join(f"{len(matrices)} {name}" for name, matrices in series.items())
            raise ForeignFileError(
                f"matrices of other numbers: {lengths}",
                "the same numbers in each, so that the matrices are pairs",
                file=path,
                hint=f"say {BODY.switch} {next(iter(series))} for one of them",
            )
        notes = [
            f"{key} is {stated}, and there are {len(matrices)} matrices {name}."
            for key, stated in data.items()
            for name, matrices in series.items()
            if key in _COUNTS and stated != len(matrices)
        ]
        if pair:
            rows = self._pairs(path, bodies, unit_text)
        else:
            rows = Recording(path, bodies, None, unit_text).imported(self.name, given)
        return replace(rows, notes=(*notes, *rows.notes))

    def _pairs(self, path: Path, bodies: Mapping[str, Body], unit_text: str) -> ImportedRows:
        """Rows of a hand-eye problem, of two bodies of as many poses."""
        columns: dict[str, NDArray[Any]] = {}
        for prefix, body in zip(_PREFIXES, bodies.values(), strict=True):
            columns |= pose_columns(body.position, body.rotation, prefix)
        hand, target = bodies
        notes = [
            f"{hand} is taken for the hand in the base (a_), {target} for the target in the eye "
            f"(b_): if they are others, take each with {BODY.switch}."
        ]
        asked = (distance_note(body.position, f"lengths {unit_text}") for body in bodies.values())
        return ImportedRows(
            source=path,
            form=self.name,
            columns=columns,
            notes=(*notes, *filter(None, asked)),
            remarks=(f"Lengths are {unit_text}.",),
        )


def _series(
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
    last_row = (0.0, 0.0, 0.0, 1.0)
    for key, match, value in matrices:
        if match[1] not in transforms:
            continue
        numbers, shape = value.get("data"), _shape(value)
        line = lines[(key,)]
        if shape not in shapes or not isinstance(numbers, list):
            problem = f"a matrix of {shape[0]} x {shape[1]}" if value else "no matrix"
            raise ForeignFileError(problem, "a 4x4 matrix", file=path, line=line, where=key)
        count = shape[0] * shape[1]
        finite = all(isinstance(n, int | float) and np.isfinite(n) for n in numbers)
        if len(numbers) != count or not finite:
            expected = f"{count} finite numbers"
            raise ForeignFileError("other data", expected, file=path, line=line, where=key)
        if tuple(numbers[12:]) not in ((), last_row):
            problem = "a last row that is not 0 0 0 1"
            raise ForeignFileError(problem, "a transform", file=path, line=line, where=key)
        by_series.setdefault(match[1] or "T", {})[int(match[2])] = (
            key,
            [*map(float, numbers[:12])],
        )
    return by_series


def _shape(value: Mapping[str, Any]) -> tuple[Any, Any]:
    return value.get("rows"), value.get("cols")


def _body(
    path: Path,
    matrices: Mapping[int, tuple[str, list[float]]],
    lines: Mapping[KeyPath, int],
    unit: str,
) -> Body:
    ordered = [matrices[number] for number in sorted(matrices)]
    at = [lines[(key,)] for key, _ in ordered]
    numbers = np.array([values for _, values in ordered]).reshape(-1, 3, 4)
    position = numbers[:, :, 3] if unit == "m" else from_mm(numbers[:, :, 3])
    rotation = rotations_from("rows", numbers[:, :, :3].reshape(-1, 9), path, at)
    return Body(checked_places(path, at, position), rotation)
