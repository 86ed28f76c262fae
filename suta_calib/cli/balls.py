"""``suta-calib balls``: from clouds of points to the centres of balls."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from suta_calib.cli._clouds import cloud_options, clouds_to_read
from suta_calib.cli._options import PATH, WRITTEN, Folder, option
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.errors import InputError
from suta_calib.measurements.csv_table import number_in
from suta_calib.measurements.seen_points import write_seen_points
from suta_calib.report.balls import balls_document
from suta_calib.report.document import Document
from suta_calib.units import from_mm
from suta_calib.vision.balls import find_balls


def _radii(given: tuple[str, ...]) -> dict[str, float]:
    """Radii by name, m, of words NAME=MM."""
    radii = dict[str, float]()
    # Balls that a depth camera can see, mm: from a bead to a football.
    smallest, largest = 1.0, 500.0
    for word in given:
        name, _, number = word.partition("=")
        radius = number_in(number)
        if not name or not smallest <= radius <= largest:
            expected = f"NAME=RADIUS, in mm from {smallest:g} to {largest:g}, such as A=20"
            raise InputError(repr(word), expected, where="--ball")
        if name in radii:
            raise InputError(f"ball {name} twice", "each name once", where="--ball")
        radii[name] = from_mm(radius)
    return radii


@answer_command
@click.argument("clouds", type=PATH, metavar="CLOUDS…", nargs=-1, required=True)
@option(
    "--ball NAME=RADIUS",
    "Name of a ball, and its radius in mm; several balls have different radii.",
    multiple=True,
    required=True,
    name="given",
)
@option("--out POINTS.csv", "File for the centres that are found.", WRITTEN, name="file")
@cloud_options
@option("--report DIR", "Write balls.json and report.html there.", Folder(), name="out")
def balls(
    clouds: tuple[Path, ...],
    given: tuple[str, ...],
    file: Path | None,
    **reading: Any,
) -> Document:
    """Find balls in clouds of points, each centre with its ±.

    CLOUDS are files (PLY, PCD, NPY) or folders of them, in the frame of the camera that saw them;
    with --camera also pictures of depth.
    Jobs of points read the file of the centres. A ball is white and matt, and at least half of it
    is seen. The exit code is 2 if no ball is in any cloud.
    """
    radii = _radii(given)
    reader, found_files = clouds_to_read(clouds, file, **reading)
    with LateProgress("searching") as progress:
        search = find_balls(found_files, radii, reader, progress)
    answer = balls_document(search)
    written: dict[str, str] = {}
    if file is not None:
        write_seen_points(file, search.points)
        written["points_file"] = str(file)
    return answer.with_data(**written, input=[str(path) for path in clouds])
