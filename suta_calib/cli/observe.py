"""``suta-calib observe``: what a job's data can and cannot determine, before any solving."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.cli._options import job_argument, json_option, verbose_option
from suta_calib.cli._output import finish


@click.command()
@job_argument
@json_option
@verbose_option
@click.pass_context
def observe(context: click.Context, job: Path, as_json: bool, verbose: bool) -> None:
    """Say what the data of JOB (a calibration.yaml) can and cannot determine.

    Nothing is solved: the answer follows from the readings, the nominal arm and the assumed
    noise. For each parameter the data cannot tell it says why, and what to measure instead.
    """
    from suta_calib.diagnostics.observability import observe as look
    from suta_calib.job.calibration import CalibrationJob
    from suta_calib.report.observability import observability_document

    found = look(CalibrationJob.load(job).problem())
    finish(context, observability_document(found, verbose=verbose), None, as_json=as_json)
