"""The page of ``result.json``: its keys as a shipped job's answer has them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

from repository_pages import ROOT

from suta_calib.job import CalibrationJob
from suta_calib.report.calibration import calibration_document

RESULT_JOB = ROOT / "examples" / "so101_printed_sheet" / "calibration.yaml"


def result_page() -> Iterator[str]:
    """The keys of ``result.json``, as a shipped job's answer has them."""
    answer = calibration_document(CalibrationJob.load(RESULT_JOB).run()).json()
    yield "# result.json\n\n"
    yield (
        "The file that `suta-calib calibrate` writes, and prints with `--json`. The example is of "
        f"`{RESULT_JOB.relative_to(ROOT)}`, with the first rows of each list. Parameters are in "
        "SI, with their `unit`; other values have the unit in their key. The same folder has "
        "`calibrated.urdf`, `residuals.csv` (one row per residual), `inputs.zip` (a copy of the "
        "inputs) and `report.html`. `run` is added when the files are written: the SHA-256 of "
        "each input, of each file of the run, and of the content of `result.json` itself.\n\n"
    )
    if lacking := answer.keys() ^ RESULT_KEYS.keys():
        raise LookupError(f"{', '.join(sorted(lacking))} of result.json: say them in RESULT_KEYS")
    for key, about in RESULT_KEYS.items():
        yield f"## {key}\n\n{about}\n\n```json\n{json_example(answer[key])}\n```\n\n"


RESULT_KEYS = {
    "status": "`converged`, or what the solver ended with.",
    "job": "The job's file.",
    "parameters": "Every parameter by its name: nominal, value, standard deviation, unit, "
    "[state](../guides/messages.md#the-state-of-a-parameter).",
    "external_poses": "Poses outside the arm: as a 4x4 matrix in m, and as position, roll "
    "pitch yaw and quaternion with standard deviations.",
    "markers": "By the label of the board, the markers that its file does not place: pose and size "
    "with standard deviations, as in `board.yaml`; empty where there are none.",
    "time_offsets": "Time offsets of instruments and cameras with a clock of their own "
    "(`time_offset_ms`), with their effect at the tip; empty where there are none.",
    "line_delays": "Of cameras with a rolling shutter, the time of one row (`line_delay_us`).",
    "unidentified": "Parameters that the data cannot determine.",
    "redundant": "Those of them that no data of these kinds can determine.",
    "held": "Plausible error of each held parameter of the arm, and what changes with it.",
    "scale": "What gives the data their unit of length: `artefact`, `board` or `instrument`, its "
    "`grade` and standard deviation (`ppm`), and how far that moves the tip (`tip_mm`, root mean "
    "square). `carries`: the arm's lengths depend on it, because the data determine it less well. "
    "Every standard deviation includes it.",
    "uncertainty": "Budgets: of one coordinate of the tip, every source with its type (`A`: "
    "scatter, `B`: a statement), standard uncertainty and degrees of freedom; all together, with "
    "the coverage factor. [On paper](../guides/certificate.md) explains it.",
    "unobservable": "Combinations of parameters that the data leave open.",
    "widening": "Factor by which the validation errors widen all standard deviations.",
    "excluded": "Data that the job excludes, by name.",
    "metrics": "Errors before and after, on fitted and on validation data; every residual counts "
    "fully, also outliers. `by_term` has them for each row of the job.",
    "repeatability": "Scatter of the tip about the mean of repeats of the same touch.",
    "timing_s": "Time of each step, in s.",
    "correlations": "Correlations of the estimated parameters, in their order.",
    "covariance": "Their covariance, in SI; `track` and `tip-map` propagate it.",
    "noise": "Noise levels: assumed or given, and estimated.",
    "priors": "Estimated width of the job's priors, by group.",
    "solver": "What the solver did, for each start.",
    "versions": "Versions of the software.",
    "held_out": "Validation errors per axis: measured and predicted.",
    "verdict": "Whether the result may be used: "
    "[what does this message mean?](../guides/messages.md#the-verdict)",
}


# Numbers in a row of an example, and rows, that are shown: a 4x4 matrix is.
SHOWN_NUMBERS = 4


def shortened(value: Any) -> Any:
    """JSON with the first rows of each list, and the first of each mapping by name."""
    if isinstance(value, list):
        rows = any(isinstance(each, dict) for each in value)
        return [shortened(each) for each in value[: 1 if rows else SHOWN_NUMBERS]]
    if isinstance(value, float):
        return float(f"{value:.4g}")
    if not isinstance(value, dict):
        return value
    rows = [each for each in value.values() if isinstance(each, dict)]
    alike = len(rows) > 2 and all(row.keys() & rows[0].keys() for row in rows)
    kept = list(value.items())[:1] if alike else value.items()
    return {name: shortened(each) for name, each in kept}


def json_example(value: Any) -> str:
    """Indented JSON with lists of numbers or names on a line each."""
    text = json.dumps(shortened(value), indent=1, ensure_ascii=False)
    return re.sub(r"\[[^\[\]{}]*\]", lambda found: re.sub(r"\s+", " ", found[0]), text)
