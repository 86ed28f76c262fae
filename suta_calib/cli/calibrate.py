"""``suta-calib calibrate``: solve a job, write its results, say what was found."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.cli._options import job_argument, json_option, out_option, verbose_option
from suta_calib.cli._output import LateProgress, finish, folder_of


@click.command()
@job_argument
@out_option
@json_option
@verbose_option
@click.pass_context
def calibrate(
    context: click.Context, job: Path, out: Path | None, as_json: bool, verbose: bool
) -> None:
    """Calibrate the arm of JOB (a calibration.yaml) from its measurements.

    Writes calibrated.urdf, result.json, residuals.csv and report.html. Exits with 1 where the
    answer must not be used: not converged, residuals that swamp the data, or worse than nominal on
    validation data. Then no calibrated.urdf is written.
    """
    from suta_calib.job.calibration import CalibrationJob
    from suta_calib.report.calibration import calibration_document

    loaded = CalibrationJob.load(job)
    folder = folder_of(job, out)
    with LateProgress("solving") as progress:
        result = loaded.run(progress)
    finish(context, calibration_document(result, verbose=verbose), folder, as_json=as_json)
