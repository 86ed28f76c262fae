"""Report of a hand-eye calibration: pose of the eye, fit of the pairs, rotations of the hand."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from suta_calib import report
from suta_calib.measurements.pose_files import PosePairs
from suta_calib.model.parameters import PLACEMENT
from suta_calib.pose_calibration.eye_poses import FRAMES
from suta_calib.pose_calibration.hand_eye import HandEyeCalibration
from suta_calib.pose_calibration.loop_answer import LoopAnswer
from suta_calib.pose_calibration.picture_answer import CameraEstimate, PictureCalibration
from suta_calib.report.document import Document, Figure, Part
from suta_calib.report.listing import Column, Json, Listing, Table
from suta_calib.report.poses import (
    covariance_record,
    fit_texts,
    fitted_rows,
    pose_record,
    pose_std_record,
    pose_table,
    residuals_file,
)
from suta_calib.report.uncertainty import budget_record
from suta_calib.units import text

NAME: Final = "hand_eye"
CALIBRATION: Final = Listing[LoopAnswer](
    "",
    Column("rms", unit="m"),
    Column("rms", value=lambda row: row.rms_angle, unit="rad"),
    Column("hand_share", value=lambda row: row.robot_noise_fraction),
    Column("distance_trend", value=lambda row: row.trend.share, unit="%"),
    Column("distance_trend_std", value=lambda row: row.trend.std, unit="%"),
)


def hand_eye_document(calibration: HandEyeCalibration, data: PosePairs) -> Document:
    """X, and Z where the model asks for it, with standard deviations; ``residuals.csv``."""
    names, frames = calibration.unknowns, FRAMES[calibration.setup]
    parts: list[Part] = [*frame_tables(calibration)]
    record: Json = {"setup": calibration.setup, "model": calibration.model}
    for name in names:
        pose = getattr(calibration, name)
        record |= {name: pose, **pose_record(pose, f"{name}_")}
    fit = (
        f"rms {text(calibration.rms, 'm', with_unit=True)} (3-D), "
        f"{text(calibration.rms_angle, 'rad', with_unit=True)}"
    )
    residuals, turns = calibration.residuals, calibration.rotation_residuals
    parts += [
        *fit_texts(fit, "pair", calibration, data.lines),
        residuals_file(calibration.inliers, {"line": data.lines}, residuals, turns),
        Figure(lambda: report.hand_eye_plot(calibration)),
    ]
    size = 6 * len(names)
    order = [f"{name}.{key}" for name in names for key in PLACEMENT]
    record |= {
        "frames": {name: frames[name] for name in names},
        "std": {name: pose_std_record(calibration.std[name]) for name in names},
        **CALIBRATION.record(calibration),
        **fitted_rows(calibration, data.lines),
        "covariance": covariance_record(calibration.covariance[:size, :size], order, "m, rad"),
        "uncertainty": [budget_record(budget) for budget in calibration.budgets],
        "input": str(data.path),
    }
    about = NAME, "Hand-eye calibration", calibration.assessment
    return Document(*about, parts, record, "result", calibration.in_a_line)


def frame_tables(
    calibration: HandEyeCalibration | PictureCalibration,
    eye: HandEyeCalibration | CameraEstimate | None = None,
) -> Iterator[Table]:
    """X, and Z where the model asks for it, of an eye in words with their standard deviations."""
    answer: Any = eye or calibration
    for name in calibration.unknowns:
        frame = FRAMES[calibration.setup][name]
        _, base, what = frame.split("_")
        title = f"{name} = {frame}: the {what} in the {base}, {calibration.setup}"
        yield pose_table(title, getattr(answer, name), answer.std[name], f"the {what}'s axes")
