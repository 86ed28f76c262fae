"""``suta-calib pivot``: the tip of a tracked tool."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.cli._output import check_folder
from suta_calib.cli._poses import LateStatus, finish, pose_options


@click.command()
@click.argument("poses", type=click.Path(path_type=Path), metavar="POSES.csv")
@pose_options
@click.pass_context
def pivot(
    context: click.Context, poses: Path, out: Path | None, as_json: bool, plain: bool, seed: int
) -> None:
    """Find the tip of a tool from poses while it rests on one point and is turned about it.

    POSES.csv has the columns x,y,z,qx,qy,qz,qw: the pose T_tracker_tool, m (x_mm,y_mm,z_mm: mm).
    With a column point there are several posts, told apart by its labels: --json has them all as
    posts_mm, and as post_mm that of the first row. With --out writes result.json, residuals.csv,
    pivot.svg and tip.json. Exits with 1 where the tip must not be used; then tip.json is not
    written.
    """
    from suta_calib.measurements.pose_files import read_tool_poses
    from suta_calib.pose_calibration.error_context import error_context
    from suta_calib.pose_calibration.pivot import calibrate_pivot
    from suta_calib.report.poses.files import pivot_texts
    from suta_calib.report.poses.json import pivot_dict
    from suta_calib.report.poses.tables import pivot_tables

    if out is not None:
        check_folder(out)
    data = read_tool_poses(poses)
    with error_context(poses), LateStatus("calibrating"):
        found = calibrate_pivot(
            data.rotation, data.position, data.point, robust=not plain, seed=seed
        )
    finish(
        context,
        pivot_dict(found, data) | {"robust": not plain, "seed": seed},
        found.assessment,
        lambda: pivot_tables(found, data),
        lambda: pivot_texts(found, data),
        out,
        as_json=as_json,
    )
