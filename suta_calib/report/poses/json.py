"""The closed problems' answers as JSON data: mm and degrees by name, 4x4 matrices in m."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.assessment import Assessment, Level
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.measurements.pose_files import Points, PosePairs, ToolPoses
from suta_calib.pose_calibration.hand_eye import HandEyeCalibration
from suta_calib.pose_calibration.pivot import PivotCalibration
from suta_calib.pose_calibration.registration import Registration
from suta_calib.units import SHOWN

MM: Final = SHOWN["m"].per_si
DEG: Final = SHOWN["rad"].per_si
POSE_STD_KEYS: Final = ("x_mm", "y_mm", "z_mm", "rx_deg", "ry_deg", "rz_deg")
POSE_KEYS: Final = ("x", "y", "z", "rx", "ry", "rz")
# What X and Z are, by where the eye is.
FRAMES: Final = {
    "eye-in-hand": {"X": "T_hand_eye", "Z": "T_base_target"},
    "eye-to-hand": {"X": "T_base_eye", "Z": "T_hand_target"},
}
Json = dict[str, Any]


def pivot_dict(found: PivotCalibration, data: ToolPoses) -> Json:
    """Tip, posts and their standard deviations, mm.

    ``post_mm`` is the post of the first row; ``posts_mm`` has all of them by label, where the file
    has a column ``point``.
    """
    answer: Json = {
        "tip_mm": _mm(found.tip),
        "tip_std_mm": _mm(found.tip_std),
        "post_mm": _mm(found.post),
        "post_std_mm": _mm(found.post_std()),
    }
    if data.point is not None:
        answer["posts_mm"] = {name: _mm(post) for name, post in found.posts.items()}
        answer["posts_std_mm"] = {name: _mm(found.post_std(name)) for name in found.posts}
    order = [f"{name}.{axis}" for name in ("tip", *found.posts) for axis in "xyz"]
    return answer | {
        "rms_mm": MM * found.rms,
        "sigma_mm": MM * found.sigma,
        "turn_deg": DEG * found.turn,
        **_rows(found.inliers, data.lines),
        "covariance": _covariance(found.covariance, order, "m²"),
        "verdict": verdict_on(found, data).as_dict(),
        "input": str(data.path),
    }


def tip_dict(found: PivotCalibration) -> Json:
    """``tip.json``: the tool for whoever goes on with it."""
    return {"tip_mm": _mm(found.tip), "tip_std_mm": _mm(found.tip_std)}


def hand_eye_dict(found: HandEyeCalibration, data: PosePairs) -> Json:
    """X, and Z where the model asks for it, with standard deviations."""
    names = asked_for(found)
    answer: Json = {"setup": found.setup, "model": found.model}
    for name in names:
        answer[name] = getattr(found, name).tolist()
    answer["frames"] = {name: FRAMES[found.setup][name] for name in names}
    answer["std"] = {name: _pose_std(found.std[name]) for name in names}
    for name in names:
        answer[f"{name}_position_mm"] = _mm(getattr(found, name)[:3, 3])
        answer[f"{name}_rpy_deg"] = rpy_deg(getattr(found, name))
        answer[f"{name}_quaternion_xyzw"] = quaternion(getattr(found, name))
    size = 6 * len(names)
    order = [f"{name}.{key}" for name in names for key in POSE_KEYS]
    return answer | {
        "rms_mm": MM * found.rms,
        "rms_deg": DEG * found.rms_angle,
        "hand_share": found.robot_noise_fraction,
        **_rows(found.inliers, data.lines),
        "covariance": _covariance(found.covariance[:size, :size], order, "m, rad"),
        "verdict": verdict_on(found, data).as_dict(),
        "input": str(data.path),
    }


def register_dict(found: Registration, a: Points, b: Points, targets: Points | None) -> Json:
    """``T_b_a`` with its standard deviations, and the error to expect at the targets.

    ``std`` is that of the position of a's origin in b, and of a turn about b's axes;
    ``std_at_centre`` that of the middle of the points, where it is least.
    """
    answer: Json = {
        "T_b_a": found.matrix.tolist(),
        "position_mm": _mm(found.position),
        "rpy_deg": rpy_deg(found.matrix),
        "quaternion_xyzw": quaternion(found.matrix),
        "rms_mm": MM * found.rms,
        "sigma_mm": MM * found.sigma,
        "std": _pose_std(origin_std(found)),
        "std_at_centre": _pose_std(np.sqrt(np.diag(found.covariance))),
        "centre_mm": _mm(found.centre),
        **_rows(found.inliers, a.lines),
        "covariance": _covariance(found.covariance, POSE_KEYS, "m, rad; at the centre, axes of b"),
    }
    if targets is not None:
        answer["targets"] = _targets(found, targets)
    return answer | {
        "verdict": verdict_on(found, a, b, targets).as_dict(),
        "input": {"a": str(a.path), "b": str(b.path)},
    }


def asked_for(found: HandEyeCalibration) -> tuple[str, ...]:
    """Which of X and Z the model speaks of."""
    return ("X", "Z") if found.model == "AX=ZB" else ("X",)


def origin_std(found: Registration) -> FloatArray:
    """Standard deviations (6,) of ``T_b_a``: its position, m, and a turn about b's axes, rad."""
    position = found.target_covariance(np.zeros((1, 3)))[0]
    return np.asarray(np.sqrt([*np.diag(position), *np.diag(found.covariance)[3:]]))


def rpy_deg(pose: FloatArray) -> list[float]:
    """Roll, pitch, yaw of a 4x4 pose, as in URDF."""
    return [DEG * float(angle) for angle in rpy_from_rotation(pose[:3, :3])]


def quaternion(pose: FloatArray) -> list[float]:
    """Quaternion x y z w of a 4x4 pose, w ≥ 0."""
    return [float(v) for v in Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)]


def verdict_on(
    found: PivotCalibration | HandEyeCalibration | Registration,
    *files: ToolPoses | PosePairs | Points | None,
) -> Assessment:
    """How far to trust an answer, and what its files themselves give to think about."""
    assessment = found.assessment
    notes = [note for file in files if file is not None for note in file.unit_notes]
    level: Level = "care" if notes and assessment.level == "good" else assessment.level
    return replace(assessment, level=level, notes=(*assessment.notes, *notes))


def _targets(found: Registration, targets: Points) -> list[Json]:
    moved, error = found.act(targets.position), found.target_error(targets.position)
    covariance = found.target_covariance(targets.position)
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return [
        {
            "row": row,
            "line": line,
            "a_mm": _mm(targets.position[row]),
            "b_mm": _mm(moved[row]),
            "std_mm": _mm(std[row]),
            "error_mm": MM * float(error[row]),
        }
        for row, line in enumerate(targets.lines)
    ]


def _rows(inliers: BoolArray, lines: Sequence[int]) -> Json:
    outliers = [int(row) for row in np.flatnonzero(~inliers)]
    count = len(inliers)
    return {
        "outliers": outliers,
        "outlier_lines": [lines[row] for row in outliers],
        "counts": {
            "rows": count,
            "inliers": count - len(outliers),
            "outliers": len(outliers),
        },
    }


def _covariance(matrix: FloatArray, order: Sequence[str], unit: str) -> Json:
    return {"order": list(order), "unit": unit, "matrix": matrix.tolist()}


def _pose_std(std: FloatArray) -> dict[str, float]:
    shown = std * np.repeat([MM, DEG], 3)
    return {key: float(value) for key, value in zip(POSE_STD_KEYS, shown, strict=True)}


def _mm(values: FloatArray) -> list[float]:
    return [MM * float(value) for value in values]
