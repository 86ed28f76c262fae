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
        "What `suta-calib calibrate` writes, and prints with `--json`: here as "
        f"`{RESULT_JOB.relative_to(ROOT)}` gives it, with the first rows of each list. Values that "
        "are parameters are in SI and say their `unit`; others say it in their key. Beside it are "
        "`calibrated.urdf`, `residuals.csv` (one row per residual), `inputs.zip` (what it "
        "was made of) and `report.html`. `run` is added when the files are written: the SHA-256 "
        "of each input, and of each file that belongs to the run.\n\n"
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
    "external_poses": "What stands outside the arm: as a 4x4 matrix in m, and as position, roll "
    "pitch yaw and quaternion with standard deviations.",
    "unidentified": "Parameters that the data cannot tell.",
    "redundant": "Those of them that no data of these kinds could tell.",
    "held": "How far off each held parameter of the arm may be, and what changes with it.",
    "scale": "What gives the data their unit of length: `artefact`, `board` or `instrument`, its "
    "`grade` and standard deviation (`ppm`), and how far that moves the tip (`tip_mm`, root mean "
    "square). `carries`: the arm's lengths depend on it, because the data determine it less well. "
    "Every standard deviation includes it.",
    "unobservable": "Combinations of parameters that the data leave open.",
    "widening": "Factor by which the validation errors widen all standard deviations.",
    "excluded": "What the job leaves out by name.",
    "metrics": "Errors before and after, on fitted and on held-out data; every residual counts, "
    "also one that a robust fit believes less. `by_term` has them for each row of the job.",
    "repeatability": "How the tip scatters about the mean of repeats of the same touch.",
    "timing_s": "Seconds.",
    "correlations": "Of the estimated parameters, in their order.",
    "covariance": "The same, in SI: what `track` and `tip-map` propagate.",
    "noise": "Noise levels: assumed or given, and found.",
    "priors": "How wide the job's priors were found to be, by group.",
    "solver": "How it was solved, start by start.",
    "versions": "Of what it was solved with.",
    "held_out": "Validation errors per axis: measured and predicted.",
    "verdict": "How far it may be trusted: "
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
