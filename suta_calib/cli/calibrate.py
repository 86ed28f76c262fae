"""``suta-calib calibrate``: solve one job or many, write results, say what was found."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from suta_calib.cli._fleet import answer_of_many, are_many, many_jobs, reported
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.job.calibration import CalibrationJob
from suta_calib.report.calibration import calibration_document
from suta_calib.report.document import Document


@answer_command
@many_jobs()
def calibrate(job: tuple[Path, ...], **_: Any) -> Document:
    """Calibrate the arm of JOB (a calibration.yaml) from its measurements.

    Writes calibrated.urdf, result.json, residuals.csv and report.html. If the result must not be
    used, the exit code is 1 and no calibrated.urdf is written: the fit did not converge, the
    residuals are far too large, or the arm is worse than nominal on the validation data.

    With several JOBs each is calibrated by itself, in several processes, and its results are those
    of a command of its own. summary.json and summary.csv have a row for each. No job stops another.
    The exit code is that of the worst: 2 if one could not be read or calibrated, 1 if one must not
    be used, or else 0.
    """
    if not are_many(click.get_current_context().params):
        return reported(calibration_of(job[0]))
    from suta_calib.fleet import Calibrate

    return answer_of_many(Calibrate(), "calibrating")


def calibration_of(job: Path) -> Document:
    """The answer on a job; says on stderr how far it is."""
    loaded = CalibrationJob.load(job)
    with LateProgress("solving") as progress:
        result = loaded.run(progress, progress.about)
    return calibration_document(result)
