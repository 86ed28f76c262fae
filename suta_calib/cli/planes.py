"""``suta-calib planes``: from clouds of points to the plane in each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from suta_calib.cli._clouds import cloud_options, clouds_to_read
from suta_calib.cli._options import PATH, WRITTEN, Folder, option
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.measurements.seen_points import write_seen_points
from suta_calib.report.document import Document
from suta_calib.report.planes import planes_document
from suta_calib.vision.planes import find_planes


@answer_command
@click.argument("clouds", type=PATH, metavar="CLOUDS…", nargs=-1, required=True)
@option("--name NAME", "What the plane is called; default: A.", default="A")
@option("--out PLANES.csv", "File for the planes that are found.", WRITTEN, name="file")
@cloud_options
@option("--report DIR", "Write planes.json and report.html there.", Folder(), name="out")
def planes(clouds: tuple[Path, ...], name: str, file: Path | None, **reading: Any) -> Document:
    """Find the largest plane in clouds of points, its normal and its distance with their ±.

    CLOUDS are files (PLY, PCD, NPY) or folders of them, in the frame of the depth camera or the
    scanner that saw them; with --camera also pictures of depth. Jobs of plane_view read the file of
    the planes: three points of each, whose heights err independently. Another plane has a name and
    a file of its own. The exit code is 2 if no cloud has a plane.
    """
    reader, found_files = clouds_to_read(clouds, file, **reading)
    with LateProgress("searching") as progress:
        search = find_planes(found_files, name, reader, progress)
    answer = planes_document(search)
    written: dict[str, str] = {}
    if file is not None:
        write_seen_points(file, search.points, "plane")
        written["planes_file"] = str(file)
    return answer.with_data(**written, input=[str(path) for path in clouds])
