"""``suta-calib check``: is a calibration still right, by a few new rows?"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from suta_calib.assessment import attempt
from suta_calib.check import FALSE_ALARM, can_repair, repaired
from suta_calib.check.history import line_of, recall, remember
from suta_calib.check.read_back import read_back
from suta_calib.cli._options import PATH, FiniteRange, Folder, anyway_option, flag, option
from suta_calib.cli._output import answer_command, results_folder
from suta_calib.report.check import check_document
from suta_calib.report.document import Document
from suta_calib.report.repair import repair_document


@answer_command
@click.argument("result", type=PATH)
@click.argument("samples", type=PATH, metavar="SAMPLES…", nargs=-1, required=True)
@option("--like KIND", "Kind or label of the job's row that the samples are like.", default="")
@option(
    "--false-alarm",
    "Probability that sound rows are said to show a change.",
    FiniteRange(min=1e-6, max=0.2),
    FALSE_ALARM,
)
@flag("--repair", "Estimate again what changed, and write a whole new result into --out.")
@option("--out", "Folder for check.json and the report, or for the repaired result.", Folder())
@flag("--no-history", "Add no line to checks.jsonl beside the result.")
@anyway_option
def check(
    result: Path,
    samples: tuple[Path, ...],
    like: str,
    false_alarm: float,
    repair: bool,
    no_history: bool,
    anyway: bool,
) -> Document:
    """Check whether a calibration is still right, by a few new rows.

    RESULT is the folder of a result, or its result.json. SAMPLES are new rows of a kind that the
    job had; of pictures, the samples and the corners. What changed is named: base, tip, instrument,
    camera, board, a placement, the zero of a joint, a link, the scale. The exit code is 1 if
    something changed.
    """
    if repair and results_folder() is None:
        raise click.UsageError("--repair writes a whole new result: give its folder with --out")
    written = read_back(result, anyway=anyway)
    checking = written.checker.checking(written.terms(samples, like), false_alarm)
    answer = checking.run()
    folder, notes = written.file.parent, list[str]()
    if not no_history:
        line = line_of(answer, samples)
        # A folder that nobody may write to is checked all the same.
        attempt("written: the history", lambda: remember(folder, line), None, notes)
    answer = replace(answer, notes=(*answer.notes, *notes))
    if repair and can_repair(answer):
        return repair_document(repaired(checking, answer), written, samples)
    return check_document(answer, written.job.title, recall(folder))
