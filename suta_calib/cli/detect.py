"""``suta-calib detect``: from a folder of pictures to corners, and the camera."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.atomic import check_outputs
from suta_calib.cli._options import PATH, WRITTEN, Folder, flag, option
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.errors import BoardError, InputError, OutputError
from suta_calib.measurements import read_board, read_camera, write_camera, write_corners
from suta_calib.report.detect import detect_document
from suta_calib.report.document import Document
from suta_calib.vision import detect as detected
from suta_calib.vision import find_pictures


@answer_command
@click.argument("images", type=PATH, metavar="IMAGES…", nargs=-1, required=True)
@option("--board BOARD.yaml", "What is to be seen.", PATH, required=True)
@option("--out CORNERS.csv", "The corners' file.", WRITTEN, name="file")
@option(
    "--camera CAMERA.yaml",
    "The camera, if it is calibrated; from these pictures without.",
    PATH,
    name="known",
)
@option("--camera-out CAMERA.yaml", "The calibrated camera.", WRITTEN)
@option(
    "--report DIR", "Write detect.json, detect.svg and report.html there.", Folder(), name="out"
)
@flag("--pictures", "And each picture, with what was found in it.")
def detect(
    images: tuple[Path, ...],
    board: Path,
    file: Path | None,
    known: Path | None,
    camera_out: Path | None,
    pictures: bool,
) -> Document:
    """Find a board's corners in pictures, and calibrate the camera that took them.

    IMAGES are files, or folders of them. A picture that cannot be used is named and left out. The
    files of corners and camera are those that `hand-eye --corners` and jobs of camera_view read.
    Exits with 1 where the camera's file does not fit, or the pictures determine no camera.
    """
    if known is not None and camera_out is not None:
        raise click.UsageError(
            "--camera says which camera it is, and --camera-out asks for it: give one of them"
        )
    if pictures and click.get_current_context().params["out"] is None:
        raise click.UsageError("--pictures needs a folder to write them into: give --report")
    outputs = [each for each in (file, camera_out) if each is not None]
    for path in outputs:
        if not path.parent.is_dir() or path.is_dir():
            what = "a folder" if path.is_dir() else f"no folder {path.parent}"
            raise OutputError(f"{path}: found {what}; expected a file in a folder that exists")
    found_files = find_pictures(images)
    check_outputs(outputs, [board, known, *(each.path for each in found_files)])
    sought = read_board(board)
    camera = None if known is None else read_camera(known)
    with LateProgress("searching") as progress:
        try:
            detection = detected(found_files, sought, camera, progress=progress)
        except BoardError as problem:
            raise BoardError.of(problem, board, problem.line) from None
    if camera_out is not None and detection.fit is None:
        reason = next(iter(detection.assessment.notes), "")
        raise InputError("pictures that determine no camera", "some that do", hint=reason)
    answer = detect_document(detection, pictures=pictures)
    written: dict[str, str] = {}
    if file is not None and detection.assessment.usable:
        write_corners(file, detection.corners)
        written["corners_file"] = str(file)
    if camera_out is not None and detection.fit is not None and detection.assessment.usable:
        write_camera(camera_out, detection.fit.camera)
        written["camera_file"] = str(camera_out)
    return answer.with_data(**written, input=[str(path) for path in images])
