"""The files of a closed problem on poses, as texts."""

from __future__ import annotations

from suta_calib.measurements.pose_files import Points, PosePairs, ToolPoses
from suta_calib.pose_calibration.hand_eye import HandEyeCalibration
from suta_calib.pose_calibration.pivot import PivotCalibration
from suta_calib.pose_calibration.registration import Registration
from suta_calib.report.files import json_text
from suta_calib.report.poses.json import tip_dict
from suta_calib.report.poses.plots import hand_eye_figure, pivot_figure, register_figure
from suta_calib.report.poses.residuals import (
    hand_eye_residuals,
    pivot_residuals,
    register_residuals,
)


def pivot_texts(found: PivotCalibration, data: ToolPoses) -> dict[str, str]:
    """``residuals.csv``, ``pivot.svg``, and ``tip.json`` where the tip may be used."""
    texts = {"residuals.csv": pivot_residuals(found, data), "pivot.svg": pivot_figure(found, data)}
    return texts | ({"tip.json": json_text(tip_dict(found))} if found.assessment.usable else {})


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
