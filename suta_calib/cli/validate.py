"""``suta-calib validate``: a job's held-out data through any URDF."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.cli._options import PATH, anyway_option, job_argument
from suta_calib.cli._output import answer_command
from suta_calib.errors import JobError
from suta_calib.report.document import Document


@answer_command
@click.argument("urdf", type=PATH, metavar="URDF")
@job_argument
@click.option(
    "--result",
    type=PATH,
    help="The result.json beside it: corrects gains, eccentric encoders and yielding joints too, "
    "and says how unsure the arm is.",
)
@anyway_option
def validate(urdf: Path, job: Path, result: Path | None, anyway: bool) -> Document:
    """Run the validation data of JOB through URDF, such as a calibrated.urdf.

    The arm is held as the URDF has it. "before" is the job's own URDF, "after" the given one.
    """
    from suta_calib.analysis.comparison import check_calibrated, compare_arms
    from suta_calib.job.calibration import CalibrationJob
    from suta_calib.report.comparison import comparison_document

    loaded = CalibrationJob.load(job)
    if not loaded.validation:
        raise JobError(
            "no validation data",
            "at least one row of samples that were not fitted",
            file=job,
            where="validation",
        )
    arm = loaded.spec.arm
    other = arm.model_of(urdf)
    beside, uncertainty = dict[str, float](), None
    if result is not None:
        from suta_calib.tracking.uncertainty import read_uncertainty

        found = read_uncertainty(result, other, anyway=anyway)
        check_calibrated(loaded.arm, other, found.values)
        names, factor = found.folded(other)
        beside, uncertainty = found.beside_geometry, (names, factor @ factor.T)
    compared = compare_arms(
        loaded.observations, loaded.validation, other, beside, uncertainty=uncertainty
    )
    return comparison_document(compared, arm.urdf, urdf)
