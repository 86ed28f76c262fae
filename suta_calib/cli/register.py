"""``suta-calib register``: one set of points onto another."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.cli._formats import read_poses
from suta_calib.cli._options import PATH, certify_option, option, pose_options, scale_option
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.measurements.pose_files import read_corresponding_points, read_points
from suta_calib.pose_calibration import registration_from_points
from suta_calib.pose_calibration.proof import with_proof
from suta_calib.report.document import Document
from suta_calib.report.registration import register_document


@answer_command
@click.argument("a", type=PATH, metavar="A.csv")
@click.argument("b", type=PATH, metavar="B.csv")
@option("--target T.csv", "Points in frame A for which the expected error is computed.", PATH)
@scale_option
@certify_option
@pose_options
def register(
    a: Path,
    b: Path,
    target: Path | None,
    scale_ppm: float,
    certify: bool,
    plain: bool,
    seed: int,
) -> Document:
    """Find T_b_a, the rigid transform from the points of A.csv to those of B.csv.

    The files have the columns x,y,z, m (x_mm,y_mm,z_mm: mm), and their rows belong together.
    Columns sigma_x,sigma_y,sigma_z or sigma (m, or with _mm) are standard deviations, which weight
    the rows. With --out it writes result.json, residuals.csv, register.svg and report.html. The
    exit code is 1 if T_b_a must not be used.
    """
    points = read_corresponding_points(read_poses(a), read_poses(b))
    targets = None if target is None else read_points(read_poses(target))
    with LateProgress("registering"):
        registration = registration_from_points(
            *points, targets, robust=not plain, seed=seed, scale_ppm=scale_ppm
        )
        if certify:
            registration = with_proof(registration)
    return register_document(registration, *points, targets).with_data(
        robust=not plain, seed=seed, scale_ppm=scale_ppm
    )
