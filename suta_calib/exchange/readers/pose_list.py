"""Lists of poses in YAML or JSON: 4x4 matrices, or translations with quaternions.

Programs for hand-eye calibration keep their samples so, each with other names: moveit_calibration
(``effector_wrt_world``, ``object_wrt_sensor``), easy_handeye (``hand_world_samples``,
``camera_marker_samples``), easy_handeye2 (``samples`` with ``robot`` and ``tracking``).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import read_foreign_text
from suta_calib.exchange.imported import ImportedRows
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.pose_series import PoseSeries, imported_series
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.rotations import rotations_from
from suta_calib.exchange.table_roles import UNIT
from suta_calib.exchange.tracked_bodies import BODY_OPTIONS
from suta_calib.exchange.truncated import COMPLETE, check_last_line
from suta_calib.measurements.yaml_file import KeyPath
from suta_calib.measurements.yaml_nodes import plain_data

# What a pose's two parts are called, and one number of them.
_PLACES: Final = ("translation", "position", "t", "trans", "tvec", "xyz", "p")
_TURNS: Final = {
    "xyzw": ("rotation", "orientation", "quaternion", "q", "quat", "xyzw"),
    "wxyz": ("wxyz", "q_wxyz"),
    "vector": ("rvec", "rotation_vector", "rotvec"),
}
_MATRIX: Final = ("R", "rot", "rotation", "rotation_matrix")
# Keys of the picture that was taken at a pose.
_PICTURES: Final = ("image", "image_file", "image_path", "img", "file", "filename", "picture")
# Keys that say nothing of what the poses are of.
_PLAIN: Final = re.compile(r"samples|transforms?|poses?|data|matrix|T|list|values|\d+", re.I)
_NUMBERED: Final = re.compile(r"(.*?)[_-]?(\d{1,6})")
BESIDE: Final = "eye-to-hand"
SETUP: Final = Option(
    "setup",
    "Place of the camera: for a camera beside the robot, easy_handeye records inverse hand poses.",
    choices=("eye-in-hand", BESIDE),
)
# The hand's series by that of the target, as easy_handeye2 and easy_handeye call them.
_EASY_HANDEYE: Final = {"tracking": "robot", "camera_marker_samples": "hand_world_samples"}


class _Pose(NamedTuple):
    series: str
    frame: int | str
    numbers: FloatArray
    line: int


class PoseListReader(Reader):
    """One list is the poses of a body; two lists, or two poses in each sample, are pairs."""

    name = "pose-list"
    summary = "YAML or JSON lists of poses: moveit_calibration, easy_handeye, or 4x4 matrices"
    example = "samples.yaml --format pose-list --out pairs.csv"
    options = (*BODY_OPTIONS, UNIT, SETUP, COMPLETE)
    suffixes = (".yaml", ".yml", ".json", ".samples")

    def recognises(self, path: Path, head: str) -> bool:
        """Whether its beginning has numbers of a pose, and no other format's words."""
        del path
        if re.search(r"%YAML:1\.0|opencv-matrix|cam_R_|rows:|camera_matrix|homing_offset", head):
            return False
        number = r"[-+]?\d[\d.eE+-]*"
        sixteen = rf"(?:{number}[\s,\[\]-]+){{11,}}"
        named = r"\b(?:translation|position|tvec|trans|xyz|t)\"?\s*:"
        turned = r"\b(?:rotation|orientation|quaternion|rvec|xyzw|wxyz|R)\"?\s*:"
        return bool(
            re.search(sixteen, head) or (re.search(named, head) and re.search(turned, head))
        )

    def read(self, path: Path, given: Given) -> ImportedRows:
        """Every pose in the file, in series by the names around them."""
        text = read_foreign_text(path)
        if path.suffix.lower() != ".json":
            check_last_line(path, text, given)
        data, lines = _document(path, text)
        poses = list(_poses(path, data, (), lines))
        if not poses:
            raise ForeignFileError(
                "no poses",
                "4x4 matrices (16 numbers, or 4 lists of 4), or translation and rotation",
                file=path,
            )
        series: dict[str, list[_Pose]] = {}
        for pose in poses:
            series.setdefault(pose.series, []).append(pose)
        by_name = {
            name: PoseSeries(
                np.stack([pose.numbers for pose in members]),
                [pose.frame for pose in members],
                [pose.line for pose in members],
            )
            for name, members in series.items()
        }
        hand = next((h for t, h in _EASY_HANDEYE.items() if {h, t} == {*by_name}), "")
        if not hand or given.text(SETUP) != BESIDE:
            return imported_series(path, self.name, by_name, given)
        by_name[hand] = by_name[hand].inverted
        rows = imported_series(path, self.name, by_name, given)
        remark = (
            "With the camera beside the robot, easy_handeye records the base in the hand as "
            f"{hand}: these poses were inverted."
        )
        return replace(rows, remarks=(*rows.remarks, remark))


def _document(path: Path, text: str) -> tuple[dict[str, Any], Mapping[KeyPath, int]]:
    """A file whose top level may be a list, as a mapping of the one key ``samples``."""
    lines_of_text = text.splitlines(keepends=True)
    empty = re.compile(r"\s*(#.*)?$|---\s*$")
    start = next((k for k, line in enumerate(lines_of_text) if not empty.match(line)), 0)
    body = "".join(lines_of_text[start:])
    if not body.startswith(("-", "[")):
        return plain_data(path, text, ForeignFileError)
    inside = "samples: " if body.startswith("[") else "samples:\n"
    data, lines = plain_data(path, inside + body, ForeignFileError)
    return data, {key: line + start - inside.count("\n") for key, line in lines.items()}


def _poses(
    path: Path, value: Any, where: KeyPath, lines: Mapping[KeyPath, int], picture: str = ""
) -> Iterator[_Pose]:
    """All poses at and below a value, in the file's order; a picture beside them names them."""
    if isinstance(value, dict):
        picture = next((value[k] for k in _PICTURES if isinstance(value.get(k), str)), picture)
    line = next((lines[where[:k]] for k in range(len(where), 0, -1) if where[:k] in lines), 1)
    numbers = _numbers(path, value, line)
    if numbers is not None:
        series, frame = _name(where)
        yield _Pose(series, picture or frame, numbers, line)
        return
    if not isinstance(value, dict | list):
        return
    for key, part in value.items() if isinstance(value, dict) else enumerate(value):
        yield from _poses(path, part, (*where, key), lines, picture)


def _name(where: KeyPath) -> tuple[str, int | str]:
    """The series that a pose belongs to, by the keys around it, and its number there."""
    names, frame = [], next((key for key in reversed(where) if isinstance(key, int)), 0)
    for key in where:
        match = _NUMBERED.fullmatch(key) if isinstance(key, str) else None
        if match is not None:
            frame = int(match[2])
            key = match[1]
        if isinstance(key, str) and key and not _PLAIN.fullmatch(key):
            names.append(key)
    return ".".join(names) or "pose", frame


def _numbers(path: Path, value: Any, line: int) -> FloatArray | None:
    """(3, 4) of a value that is a pose; None of anything else."""
    if isinstance(value, list):
        return _matrix(path, value, line)
    if not isinstance(value, dict):
        return None
    place = next((_vector(value[key], "xyz") for key in _PLACES if key in value), None)
    if place is None and {*"xyz"} <= {*value}:
        place = _vector(value, "xyz")
    if place is None:
        return None
    rotation = _rotation(path, value, line)
    return None if rotation is None else np.column_stack([rotation, place])


def _matrix(path: Path, value: list[Any], line: int) -> FloatArray | None:
    """(3, 4) of 12 or 16 numbers by rows, flat or nested."""
    flat = [n for part in value for n in part] if all(isinstance(p, list) for p in value) else value
    if len(flat) not in (12, 16) or not all(_is_number(n) for n in flat):
        return None
    if len(flat) == 12 and len(value) not in (3, 12):
        return None
    numbers = np.array(flat, float).reshape(-1, 4)
    if len(numbers) == 4 and not np.allclose(numbers[3], (0, 0, 0, 1), atol=1e-9):
        if np.allclose(numbers[:, 3], (0, 0, 0, 1), atol=1e-9):
            return numbers.T[:3]
        problem = "a 4x4 matrix whose last row is not 0 0 0 1"
        raise ForeignFileError(problem, "a transform", file=path, line=line)
    return numbers[:3]


def _rotation(path: Path, value: Mapping[str, Any], line: int) -> FloatArray | None:
    """(3, 3) of what stands beside a translation."""
    for key in _MATRIX:
        nine = value.get(key)
        if isinstance(nine, list) and np.size(nine) == 9:
            return _turned("rows", np.array(nine, float).reshape(1, 9), path, line)
    for form, names in _TURNS.items():
        for key in names:
            turn = _vector(value.get(key), "xyzw" if form != "vector" else "xyz")
            if turn is not None:
                return _turned(form, turn[None], path, line)
    turn = _vector(
        {key[1:]: value[key] for key in ("qx", "qy", "qz", "qw") if key in value}, "xyzw"
    )
    return None if turn is None else _turned("xyzw", turn[None], path, line)


def _turned(form: str, numbers: FloatArray, path: Path, line: int) -> FloatArray:
    """(3, 3) of numbers (1, …) in one of the forms of `rotations_from`."""
    return np.asarray(rotations_from(form, numbers, path, [line])[0])


def _vector(value: Any, names: str) -> FloatArray | None:
    """Numbers of a list, or of a mapping of these names; None of anything else."""
    if isinstance(value, dict):
        value = [value.get(name) for name in names]
    elif isinstance(value, list) and len(value) and all(isinstance(v, list) for v in value):
        value = [n for part in value for n in part]
    if not isinstance(value, list) or len(value) != len(names) or not all(map(_is_number, value)):
        return None
    return np.array(value, float)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value)
