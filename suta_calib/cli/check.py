"""``suta-calib check``: is a calibration still right, by a few new rows?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import click

from suta_calib.atomic import check_folder
from suta_calib.check import FALSE_ALARM, Check, Follow, can_repair, repaired
from suta_calib.check.growing import FollowedFile, growing
from suta_calib.check.history import recall, remembered
from suta_calib.check.pose_answers import PoseAnswer
from suta_calib.check.read_back import ReadBack, read_answer
from suta_calib.cli._fleet import interruptible
from suta_calib.cli._options import PATH, POSITIVE, FiniteRange, anyway_option, flag, option
from suta_calib.cli._output import (
    LateProgress,
    answer_command,
    console,
    noted_interrupt,
    printing,
    results_folder,
)
from suta_calib.report.check import check_document
from suta_calib.report.document import Document
from suta_calib.report.repair import repair_document
from suta_calib.terms import Term


def _folder(context: click.Context, parameter: click.Parameter, out: Path | None) -> Path | None:
    """Where the answer is written; of many robots at least the summary, beside their list."""
    del parameter
    fleet: Path | None = context.params["fleet"]
    out = fleet.parent if out is None and fleet is not None else out
    if out is not None:
        check_folder(out)
    return out


@answer_command
@click.argument("result", type=PATH, required=False)
@click.argument("samples", type=PATH, metavar="SAMPLES…", nargs=-1)
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
@option(
    "--out DIR",
    "Folder for check.json and the report, or for the repaired result. With --fleet: for the "
    "summary and a folder for each robot; default: the summary beside the list.",
    PATH,
    callback=_folder,
)
@flag("--follow", "Read rows as they are appended to the file SAMPLES, and decide after each.")
@option("--seconds", "Stop following after so many seconds; default: at Ctrl-C.", POSITIVE)
@flag("--no-history", "Add no line to checks.jsonl beside the result.")
@option(
    "--fleet LIST.csv",
    "Many robots: a list with the columns robot, result, samples and, where needed, like.",
    PATH,
    is_eager=True,
)
@option("--jobs", "--fleet: number of processes; default: one per core.", click.IntRange(1, 1024))
@option("--dask ADDRESS", "--fleet: run on this Dask cluster, such as tcp://host:8786.")
@anyway_option
def check(result: Path | None, samples: tuple[Path, ...], **asked: Any) -> Document:
    """Check whether a calibration is still right, by a few new rows.

    RESULT is the folder of a result, or its result.json. SAMPLES are new rows of a kind that the
    job had; of pictures, the samples and the corners, or the samples and the pictures. A result of
    hand-eye, pivot or register from poses is checked by such files as that command reads. What
    changed is named: base, tip, instrument, camera, board, a placement, the zero of a joint, a
    link, the scale. The exit code is 1 if something changed.

    With --follow, SAMPLES is one file that grows, such as suta-calib measure writes it. The
    probability of a false alarm holds for all rows together, however many come.

    With --fleet, many robots are checked or followed at once, without RESULT and SAMPLES. Each row
    of the list has the name of a robot, its result, and its samples (several files with ; between
    them); paths are relative to the list. No robot stops another. check_summary.json and
    check_summary.csv have a row for each. The exit code is 2 if one could not be checked, 1 if
    something changed.
    """
    fleet = asked.pop("fleet")
    if fleet is not None:
        return _of_fleet(fleet, result, **asked)
    parameters = {p.name: p for p in click.get_current_context().command.params}
    for name, given in (("result", result), ("samples", samples)):
        if not given:
            raise click.MissingParameter(param=parameters[name], param_hint=f"'{name.upper()}'")
    if any([asked.pop("jobs"), asked.pop("dask")]):
        raise click.UsageError("--jobs and --dask are for many robots: list them with --fleet")
    assert result is not None
    return _of_one(result, samples, **asked)


def _of_fleet(fleet: Path, result: Path | None, **asked: Any) -> Document:
    """Many robots of a list."""
    if result is not None:
        raise click.UsageError(
            "--fleet names a list of results and samples: leave out RESULT and SAMPLES, or --fleet"
        )
    if asked["repair"] or asked["like"]:
        raise click.UsageError(
            "--fleet takes neither --repair nor --like: repair one result at a time, and give the "
            "list a column like"
        )
    if asked["seconds"] is not None and not asked["follow"]:
        raise click.UsageError("--seconds is for --follow")
    # Loads what the check of one robot does not need.
    from suta_calib.cli._follow_view import FollowView
    from suta_calib.fleet import (
        CheckRobots,
        check_robots,
        fleet_document,
        follow_robots,
        read_robots,
    )
    from suta_calib.threads import usable_cores

    context = click.get_current_context()
    beside = context.get_parameter_source("out") is click.core.ParameterSource.DEFAULT
    out, follow, workers = results_folder(), asked["follow"], asked["jobs"] or usable_cores()
    robots = read_robots(fleet, None if beside else out, follow=follow)
    work = CheckRobots(
        history=not asked["no_history"],
        written=not beside,
        report=not beside,
        **{name: asked[name] for name in ("board", "camera", "false_alarm", "anyway")},
    )
    if not follow:
        with interruptible(), LateProgress("checking") as progress:
            answer = check_robots(
                work, robots, workers=workers, dask=asked["dask"], progress=progress
            )
        return fleet_document(answer, out)
    with noted_interrupt() as over, FollowView(quiet=context.params["as_json"]) as view:
        answer = follow_robots(
            *(work, robots),
            workers=workers,
            dask=asked["dask"],
            seconds=asked["seconds"],
            over=over,
            show=view.show,
            say=view.say,
        )
    return fleet_document(answer, out)


def _of_one(
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
    """One robot."""
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
    if not no_history:
        answer = remembered(answer, samples, written.file)
    if repair and can_repair(answer) and isinstance(written, ReadBack):
        return repair_document(repaired(checking, answer), written, samples)
    return check_document(answer, written.title, recall(written.file.parent))


def _followed(
    read: Callable[[Sequence[Path]], list[Term]], file: Path, follow: Follow, seconds: float | None
) -> Check:
    """What was found until something changed, or until somebody ended it."""
    quiet, said = click.get_current_context().params["as_json"], console()
    rows, done = FollowedFile(file, read, follow), 0
    with suppress(KeyboardInterrupt):
        for lines, fresh in growing(file, seconds):
            first, done = 0 if fresh else done, lines.count(b"\n")
            step = rows.take(lines, first, done)
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
    return rows.check()
