"""``suta-calib outliers``: which landmark, placement, set, point or row is unlike the others."""

from __future__ import annotations

from pathlib import Path

from suta_calib.analysis.outliers import Thresholds, find_outliers
from suta_calib.cli._options import POSITIVE, job_argument, option, out_option
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.job.calibration import CalibrationJob
from suta_calib.report.document import Document
from suta_calib.report.outliers import outliers_document
from suta_calib.units import from_mm


@answer_command
@job_argument
@option(
    "--bias-mm", "Systematic error after registration from which on it is flagged.", POSITIVE, 1.0
)
@out_option
def outliers(job: Path, bias_mm: float) -> Document:
    """Look in the data of JOB (a calibration.yaml) for what does not agree with the rest.

    Every landmark, placement and set (of an artefact), every point and row (of other kinds) is
    left out in turn, and four metrics are taken: its share of the squared errors (flagged over
    1.5/n), Cook's distance (4/n), the fall of the RMS (5 %) and its bias after registration. A
    flag needs the threshold and significance against simulated noise; three flags of four make an
    outlier. Nothing is excluded: the answer says what excluding would do on held-out data, and
    how to write it into the job. Writes outliers.json, the heat map outliers.svg and a section of
    report.html.
    """
    loaded = CalibrationJob.load(job)
    with LateProgress("looking for outliers") as progress:
        result = find_outliers(
            loaded.problem(),
            loaded.validation,
            loaded.options(),
            Thresholds(bias=from_mm(bias_mm)),
            progress,
        )
    return outliers_document(result)
