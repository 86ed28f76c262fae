"""``suta-calib detect``: from a folder of pictures to corners, and the camera."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import click

from suta_calib.assessment import Assessment
from suta_calib.atomic import check_outputs
from suta_calib.cli._options import PATH, WRITTEN, Folder, flag, length_unit, option, page_options
from suta_calib.cli._output import (
    LateProgress,
    answer_command,
    open_page,
    say_line,
)
from suta_calib.errors import BoardError, InputError, OutputError
from suta_calib.geometry.lens import LENSES
from suta_calib.guide.live_pictures import LiveOptions, LivePictures
from suta_calib.measurements import Board, read_board, read_camera, write_camera, write_corners
from suta_calib.measurements.seen_points import write_seen_points
from suta_calib.report.detect import detect_document
from suta_calib.report.document import Document
from suta_calib.vision import (
    CameraFitOptions,
    DetectionOptions,
    board_depth,
    find_depth,
    find_pictures,
)
from suta_calib.vision import detect as detected


@dataclass(frozen=True)
class _Request:
    """What the command is asked for, as its options have it."""

    images: tuple[Path, ...]
    board_file: Path
    file: Path | None
    known: Path | None
    lens: str | None
    camera_out: Path | None
    depth: Path | None
    step: float | None
    points_out: Path | None
    pictures: bool

    @property
    def outputs(self) -> list[Path]:
        """Files that are written."""
        return [path for path in (self.file, self.camera_out, self.points_out) if path is not None]

    def answered(self, board: Board) -> Document:
        """Corners and camera from the pictures that are there."""
        found_files = find_pictures(self.images)
        check_outputs(
            self.outputs, [self.board_file, self.known, *(found.path for found in found_files)]
        )
        camera = None if self.known is None else read_camera(self.known)
        options = DetectionOptions(
            camera=CameraFitOptions(lens=LENSES[self.lens] if self.lens else None)
        )
        with LateProgress("searching") as progress:
            try:
                detection = detected(found_files, board, camera, options, progress)
            except BoardError as problem:
                raise BoardError.of(problem, self.board_file, problem.line) from None
        in_depth = None
        if self.depth is not None:
            files = find_depth(found_files, self.depth)
            check_outputs(self.outputs, [*files.values()])
            with LateProgress("reading depth") as progress:
                in_depth = board_depth(detection, files, self.step, progress)
        if self.camera_out is not None and detection.fit is None:
            reason = next(iter(detection.assessment.notes), "")
            raise InputError(
                "pictures that do not determine the camera",
                "pictures that determine it",
                hint=reason,
            )
        answer = detect_document(detection, pictures=self.pictures, depth=in_depth)
        written: dict[str, str] = {}
        if self.file is not None and detection.assessment.usable:
            write_corners(self.file, detection.corners)
            written["corners_file"] = str(self.file)
        if (
            self.camera_out is not None
            and detection.fit is not None
            and detection.assessment.usable
        ):
            write_camera(self.camera_out, detection.fit.camera)
            written["camera_file"] = str(self.camera_out)
        if self.points_out is not None and in_depth is not None and detection.assessment.usable:
            write_seen_points(self.points_out, in_depth.points)
            written["points_file"] = str(self.points_out)
        return answer.with_data(**written, input=[str(path) for path in self.images])


@answer_command
@click.argument("images", type=PATH, metavar="IMAGES…", nargs=-1, required=True)
@option("--board BOARD.yaml", "File of the board in the pictures.", PATH, required=True)
@option("--out CORNERS.csv", "File for the corners that are found.", WRITTEN, name="file")
@option(
    "--camera CAMERA.yaml",
    "File of the camera, if it is calibrated; default: it is calibrated from these pictures.",
    PATH,
    name="known",
)
@option(
    "--lens MODEL",
    "Model of the lens, if it is known: plumb_bob, rational_polynomial or equidistant (fisheye); "
    "default: the model that predicts left-out pictures best.",
    click.Choice([*LENSES]),
)
@option("--camera-out CAMERA.yaml", "File for the calibrated camera.", WRITTEN)
@option(
    "--depth FOLDER",
    "Folder of depth that belongs to the pictures pixel by pixel, by their names: 16-bit PNG or "
    "TIFF, floating-point TIFF, or NPY. The corners are then found in 3-D too.",
    PATH,
    name="depth",
)
@option(
    "--depth-unit UNIT",
    "Unit of the depth: mm, m, or how many m one step is, such as 0.0002; default: mm for whole "
    "numbers, m for others.",
    length_unit,
    name="step",
)
@option("--points-out POINTS.csv", "File for the corners in 3-D, of --depth.", WRITTEN)
@option(
    "--report DIR", "Write detect.json, pictures (SVG) and report.html there.", Folder(), name="out"
)
@flag("--pictures", "Also write each picture, with the corners found in it.")
@flag(
    "--live",
    "Show pictures on a page in the browser as they come into the folder IMAGES: what is found in "
    "them, what they cover, and what to show next. The button Calibrate goes on.",
)
@option(
    "--video NUMBER",
    "With --live: take the pictures with this camera of the computer, such as 0, and save them in "
    "IMAGES. One is taken when the board is held still and shows something new.",
    default="",
)
@page_options
def detect(
    images: tuple[Path, ...],
    board: Path,
    file: Path | None,
    known: Path | None,
    lens: str | None,
    camera_out: Path | None,
    depth: Path | None,
    step: float | None,
    points_out: Path | None,
    pictures: bool,
    live: bool,
    video: str,
    port: int,
    host: str,
    no_open: bool,
) -> Document:
    """Find the corners of a board in pictures, and calibrate the camera that took them.

    IMAGES are picture files or folders of them. Pictures that cannot be used are listed and left
    out. `hand-eye --corners` and jobs of camera_view read the files of corners and camera, jobs of
    points the corners in 3-D. The exit code is 1 if the camera's file does not fit the pictures,
    or the pictures do not determine the camera.
    """
    if depth is None and (points_out is not None or step is not None):
        raise click.UsageError(
            "--points-out and --depth-unit need the folder of the depth: --depth"
        )
    if known is not None and camera_out is not None:
        raise click.UsageError(
            "give either --camera (the camera is known) or --camera-out (it is calibrated), not "
            "both"
        )
    if known is not None and lens is not None:
        raise click.UsageError("--camera names its lens: give either --camera or --lens, not both")
    if pictures and click.get_current_context().params["out"] is None:
        raise click.UsageError("--pictures needs a folder for the pictures: give --report")
    request = _Request(
        *(images, board, file, known, lens, camera_out, depth, step, points_out, pictures)
    )
    for path in request.outputs:
        if not path.parent.is_dir() or path.is_dir():
            what = "a folder" if path.is_dir() else f"no folder {path.parent}"
            raise OutputError(f"{path}: found {what}; expected a file in an existing folder")
    if video and not live:
        raise click.UsageError("--video shows what it takes on a page: give --live too")
    sought = read_board(board)
    if not live:
        return request.answered(sought)
    if len(images) != 1 or images[0].is_file():
        raise click.UsageError("--live needs one folder as IMAGES")
    say = partial(say_line, stderr=True)
    with LivePictures(LiveOptions(images[0], sought, video, port, host), say) as taking:
        open_page(taking.url, no_open=no_open, stderr=True)
        taking.run()
        taking.calibrating()
        try:
            answer = request.answered(sought)
        except InputError as problem:
            taking.conclude(Assessment.of(bad=[str(problem)]), ())
            raise
        written = [path for path in request.outputs if path.is_file()]
        taking.conclude(answer.assessment, tuple(written))
    return answer
