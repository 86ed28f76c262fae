"""``suta-calib validate``: a job's held-out data through any URDF."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from suta_calib.analysis.comparison import check_calibrated, compare_arms
from suta_calib.cli._options import PATH, anyway_option, option, urdf_argument
from suta_calib.cli._output import answer_command
from suta_calib.errors import JobError
from suta_calib.inputs import UrdfFile
from suta_calib.report.comparison import comparison_document
from suta_calib.report.document import Document
from suta_calib.tracking.read_back import is_result, job_of
from suta_calib.tracking.uncertainty import read_uncertainty


@answer_command
@urdf_argument("URDF")
@click.argument("job", type=PATH, metavar="JOB|RESULT")
@option(
    "--result",
    "The result.json of this URDF: also corrects gains, eccentric encoders and compliant joints, "
    "and gives the uncertainty of the arm.",
    PATH,
)
@anyway_option
def validate(urdf: UrdfFile, job: Path, result: Path | None, anyway: bool) -> Document:
    """Test URDF, such as a calibrated.urdf, with the validation data of JOB.

    Instead of the job, RESULT (a folder of results or its result.json) gives the data that it was
    made with. The arm is used as it is in the URDF, without a fit. "before" is the job's URDF,
    "after" the given one.
    """
    loaded = job_of(job)
    if not loaded.validation:
        raise JobError(
            "no validation data",
            "at least one row of samples that were not fitted",
            file=job,
            where="validation",
        )
    arm = loaded.spec.arm
    other = arm.mechanism_of(urdf, loaded.arm, loaded.spec.pairs)
    beside, uncertainty = dict[str, float](), None
    if result is not None:
        calibration = read_uncertainty(result, other, anyway=anyway)
        check_calibrated(loaded.arm, other, calibration.values)
        names, factor = calibration.folded(other)
        beside, uncertainty = calibration.beside_geometry, (names, factor @ factor.T)
    compared = compare_arms(
        loaded.observations, loaded.validation, other, beside, uncertainty=uncertainty
    )
    if result is None and other.urdf[1] != loaded.arm.urdf[1]:
        estimated = (p for p in loaded.parameters.values() if p.free and not p.geometric)
        compared = replace(compared, left_out=tuple(p.name for p in estimated))
    before = Path(Path(arm.urdf).name) if is_result(job) else Path(arm.urdf)
    return comparison_document(compared, before, Path(urdf))
