"""``suta-calib check``: is a calibration still right, by a few new rows?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import click

from suta_calib.assessment import attempt
from suta_calib.check import FALSE_ALARM, Check, Follow, can_repair, repaired
from suta_calib.check.growing import about_file, growing
from suta_calib.check.history import line_of, recall, remember
from suta_calib.check.pose_answers import PoseAnswer
from suta_calib.check.read_back import ReadBack, read_answer
from suta_calib.cli._options import PATH, POSITIVE, FiniteRange, Folder, anyway_option, flag, option
from suta_calib.cli._output import (
    answer_command,
    console,
    ended_by_sigterm,
    printing,
    results_folder,
)
from suta_calib.errors import InputError, SamplesError
from suta_calib.report.check import check_document
from suta_calib.report.document import Document
from suta_calib.report.repair import repair_document
from suta_calib.terms import Term


@answer_command
@click.argument("result", type=PATH)
@click.argument("samples", type=PATH, metavar="SAMPLES…", nargs=-1, required=True)
@option("--like KIND", "Kind or label of the job's row that the samples are like.", default="")
@option("--board BOARD.yaml", "Board in the pictures, where it is not the job's.", PATH)
@option(
    "--camera CAMERA.yaml",
    "Camera that took the pictures, for a job with the poses of a target in place of pictures.",
    PATH,
)
@option(
    "--false-alarm",
    "Probability that sound rows are said to show a change.",
    FiniteRange(min=1e-6, max=0.2),
    FALSE_ALARM,
)
@flag("--repair", "Estimate again what changed, and write a whole new result into --out.")
@option("--out", "Folder for check.json and the report, or for the repaired result.", Folder())
@flag("--follow", "Read rows as they are appended to the file SAMPLES, and decide after each.")
@option("--seconds", "Stop following after so many seconds; default: at Ctrl-C.", POSITIVE)
@flag("--no-history", "Add no line to checks.jsonl beside the result.")
@anyway_option
def check(
    result: Path,
    samples: tuple[Path, ...],
    like: str,
    board: Path | None,
    camera: Path | None,
    false_alarm: float,
    repair: bool,
    follow: bool,
    seconds: float | None,
    no_history: bool,
    anyway: bool,
) -> Document:
    """Check whether a calibration is still right, by a few new rows.

    RESULT is the folder of a result, or its result.json. SAMPLES are new rows of a kind that the
    job had; of pictures, the samples and the corners, or the samples and the pictures. A result of
    hand-eye, pivot or register from poses is checked by such files as that command reads. What
    changed is named: base, tip, instrument, camera, board, a placement, the zero of a joint, a
    link, the scale. The exit code is 1 if something changed.

    With --follow, SAMPLES is one file that grows, such as suta-calib measure writes it. The
    probability of a false alarm holds for all rows together, however many come.
    """
    if follow and (len(samples) > 1 or repair):
        raise click.UsageError("--follow reads one file of samples, and repairs nothing")
    if repair and results_folder() is None:
        raise click.UsageError("--repair writes a whole new result: give its folder with --out")
    written = read_answer(result, anyway=anyway)
    if isinstance(written, PoseAnswer):
        if like or board or camera or repair or follow:
            raise click.UsageError(
                f"a result of {written.command.name} takes none of --like, --board, --camera, "
                f"--repair and --follow: if it changed, run suta-calib {written.command.name} again"
            )
        read = written.terms
    else:
        read = partial(written.terms, like=like, board=board, camera=camera)
    if follow:
        answer = _followed(read, samples[0], Follow(written.checker, false_alarm), seconds)
    else:
        checking = written.checker.checking(read(samples), false_alarm)
        answer = checking.run()
    folder, notes = written.file.parent, list[str]()
    if not no_history:
        line = line_of(answer, samples, written.file)
        # A folder that nobody may write to is checked all the same.
        attempt("written: the history", lambda: remember(folder, line), None, notes)
    answer = replace(answer, notes=(*answer.notes, *notes))
    if repair and can_repair(answer) and isinstance(written, ReadBack):
        return repair_document(repaired(checking, answer), written, samples)
    return check_document(answer, written.title, recall(folder))


def _followed(
    read: Callable[[Sequence[Path]], list[Term]], file: Path, follow: Follow, seconds: float | None
) -> Check:
    """What was found until something changed, or until somebody ended it."""
    quiet, said = click.get_current_context().params["as_json"], console()
    done = 0
    with ended_by_sigterm(), suppress(KeyboardInterrupt):
        for copy, fresh in growing(file, seconds):
            done = 0 if fresh else done
            try:
                (term,) = read([copy])
            except InputError as error:
                raise about_file(error, copy, file) from None
            step, done = follow.add(term, done), len(term.poses)
            if not quiet:
                waits = ", the last one is far off and waits for the next" if step.held else ""
                with printing():
                    said.print(
                        f"{step.rows} rows: evidence of a change {step.evidence:.3g} of "
                        f"{step.limit:.3g}{waits}",
                        soft_wrap=True,
                    )
            if step.changed:
                break
    try:
        return follow.check()
    except SamplesError as error:
        raise SamplesError.of(error, file, None) from None
