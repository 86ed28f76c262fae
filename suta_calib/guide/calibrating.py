"""The calibration at the end of a guided measurement: what `calibrate` writes, and its verdict."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from suta_calib.assessment import Assessment
from suta_calib.errors import JobError
from suta_calib.job.calibration import CalibrationJob
from suta_calib.job.standing_elsewhere import job_so_far
from suta_calib.report.calibration import calibration_document
from suta_calib.report.files import write_document


@dataclass(frozen=True)
class GuidedCalibration:
    """What came out.

    Attributes:
        headline: how far off the arm was and is.
        assessment: whether it may be used.
        files: what was written.
        job: the job that was calibrated: of those rows that have samples.
    """

    headline: str
    assessment: Assessment
    files: tuple[Path, ...]
    job: Path


def calibrated(job: Path) -> GuidedCalibration:
    """Calibrate with the rows of a job that have samples, and write the results beside it.

    Where rows have none, the job that is calibrated is written beside it too.

    Raises:
        InputError: the job cannot be used, or has no samples yet.
        OutputError: a file cannot be written.
    """
    measured = job_so_far(job, job.with_name(f"{job.stem}-measured{job.suffix}"))
    if measured is None:
        raise JobError("no samples yet", "measured landmarks", file=job)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        answer = CalibrationJob.load(measured).run()
        inputs = {str(measured): sha256(measured.read_bytes()).hexdigest()}
        written = write_document(calibration_document(answer), job.parent / "results", inputs)
    files = tuple(Path(path) for path in written["files"].values())
    return GuidedCalibration(answer.headline, answer.assessment, files, measured)
