"""``residuals.csv`` of the closed problems: one row for every row of the input."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.measurements.pose_files import Points, PosePairs, ToolPoses
from suta_calib.pose_calibration.hand_eye import HandEyeCalibration
from suta_calib.pose_calibration.pivot import PivotCalibration
from suta_calib.pose_calibration.registration import Registration
from suta_calib.units import SHOWN, Unit

LENGTH: Final = ("x_mm", "y_mm", "z_mm", "norm_mm")
TURN: Final = ("rx_deg", "ry_deg", "rz_deg", "norm_deg")
Columns = Mapping[str, Sequence[object]]


def pivot_residuals(found: PivotCalibration, data: ToolPoses) -> str:
    """``R_iᵀ (c - p_i) - t`` in the tool, mm, as CSV text."""
    points = {} if data.point is None else {"point": [str(label) for label in data.point]}
    return _text({"line": data.lines, **points}, found.inliers, _lengths(found.residuals))


def hand_eye_residuals(found: HandEyeCalibration, data: PosePairs) -> str:
    """``A_i X B_i`` against Z, mm and deg, as CSV text."""
    turns = _with_norm(found.rotation_residuals, "rad", TURN)
    return _text({"line": data.lines}, found.inliers, _lengths(found.position_residuals) | turns)


def register_residuals(found: Registration, a: Points, b: Points) -> str:
    """``R a_i + p - b_i`` in frame b, mm, as CSV text."""
    lines = {"line_a": a.lines, "line_b": b.lines}
    return _text(lines, found.inliers, _lengths(found.residuals))


def _lengths(vectors: FloatArray) -> dict[str, list[str]]:
    return _with_norm(vectors, "m", LENGTH)


def _with_norm(vectors: FloatArray, unit: Unit, names: Sequence[str]) -> dict[str, list[str]]:
    norms = np.linalg.norm(vectors, axis=1)
    columns = SHOWN[unit].per_si * np.column_stack([vectors, norms]).T
    return {
        name: [f"{value:.6g}" for value in column]
        for name, column in zip(names, columns, strict=True)
    }


def _text(places: Columns, inliers: BoolArray, numbers: Columns) -> str:
    columns: dict[str, Sequence[object]] = {
        "row": range(len(inliers)),
        **places,
        **numbers,
        "status": ["inlier" if fitted else "outlier" for fitted in inliers],
    }
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return text.getvalue()
