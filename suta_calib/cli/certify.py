"""``suta-calib certify``: from raw points on an artefact to its file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import click

from suta_calib.atomic import check_outputs
from suta_calib.certification import CertificationOptions, read_raw_points, write_certified
from suta_calib.certification import certify as certified
from suta_calib.cli._options import PATH, WRITTEN, FiniteRange, Folder, option
from suta_calib.cli._output import answer_command
from suta_calib.measurements import read_artefact
from suta_calib.pose_calibration.inputs import error_context
from suta_calib.report.certification import certification_document
from suta_calib.report.document import Document
from suta_calib.units import from_deg, from_mm, from_um

LENGTH: Final = FiniteRange(min=0, min_open=True, max=1e6)


@answer_command
@click.argument("points", type=PATH, metavar="POINTS.csv")
@option("--out FILE.yaml", "File for the certified artefact.", WRITTEN, name="file")
@option(
    "--nominal DRAWING.yaml", "Drawing of the artefact to compare with, as an artefact.yaml.", PATH
)
@option(
    "--report DIR", "Write certify.json, certify.svg and report.html there.", Folder(), name="out"
)
@option(
    "--sigma-um",
    "Standard deviation of one touched coordinate; default: estimated from the scatter of the "
    "touches.",
    LENGTH,
)
@option(
    "--tolerance-mm",
    "Largest acceptable deviation; default: a pillar is damaged if it deviates from all others.",
    LENGTH,
)
@option(
    "--probe-radius-mm",
    "Radius of the ball, if the points are its centres: flats and spacers then measure two radii "
    "less.",
    FiniteRange(min=0, max=1e3),
    0.0,
)
@option("--origin NAME", "Landmark with x = y = 0; default: O, or the first one.", default="")
@option(
    "--front-deg",
    "Direction of the front flat in the frame of the seated tip: angle from the x axis about z "
    "(up).",
    FiniteRange(-360, 360),
    0.0,
)
@option("--name", "Name of the artefact; default: the name of the file.", default="")
@option(
    "--spacer NAME=MM",
    "Nominal length of a spacer; may be repeated.",
    name="spacers",
    multiple=True,
)
def certify(
    points: Path,
    file: Path | None,
    nominal: Path | None,
    sigma_um: float | None,
    tolerance_mm: float | None,
    probe_radius_mm: float,
    origin: str,
    front_deg: float,
    name: str,
    spacers: tuple[str, ...],
) -> Document:
    """Certify an artefact: raw laser tracker points in, artefact.yaml out.

    POINTS.csv has the columns feature,landmark,index,x,y,z (m; x_mm,y_mm,z_mm: mm). Features:
    ground; top (five per landmark); hole (four, in order around the pillar); flat (0 front, 1
    back); side; spacer (ends in pairs). The exit code is 1 if a landmark is damaged.
    """
    if file is not None:
        check_outputs([file], [points, nominal])
    raw = read_raw_points(points)
    options = CertificationOptions(
        name=" ".join(name.split()),
        sigma=None if sigma_um is None else from_um(sigma_um),
        origin=origin,
        probe_radius=from_mm(probe_radius_mm),
        front=from_deg(front_deg),
        drawing=None if nominal is None else read_artefact(nominal),
        tolerance=None if tolerance_mm is None else from_mm(tolerance_mm),
        spacers=_lengths(spacers),
    )
    with error_context(points):
        certification = certified(raw, options)
    answer = certification_document(certification)
    if file is not None:
        write_certified(file, certification)
        answer = answer.with_data(artefact=str(file))
    return answer


def _lengths(spacers: tuple[str, ...]) -> dict[str, float]:
    """Nominal lengths by name, m."""
    lengths = {}
    for given in spacers:
        name, _, text = given.rpartition("=")
        try:
            length = from_mm(float(text))
        except ValueError:
            length = math.nan
        if not name or not 0 < length < math.inf:
            raise click.BadParameter(
                f"found {given!r}; expected NAME=LENGTH in mm, such as A=40", param_hint="--spacer"
            )
        lengths[name.strip()] = length
    return lengths
