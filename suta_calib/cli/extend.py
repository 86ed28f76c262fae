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
@flag("--quick", "Leave out the models with every joint at once.")
@seed_option("Of folds that are not placements.")
@out_option
def extend(job: Path, quick: bool, seed: int) -> Document:
    """Look for errors that are no geometry: eccentric encoders, joints that yield to gravity.

    Models with and without them are fitted to the observations of JOB (a calibration.yaml) with one
    placement left out after the other. What predicts the left-out data better is worth having; that
    it fits better is not enough. Says which rows to add to the job, or that nothing is worth it.
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
