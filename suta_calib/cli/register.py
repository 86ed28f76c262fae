"""``suta-calib register``: one set of points onto another."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.cli._output import check_folder
from suta_calib.cli._poses import LateStatus, finish, pose_options


@click.command()
@click.argument("a", type=click.Path(path_type=Path), metavar="A.csv")
@click.argument("b", type=click.Path(path_type=Path), metavar="B.csv")
@click.option(
    "--target",
    type=click.Path(path_type=Path),
    metavar="T.csv",
    help="Points in A's frame at which the error to expect is wanted.",
)
@pose_options
@click.pass_context
def register(
    context: click.Context,
    a: Path,
    b: Path,
    target: Path | None,
    out: Path | None,
    as_json: bool,
    plain: bool,
    seed: int,
) -> None:
    """Find T_b_a, which takes the points of A.csv onto those of B.csv.

    The files have the columns x,y,z, m (x_mm,y_mm,z_mm: mm), and their rows correspond. With --out
    writes result.json, residuals.csv and register.svg. Exits with 1 where T_b_a must not be used.
    """
    from suta_calib.measurements.pose_files import read_corresponding_points, read_points
    from suta_calib.pose_calibration.error_context import error_context
    from suta_calib.pose_calibration.registration import register as register_points
    from suta_calib.report.poses.files import register_texts
    from suta_calib.report.poses.json import register_dict
    from suta_calib.report.poses.tables import register_tables

    if out is not None:
        check_folder(out)
    points = read_corresponding_points(a, b)
    targets = None if target is None else read_points(target)
    with error_context(a, f"registered to {b}"), LateStatus("registering"):
        found = register_points(points[0].position, points[1].position, robust=not plain, seed=seed)
    finish(
        context,
        register_dict(found, *points, targets) | {"robust": not plain, "seed": seed},
        found.assessment,
        lambda: register_tables(found, points[0], targets, b=points[1]),
        lambda: register_texts(found, *points),
        out,
        as_json=as_json,
    )
