"""``suta-calib observe``: what a job's data can and cannot determine, before any solving."""

from __future__ import annotations

from pathlib import Path

from suta_calib.cli._options import job_argument
from suta_calib.cli._output import answer_command
from suta_calib.job.calibration import CalibrationJob
from suta_calib.report.document import Document
from suta_calib.report.observability import observability_document
from suta_calib.trust.observability import observe as look


@answer_command
@job_argument
def observe(job: Path) -> Document:
    """Show which parameters the data of JOB (a calibration.yaml) can determine.

    Nothing is fitted: the answer follows from the readings, the nominal arm and the assumed noise.
    For each unidentified parameter it shows the reason, and what to measure instead.
    """
    observability = look(CalibrationJob.load(job).problem())
    return observability_document(observability)
