"""``suta-calib path-accuracy``: how well a recorded motion follows a reference."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.cli._options import (
    PATH,
    FiniteRange,
    Folder,
    flag,
    option,
    optional_arm,
    urdf_option,
)
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.inputs import UrdfFile
from suta_calib.report.document import Document
from suta_calib.report.path_accuracy import path_accuracy_document
from suta_calib.tracking.path_accuracy import compare
from suta_calib.tracking.trajectory import read_trajectory


@answer_command
@click.argument("recorded", type=PATH, metavar="RECORDED.csv")
@click.argument("reference", type=PATH, metavar="REFERENCE.csv")
@urdf_option("URDF of the arm, for hysteresis per joint.")
@option("--tip", "Link or frame of the arm whose motion was recorded.")
@option("--base", "Link in which the recording is given; default: the root link.")
@flag(
    "--register",
    "Register the files first, because they are in different frames.",
    name="registered",
)
@option(
    "--max-latency",
    "Largest latency that is searched, in both directions, in s.",
    FiniteRange(min=1e-3),
    0.5,
)
@option("--out", "Folder for result.json and dynamics.svg.", Folder())
def path_accuracy(
    recorded: Path,
    reference: Path,
    urdf: UrdfFile | None,
    tip: str | None,
    base: str | None,
    registered: bool,
    max_latency: float,
) -> Document:
    """Compare a recorded motion with a reference: errors, latency, and direction reversals.

    Both files have the columns time (s, one clock) and x,y,z (m; x_mm,y_mm,z_mm: mm), and
    qx,qy,qz,qw if orientations are compared. RECORDED.csv may come from track --csv: with --urdf
    and its joint columns the hysteresis of every joint is found, and removed from the latency. The
    exit code is 1 if the motions do not determine the latency (it is at the end of the searched
    range, the motion repeats itself, or there is only noise), or if most of the error is a fault of
    the recording (a wrong clock, a tracker that keeps the same value, a knock).
    """
    arm = optional_arm(urdf, tip, base, "was recorded")
    motions = read_trajectory(recorded, arm), read_trajectory(reference)
    with LateProgress("comparing"):
        accuracy = compare(*motions, arm, registered=registered, largest_latency=max_latency)
    return path_accuracy_document(accuracy)
