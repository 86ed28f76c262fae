"""``suta-calib pivot``: the tip of a tracked tool."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.cli._formats import read_poses
from suta_calib.cli._options import PATH, certify_option, pose_options, scale_option
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.measurements.pose_files import read_tool_poses
from suta_calib.pose_calibration import pivot_from_poses
from suta_calib.pose_calibration.proof import with_proof
from suta_calib.report.document import Document
from suta_calib.report.pivot import pivot_document


@answer_command
@click.argument("poses", type=PATH, metavar="POSES.csv")
@scale_option
@certify_option
@pose_options
def pivot(poses: Path, scale_ppm: float, certify: bool, plain: bool, seed: int) -> Document:
    """Find the tip of a tool from poses taken while it rests on one point and is tilted about it.

    POSES.csv has the columns x,y,z,qx,qy,qz,qw: the pose T_tracker_tool, m (x_mm,y_mm,z_mm: mm).
    With a column point there are several posts, one for each label; --json has all of them as
    posts_mm, and the one of the first row as post_mm. With --out it writes result.json,
    residuals.csv, pivot.svg, report.html and tip.json. If the tip must not be used, the exit code
    is 1 and tip.json is not written.
    """
    data = read_tool_poses(read_poses(poses))
    with LateProgress("calibrating"):
        calibration = pivot_from_poses(data, robust=not plain, seed=seed, scale_ppm=scale_ppm)
        if certify:
            calibration = with_proof(calibration)
    return pivot_document(calibration, data).with_data(
        robust=not plain, seed=seed, scale_ppm=scale_ppm
    )
