"""``suta-calib hand-eye``: where the camera is on the robot, or beside it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from suta_calib.cli._formats import read_poses
from suta_calib.cli._options import (
    NAMED,
    PATH,
    POSITIVE,
    NamedFile,
    certify_option,
    flag,
    option,
    pose_options,
    scale_option,
)
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.cli._views import check_counts, views_of
from suta_calib.geometry.lens import LENSES
from suta_calib.measurements import read_board
from suta_calib.measurements.pose_files import read_hand_poses, read_pose_pairs, read_scan_poses
from suta_calib.measurements.profiles import read_profiles
from suta_calib.measurements.seen_points import read_seen_points
from suta_calib.pose_calibration import (
    depth_camera_from_files,
    hand_eye_from_pairs,
    line_scanner_from_files,
    many_eyes_from_pairs,
)
from suta_calib.pose_calibration.depth_camera import SCALE_PPM
from suta_calib.pose_calibration.loop_answer import with_scale
from suta_calib.pose_calibration.picture_proof import pictures_with_proof
from suta_calib.pose_calibration.pictures import hand_eye_from_pictures
from suta_calib.pose_calibration.proof import with_proof
from suta_calib.report.depth_camera import depth_camera_document
from suta_calib.report.document import Document
from suta_calib.report.hand_eye import hand_eye_document
from suta_calib.report.line_scanner import line_scanner_document
from suta_calib.report.many_eyes import many_eyes_document
from suta_calib.report.pictures import picture_document
from suta_calib.units import from_mm

if TYPE_CHECKING:
    from suta_calib.pose_calibration.eye_poses import Model
    from suta_calib.pose_calibration.pictures import Intrinsics
    from suta_calib.terms.hand_eye_start import EyeSetup


@answer_command
@click.argument("poses", type=PATH, metavar="POSES.csv")
@option(
    "--setup",
    "Whether the camera is on the hand, or fixed beside the robot.",
    click.Choice(["eye-in-hand", "eye-to-hand"]),
    "eye-in-hand",
)
@option(
    "--model",
    "Whether only X is estimated, or X and Z; of several eyes or targets by name, always both.",
    click.Choice(["AX=XB", "AX=ZB"]),
    "AX=XB",
)
@option(
    "--corners",
    "Corners of a board in pictures, as detect writes them; repeat it for every further camera, as "
    "EYE=FILE by name, or give one file with columns eye and target.",
    NAMED,
    multiple=True,
)
@option(
    "--board",
    "File of the board; one for all, one for each --corners, or TARGET=FILE by name.",
    NAMED,
    multiple=True,
)
@option(
    "--camera",
    "File of the camera, in the order of --corners, or EYE=FILE by name; default: none.",
    NAMED,
    multiple=True,
)
@option(
    "--lens MODEL",
    "Model of the lens without --camera: plumb_bob, rational_polynomial or equidistant (fisheye); "
    "default: the model that predicts left-out pictures best.",
    click.Choice([*LENSES]),
)
@option(
    "--intrinsics",
    "Whether the camera's file is used as it is, or corrected by the pictures.",
    click.Choice(["fixed", "free"]),
    "free",
)
@option(
    "--planes",
    "Planes that a depth camera saw, as planes writes them, in place of corners; repeat it for "
    "further files.",
    PATH,
    multiple=True,
)
@option(
    "--points",
    "Points that a depth camera saw, as balls or detect --points-out write them; repeat it for "
    "further files.",
    PATH,
    multiple=True,
)
@option("--profiles", "Profiles of a line scanner on the hand, in place of a camera.", PATH)
@option(
    "--sphere-radius-mm MM",
    "Radius of the ball in the profiles; default: unknown, it is found.",
    POSITIVE,
)
@flag("--plane", "The profiles show a plane, not a ball.")
@scale_option
@certify_option
@pose_options
def hand_eye(
    poses: Path,
    setup: EyeSetup,
    model: Model,
    corners: tuple[NamedFile, ...],
    board: tuple[NamedFile, ...],
    camera: tuple[NamedFile, ...],
    lens: str | None,
    intrinsics: Intrinsics,
    planes: tuple[Path, ...],
    points: tuple[Path, ...],
    profiles: Path | None,
    sphere_radius_mm: float | None,
    plane: bool,
    scale_ppm: float,
    certify: bool,
    plain: bool,
    seed: int,
) -> Document:
    """Find the pose of a camera or tracker (the eye) from poses of the hand and of a target.

    POSES.csv has the columns a_x,a_y,a_z,a_qx,a_qy,a_qz,a_qw: T_base_hand, and the same with b_:
    T_eye_target; m (a_x_mm, …: mm). X is T_hand_eye, and Z T_base_target; for eye-to-hand X is
    T_base_eye, and Z T_hand_target. With columns eye and target, the poses of all eyes and targets
    are found in one problem; X and Z are then given by name. With --out it writes result.json,
    residuals.csv, hand_eye.svg and report.html. The exit code is 1 if X must not be used.

    With --corners and --board the pictures replace the b_ columns: POSES.csv then contains the name
    of the picture taken at each pose (image). The reprojection errors are minimised, which is more
    accurate and also corrects the camera; --out then writes camera.yaml too. Without --camera the
    intrinsics are found from the pictures alone, and so is the model of the lens (or give --lens).
    --scale-ppm applies to the b_ columns: use 5000 for a printed target that was not measured.

    Several cameras and boards by name: --corners with columns eye and target, --camera EYE=FILE,
    --board TARGET=FILE. A row of POSES.csv is of every camera that has corners in a picture of its
    name; with a column eye it is of that camera alone.

    A depth camera: --planes or --points (or both) replace the b_ columns; with --board the points
    are its corners. POSES.csv then has the columns image,x,y,z,qx,qy,qz,qw (or a_x, …). Planes and
    points may stand anywhere, for eye-to-hand on the hand. One factor on all lengths of the camera
    is estimated too; --scale-ppm is its standard deviation beforehand (default: 5000).

    A line scanner on the hand: --profiles (columns scan, x, z), and --sphere-radius-mm or --plane.
    POSES.csv then has the columns scan,x,y,z,qx,qy,qz,qw. X is the scanner in the hand.
    """
    if planes or points:
        of_pictures = bool(corners or camera or lens) or intrinsics == "fixed"
        of_scanner = profiles is not None or plane or sphere_radius_mm is not None
        if of_pictures or of_scanner or certify:
            raise click.UsageError(
                "--planes and --points are for a depth camera, without --corners, --camera, "
                "--lens, --intrinsics, --certify and the options of a line scanner"
            )
        given = click.get_current_context().get_parameter_source("scale_ppm")
        stated = given is not click.core.ParameterSource.DEFAULT
        return _depth_camera(
            poses,
            planes,
            points,
            board,
            setup=setup,
            scale_ppm=scale_ppm if stated else SCALE_PPM,
            robust=not plain,
        )
    _check(corners, board, camera, intrinsics, lens)
    if profiles is not None or sphere_radius_mm is not None or plane:
        others = corners or certify or setup != "eye-in-hand"
        return _line_scanner(
            poses, profiles, sphere_radius_mm, others=bool(others), plane=plane, robust=not plain
        )
    if corners:
        hand = read_hand_poses(read_poses(poses, setup=setup))
        views, named = views_of(corners, board, camera, LENSES[lens] if lens else None)
        with LateProgress("calibrating"):
            pictured = hand_eye_from_pictures(
                hand,
                views,
                setup=setup,
                model="AX=ZB" if named else model,
                intrinsics=intrinsics,
                robust=not plain,
                seed=seed,
            )
            if certify:
                pictured = pictures_with_proof(pictured)
        return picture_document(pictured, hand, named=named).with_data(
            robust=not plain, seed=seed, intrinsics=intrinsics
        )

    data = read_pose_pairs(read_poses(poses, setup=setup))
    settings = {"robust": not plain, "seed": seed, "scale_ppm": scale_ppm}
    if data.several:
        with LateProgress("calibrating"):
            eyes = many_eyes_from_pairs(data, setup=setup, robust=not plain, seed=seed)
            eyes = with_scale(eyes, scale_ppm)
            if certify:
                eyes = with_proof(eyes)
        return many_eyes_document(eyes, data).with_data(**settings)
    with LateProgress("calibrating"):
        calibration = hand_eye_from_pairs(
            data, setup=setup, model=model, robust=not plain, seed=seed
        )
        calibration = with_scale(calibration, scale_ppm)
        if certify:
            calibration = with_proof(calibration)
    return hand_eye_document(calibration, data).with_data(**settings)


def _depth_camera(
    poses: Path,
    planes: tuple[Path, ...],
    points: tuple[Path, ...],
    board: tuple[NamedFile, ...],
    *,
    setup: EyeSetup,
    scale_ppm: float,
    robust: bool,
) -> Document:
    """The answer on planes and points."""
    if len(board) > 1 or (board and not points):
        raise click.UsageError("--board is one file, of the board whose corners --points are")
    hand = read_hand_poses(read_poses(poses, setup=setup))
    with LateProgress("calibrating"):
        answer = depth_camera_from_files(
            hand,
            planes=[read_seen_points(file, "plane", once=False) for file in planes],
            points=[read_seen_points(file) for file in points],
            board=read_board(board[0].path) if board else None,
            setup=setup,
            scale_ppm=scale_ppm,
            robust=robust,
        )
    files = {
        "planes_files": [str(file) for file in planes],
        "points_files": [str(file) for file in points],
    }
    return depth_camera_document(answer, hand).with_data(
        robust=robust, assumed_scale_ppm=scale_ppm, **files
    )


def _line_scanner(
    poses: Path,
    profiles: Path | None,
    radius_mm: float | None,
    *,
    others: bool,
    plane: bool,
    robust: bool,
) -> Document:
    """The answer on profiles."""
    if profiles is None:
        raise click.UsageError("--sphere-radius-mm and --plane need --profiles")
    if others:
        raise click.UsageError(
            "--profiles is for a line scanner on the hand, without --corners, --certify and "
            "--setup eye-to-hand"
        )
    if plane and radius_mm is not None:
        raise click.UsageError("give either --sphere-radius-mm or --plane, not both")
    data, radius = read_scan_poses(read_poses(poses)), None
    if radius_mm is not None:
        radius = from_mm(radius_mm)
    with LateProgress("calibrating"):
        answer = line_scanner_from_files(
            data, read_profiles(profiles), radius=radius, plane=plane, robust=robust
        )
    return line_scanner_document(answer, data).with_data(robust=robust, profiles=str(profiles))


def _check(
    corners: tuple[NamedFile, ...],
    board: tuple[NamedFile, ...],
    camera: tuple[NamedFile, ...],
    intrinsics: str,
    lens: str | None,
) -> None:
    """Which options go together."""
    if not corners:
        if board or camera or lens or intrinsics == "fixed":
            raise click.UsageError("--board, --camera, --lens and --intrinsics need --corners")
        return
    if not board:
        raise click.UsageError("--corners needs --board, the file of the board in the pictures")
    check_counts(corners, board, camera)
    if lens and camera:
        raise click.UsageError("--camera names its lens: give either --camera or --lens, not both")
    if intrinsics == "fixed" and not camera:
        raise click.UsageError("--intrinsics fixed needs --camera, the file that is used")
