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
    "--bias-mm", "Systematic error after registration above which data are marked.", POSITIVE, 1.0
)
@out_option
def outliers(job: Path, bias_mm: float) -> Document:
    """Find the data of JOB (a calibration.yaml) that contradict the rest.

    Every landmark, placement and set (of an artefact), every point and row (of other kinds) is left
    out in turn. Four metrics are computed: its share of the squared errors (limit 1.5/n), Cook's
    distance (4/n), the reduction of the RMS (5 %) and its bias after registration. A metric counts
    if it is beyond its limit and significant compared with simulated noise; an outlier needs three
    of four. Nothing is excluded: the answer shows the effect of an exclusion on the validation
    data, and the rows to add to the job. Writes outliers.json, the heat map outliers.svg and a
    section of report.html.
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
