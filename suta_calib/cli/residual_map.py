"""``suta-calib residual-map``: what a calibration leaves, where left-out data prove it."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.analysis.residual_map import ResidualMapOptions
from suta_calib.analysis.residual_map import residual_map as find_residual_map
from suta_calib.analysis.residual_map.search import EXTRA
from suta_calib.cli._options import PATH, anyway_option, chain_option, out_option, seed_option
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.optional_packages import require
from suta_calib.report.document import Document
from suta_calib.report.residual_map import residual_map_document
from suta_calib.tracking.read_back import job_of


@answer_command
@click.argument("job", type=PATH, metavar="JOB|RESULT", is_eager=True)
@chain_option
@anyway_option
@seed_option("Seed of the blocks that are left out.")
@out_option
def residual_map(job: Path, chain: str, anyway: bool, seed: int) -> Document:
    """Find a smooth error of the tip that the calibration of JOB leaves, with its uncertainty.

    JOB is a calibration.yaml; RESULT is a result.json, or its folder, whose job is run again. After
    the calibration, a Gaussian process is fitted to the errors of the tip: as a curve of each
    joint, and as a function of the posture. It is used only if rows that were left out in blocks
    prove it. Then residual_map.py, which needs no other package, and residual_map.csv are written.
    A URDF cannot hold this correction.

    This command needs the extra maps: pip install 'suta_calib[maps]'.
    """
    require("sklearn", EXTRA)
    loaded = job_of(job)
    # Refused before anything is solved.
    _ = loaded.arm.chosen(chain)
    options = ResidualMapOptions(seed, chain, anyway)
    with LateProgress("calibrating") as progress:
        calibration = loaded.run(progress, progress.about)
    with LateProgress("fitting maps") as progress:
        return residual_map_document(find_residual_map(calibration, options, progress))
