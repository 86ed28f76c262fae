"""``suta-calib hand-eye``: where the camera is on the robot, or beside it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from suta_calib.cli._options import PATH, pose_options
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.report.document import Document

if TYPE_CHECKING:
    from suta_calib.pose_calibration.hand_eye import Model, Setup


@answer_command
@click.argument("poses", type=PATH, metavar="POSES.csv")
@click.option(
    "--setup",
    type=click.Choice(["eye-in-hand", "eye-to-hand"]),
    default="eye-in-hand",
    help="The camera is on the hand, or stands beside the robot.",
)
@click.option(
    "--model",
    type=click.Choice(["AX=XB", "AX=ZB"]),
    default="AX=XB",
    help="Ask for X, or for X and Z.",
)
@pose_options
def hand_eye(
    poses: Path,
    setup: Setup,
    model: Model,
    plain: bool,
    seed: int,
) -> Document:
    """Find where the eye is from poses of the hand and of what the eye sees.

    POSES.csv has the columns a_x,a_y,a_z,a_qx,a_qy,a_qz,a_qw: T_base_hand, and the same with b_:
    T_eye_target; m (a_x_mm, …: mm). X is T_hand_eye, and Z T_base_target; for eye-to-hand X is
    T_base_eye, and Z T_hand_target. With --out writes result.json, residuals.csv and hand_eye.svg.
    Exits with 1 where X must not be used.
    """
    from suta_calib.measurements.pose_files import read_pose_pairs
    from suta_calib.pose_calibration import hand_eye_from_pairs
    from suta_calib.report.hand_eye import hand_eye_document

    data = read_pose_pairs(poses)
    with LateProgress("calibrating"):
        found = hand_eye_from_pairs(data, setup=setup, model=model, robust=not plain, seed=seed)
    return hand_eye_document(found, data).with_data(robust=not plain, seed=seed)
