"""``suta-calib hand-eye``: where the camera is on the robot, or beside it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from suta_calib.cli._formats import read_poses
from suta_calib.cli._options import PATH, option, pose_options, scale_option
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.measurements import read_board, read_camera, read_corners
from suta_calib.measurements.pose_files import read_hand_poses, read_pose_pairs
from suta_calib.pose_calibration import hand_eye_from_pairs
from suta_calib.pose_calibration.hand_eye import with_scale
from suta_calib.pose_calibration.pictures import View, hand_eye_from_pictures
from suta_calib.report.document import Document
from suta_calib.report.hand_eye import hand_eye_document
from suta_calib.report.pictures import picture_document

if TYPE_CHECKING:
    from suta_calib.measurements import Camera
    from suta_calib.pose_calibration.eye_poses import Model
    from suta_calib.pose_calibration.pictures import Intrinsics, View
    from suta_calib.terms.hand_eye_start import EyeSetup


@answer_command
@click.argument("poses", type=PATH, metavar="POSES.csv")
@option(
    "--setup",
    "The camera is on the hand, or stands beside the robot.",
    click.Choice(["eye-in-hand", "eye-to-hand"]),
    "eye-in-hand",
)
@option("--model", "Ask for X, or for X and Z.", click.Choice(["AX=XB", "AX=ZB"]), "AX=XB")
@option(
    "--corners",
    "Corners of a board in pictures, as detect finds them; again for every other camera.",
    PATH,
    multiple=True,
)
@option("--board", "board.yaml; one for all, or one for each --corners.", PATH, multiple=True)
@option("--camera", "camera.yaml, in the order of --corners, or none.", PATH, multiple=True)
@option(
    "--intrinsics",
    "Believe the camera's file, or correct it by the pictures (default).",
    click.Choice(["fixed", "free"]),
    "free",
)
@scale_option
@pose_options
def hand_eye(
    poses: Path,
    setup: EyeSetup,
    model: Model,
    corners: tuple[Path, ...],
    board: tuple[Path, ...],
    camera: tuple[Path, ...],
    intrinsics: Intrinsics,
    scale_ppm: float,
    plain: bool,
    seed: int,
) -> Document:
    """Find where the eye is from poses of the hand and of what the eye sees.

    POSES.csv has the columns a_x,a_y,a_z,a_qx,a_qy,a_qz,a_qw: T_base_hand, and the same with b_:
    T_eye_target; m (a_x_mm, …: mm). X is T_hand_eye, and Z T_base_target; for eye-to-hand X is
    T_base_eye, and Z T_hand_target. With --out writes result.json, residuals.csv, hand_eye.svg and
    report.html. Exits with 1 where X must not be used.

    With --corners and --board the eye's pictures take the place of the b_ columns: POSES.csv then
    names the picture taken at each pose (image), and reprojection errors are minimised, which is
    nearer and also corrects the camera; --out writes camera.yaml too. Without --camera its
    intrinsics are found from the pictures alone. --scale-ppm is of the b_ columns: of a printed
    target that nobody measured, 5000.
    """
    _check(corners, board, camera, intrinsics)
    if corners:
        hand, views = (
            read_hand_poses(read_poses(poses, setup=setup)),
            _views(corners, board, camera),
        )
        with LateProgress("calibrating"):
            pictured = hand_eye_from_pictures(
                hand,
                views,
                setup=setup,
                model=model,
                intrinsics=intrinsics,
                robust=not plain,
                seed=seed,
            )
        return picture_document(pictured, hand).with_data(
            robust=not plain, seed=seed, intrinsics=intrinsics
        )

    data = read_pose_pairs(read_poses(poses, setup=setup))
    with LateProgress("calibrating"):
        calibration = hand_eye_from_pairs(
            data, setup=setup, model=model, robust=not plain, seed=seed
        )
        calibration = with_scale(calibration, scale_ppm)
    return hand_eye_document(calibration, data).with_data(
        robust=not plain, seed=seed, scale_ppm=scale_ppm
    )


def _check(
    corners: tuple[Path, ...], board: tuple[Path, ...], camera: tuple[Path, ...], intrinsics: str
) -> None:
    """Which options go together."""
    if not corners:
        if board or camera or intrinsics == "fixed":
            raise click.UsageError("--board, --camera and --intrinsics belong to --corners")
        return
    if not board:
        raise click.UsageError("--corners needs --board: the board.yaml of what was seen")
    if len(board) not in (1, len(corners)):
        raise click.UsageError(f"{len(board)} --board for {len(corners)} --corners: one, or each")
    if len(camera) not in (0, len(corners)):
        raise click.UsageError(
            f"{len(camera)} --camera for {len(corners)} --corners: none, or each"
        )
    if intrinsics == "fixed" and not camera:
        raise click.UsageError("--intrinsics fixed needs --camera: the file to believe")


def _views(
    corners: tuple[Path, ...], board: tuple[Path, ...], camera: tuple[Path, ...]
) -> list[View]:
    """What every camera saw; cameras and boards are called as their files, or numbered."""
    boards = [read_board(file) for file in board] * (len(corners) if len(board) == 1 else 1)
    of_board = [str(file.resolve()) for file in board] * (len(corners) if len(board) == 1 else 1)
    targets = {name: str(k + 1) for k, name in enumerate(dict.fromkeys(of_board))}
    cameras: list[Camera | None] = [read_camera(file) for file in camera]
    cameras = cameras or [None] * len(corners)
    stems = [file.stem for file in corners]
    unique = len(set(stems)) == len(stems)
    return [
        View(
            "default" if len(corners) == 1 else stem if unique else str(k + 1),
            read_corners(file),
            boards[k],
            cameras[k],
            "default" if len(targets) == 1 else targets[of_board[k]],
        )
        for k, (file, stem) in enumerate(zip(corners, stems, strict=True))
    ]
