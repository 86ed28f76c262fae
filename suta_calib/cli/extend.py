"""``suta-calib extend``: errors beside geometry that predict left-out data better."""

from __future__ import annotations

from pathlib import Path

from suta_calib.analysis.model_selection import choose_model
from suta_calib.cli._options import flag, job_argument, out_option, seed_option
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.job.calibration import CalibrationJob
from suta_calib.report.document import Document
from suta_calib.report.model_selection import model_selection_document


@answer_command
@job_argument
@flag("--quick", "Leave out the models that have the same error in every joint.")
@seed_option("Seed of the folds, where these are not placements.")
@out_option
def extend(job: Path, quick: bool, seed: int) -> Document:
    """Find errors other than geometry, such as eccentric encoders and compliant joints.

    Models with and without these errors are fitted to the observations of JOB (a calibration.yaml),
    each time without one of the placements, or without a stretch of time of a recording in motion
    (samples with a column time), in which joints that lag by where they came from are looked for
    too. An error is added only if it improves the prediction of
    the left-out data; a better fit is not enough. The command shows the rows to add to the job.
    """
    loaded = CalibrationJob.load(job)
    with LateProgress("trying models") as progress:
        choice = choose_model(
            loaded.observations,
            loaded.parameters,
            validation=loaded.validation,
            families=not quick,
            seed=seed,
            progress=progress,
        )
    return model_selection_document(choice)
