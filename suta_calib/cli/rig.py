"""``suta-calib rig``: poses between cameras that saw a board together."""

from __future__ import annotations

import click

from suta_calib.cli._options import NAMED, Folder, NamedFile, flag, option
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.cli._views import views_of
from suta_calib.pose_calibration.pictures import Intrinsics
from suta_calib.pose_calibration.rig import rig_from_pictures
from suta_calib.report.document import Document
from suta_calib.report.rig import rig_document


@answer_command
@option(
    "--corners",
    "Corners in the pictures of one camera, as EYE=FILE by name; repeat it for every camera.",
    NAMED,
    multiple=True,
    required=True,
)
@option("--board", "File of the board that all cameras saw.", NAMED, required=True)
@option(
    "--camera",
    "File of a camera, as EYE=FILE by name, or in the order of --corners.",
    NAMED,
    multiple=True,
    required=True,
)
@option(
    "--intrinsics",
    "Whether the cameras' files are used as they are, or corrected by the pictures.",
    click.Choice(["fixed", "free"]),
    "free",
)
@flag("--no-robust", "Use plain least squares with all corners and pictures.", name="plain")
@option("--out", "Folder for the results.", Folder())
def rig(
    corners: tuple[NamedFile, ...],
    board: NamedFile,
    camera: tuple[NamedFile, ...],
    intrinsics: Intrinsics,
    plain: bool,
) -> Document:
    """Find the poses between cameras (a stereo pair or a rig) from pictures of one board.

    No robot is needed. The cameras take their pictures together; pictures of one instant have one
    name in all files of corners, or one number (left_07.png, right_07.png). Find the corners and
    calibrate each camera by itself first: suta-calib detect. With --out it writes result.json,
    camchain.yaml (kalibr, with T_cn_cnm1), camera-NAME.yaml and report.html. The exit code is 1 if
    the poses must not be used.
    """
    if not any(file.name for file in (*corners, *camera)) and len(camera) != len(corners):
        raise click.UsageError(f"{len(camera)} --camera for {len(corners)} --corners: one for each")
    views, _ = views_of(corners, (board,), camera, None)
    with LateProgress("calibrating"):
        calibration = rig_from_pictures(views, intrinsics=intrinsics, robust=not plain)
    return rig_document(calibration).with_data(robust=not plain, intrinsics=intrinsics)
