"""``suta-calib budget``: what a calibration's errors come from."""

from __future__ import annotations

from pathlib import Path

from suta_calib.analysis.error_budget import error_budget_of_job
from suta_calib.cli._options import anyway_option, job_argument, out_option
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.job.calibration import CalibrationJob
from suta_calib.report.document import Document
from suta_calib.report.error_budget import budget_document


@answer_command
@job_argument
@anyway_option
@out_option
def budget(job: Path, anyway: bool) -> Document:
    """Split the errors of JOB (a calibration.yaml) by their causes.

    The causes are encoder noise (as the job's section encoders states it), seating (the scatter of
    repeated touches), the artefact (its sigma_mm), gross errors, and the model (everything else).
    Causes that the data cannot separate are shown together.
    """
    loaded = CalibrationJob.load(job)
    with LateProgress("solving") as progress:
        result = error_budget_of_job(loaded, progress, anyway=anyway)
    return budget_document(result)
