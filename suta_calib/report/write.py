"""The files of a result, each complete or not there."""

from __future__ import annotations

import json
from pathlib import Path

from suta_calib.atomic import write_bytes_atomically
from suta_calib.report.files import make_folder
from suta_calib.report.html import render_report
from suta_calib.report.residuals import residuals_csv
from suta_calib.report.result import Result
from suta_calib.report.result_json import result_dict


def write_results(result: Result, folder: str | Path) -> dict[str, Path]:
    """Write ``calibrated.urdf``, ``result.json``, ``residuals.csv`` and ``report.html``.

    A solution that did not converge yields only ``result.json`` and ``report.html``; files of an
    earlier run are not removed.

    Args:
        result: job, solution and accuracy.
        folder: created if it is not there.

    Returns:
        The files written, by name.

    Raises:
        OutputError: the folder or a file in it cannot be written.
    """
    folder = Path(folder)
    make_folder(folder)
    # All are made before the first is written; result.json comes last, so that a program that
    # waits for it finds the others complete.
    texts = {"report.html": render_report(result), "result.json": result_text(result)}
    written = {}
    if result.solution.converged:
        texts = {"residuals.csv": residuals_csv(result)} | texts
        written["calibrated.urdf"] = folder / "calibrated.urdf"
        result.job.arm.write_urdf(written["calibrated.urdf"], result.solution.values)
    for name, text in texts.items():
        written[name] = folder / name
        write_bytes_atomically(written[name], text.encode())
    return written


def result_text(result: Result) -> str:
    """``result.json`` as text."""
    return json.dumps(result_dict(result), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
