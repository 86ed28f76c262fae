"""The files of a closed problem on poses, each complete or not there."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from suta_calib.atomic import write_bytes_atomically
from suta_calib.errors import OutputError
from suta_calib.measurements.pose_files import Points, PosePairs, ToolPoses
from suta_calib.navigation.hand_eye import HandEyeCalibration
from suta_calib.navigation.pivot import PivotCalibration
from suta_calib.navigation.registration import Registration
from suta_calib.report.pose_json import Json, tip_dict
from suta_calib.report.pose_plots import hand_eye_figure, pivot_figure, register_figure
from suta_calib.report.pose_residuals import (
    hand_eye_residuals,
    pivot_residuals,
    register_residuals,
)
from suta_calib.report.write import make_folder

RESULT: Final = "result.json"


def pivot_texts(found: PivotCalibration, data: ToolPoses) -> dict[str, str]:
    """``residuals.csv``, ``pivot.svg``, and ``tip.json`` where the tip may be used."""
    texts = {"residuals.csv": pivot_residuals(found, data), "pivot.svg": pivot_figure(found, data)}
    return texts | ({"tip.json": json_text(tip_dict(found))} if found.verdict.usable else {})


def hand_eye_texts(found: HandEyeCalibration, data: PosePairs) -> dict[str, str]:
    """``residuals.csv`` and ``hand_eye.svg``."""
    return {
        "residuals.csv": hand_eye_residuals(found, data),
        "hand_eye.svg": hand_eye_figure(found),
    }


def register_texts(found: Registration, a: Points, b: Points) -> dict[str, str]:
    """``residuals.csv`` and ``register.svg``."""
    return {
        "residuals.csv": register_residuals(found, a, b),
        "register.svg": register_figure(found, b),
    }


def write_pose_files(answer: Json, texts: Mapping[str, str], folder: Path) -> Json:
    """Write ``texts`` and then ``result.json``, so that whoever waits for it finds the others.

    Args:
        answer: content of ``result.json``.
        texts: whole contents by file name.
        folder: created if it is not there.

    Returns:
        ``answer`` with ``files``, the paths written by name; what ``result.json`` holds.

    Raises:
        OutputError: the folder or a file in it cannot be written. Where that can be seen before,
            nothing is written.
    """
    paths = {name: folder / name for name in (*texts, RESULT)}
    complete = answer | {"files": {name: str(path) for name, path in paths.items()}}
    contents = {**texts, RESULT: json_text(complete)}
    _check_targets(list(paths.values()))
    make_folder(folder)
    for name, path in paths.items():
        write_bytes_atomically(path, contents[name].encode())
    return complete


def json_text(data: Json) -> str:
    """A JSON document as it is written to a file; what is not a finite number becomes null."""
    finite = json.loads(json.dumps(data), parse_constant=lambda _: None)
    return json.dumps(finite, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _check_targets(paths: list[Path]) -> None:
    for path in paths:
        if path.is_dir():
            raise OutputError(
                f"{path}: not written: found a folder of this name; expected a file or nothing; "
                "choose another folder with --out"
            )
