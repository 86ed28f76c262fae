"""``suta-calib calibrate``: solve a job, write its results, say what was found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from suta_calib.cli._options import flag, job_argument, out_option
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.job.calibration import CalibrationJob
from suta_calib.report.calibration import calibration_document
from suta_calib.report.document import Document


@answer_command
@job_argument
@out_option
@flag("--no-report", "Do not write report.html.")
def calibrate(job: Path, no_report: bool) -> Document:
    """Calibrate the arm of JOB (a calibration.yaml) from its measurements.

    Writes calibrated.urdf, result.json, residuals.csv and report.html. If the result must not be
    used, the exit code is 1 and no calibrated.urdf is written: the fit did not converge, the
    residuals are far too large, or the arm is worse than nominal on the validation data.
    """
    answer = calibration_of(job)
    return replace(answer, written="record") if no_report else answer


def calibration_of(job: Path) -> Document:
    """The answer on a job; says on stderr how far it is."""
    loaded = CalibrationJob.load(job)
    with LateProgress("solving") as progress:
        result = loaded.run(progress, progress.about)
    return calibration_document(result)
