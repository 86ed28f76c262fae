"""What commands share that work on one job or on many."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from suta_calib.atomic import check_folder
from suta_calib.cli._options import PATH, Command, option, results_of
from suta_calib.cli._output import LateProgress, conclude, results_folder
from suta_calib.report.document import Document

if TYPE_CHECKING:
    from suta_calib.fleet import JobWork


def _jobs(
    context: click.Context, parameter: click.Parameter, paths: tuple[Path, ...]
) -> tuple[Path, ...]:
    """The jobs that are named, or that match a pattern."""
    del context, parameter
    if len(paths) == 1 and paths[0].exists():
        return paths
    # Loads what many jobs need.
    from suta_calib.fleet.jobs import with_patterns_read

    return tuple(with_patterns_read(paths))


def are_many(asked: Mapping[str, Any]) -> bool:
    """Whether a command answers with a summary."""
    return len(asked["job"]) > 1 or any(asked[name] for name in ("jobs", "dask", "resume"))


def _are_several(asked: Mapping[str, Any]) -> bool:
    """The same of a command that has processes for one job too."""
    return len(asked["job"]) > 1


def many_jobs(*, of_one_too: bool = False) -> Callable[[Command], Command]:
    """``JOB...``, ``--out``, ``--report``, ``--jobs``, ``--dask`` and ``--resume``.

    Args:
        of_one_too: whether the last three are of use for one job.
    """
    many = _are_several if of_one_too else are_many

    def folder(context: click.Context, parameter: click.Parameter, out: Path | None) -> Path:
        """Where the answer is written: of many jobs, the summary."""
        del parameter
        if not many(context.params):
            return results_of(context.params["job"][0], out)
        if out is None:
            from suta_calib.fleet import common_folder

            out = common_folder(context.params["job"])
        check_folder(out)
        return out

    of = "" if of_one_too else "Many jobs: "
    resume = "Continue with the trials of an interrupted run; of many jobs, take whole results."
    if not of_one_too:
        resume = "Many jobs: compute only what has no whole result of the same inputs."

    def decorated(command: Command) -> Command:
        about = "Folder for the results; default: results/ next to the job. Of many jobs: for the "
        about += "summary and a folder for each; default: each beside its job, the summary in the "
        about += "folder that all share."
        processes, cluster = "number of processes; default: one per core.", "run on this Dask "
        cluster += "cluster, such as tcp://host:8786."
        for decorate in (
            option("--resume", resume, is_flag=True, is_eager=True),
            option("--dask ADDRESS", _sentence(of, cluster), is_eager=True),
            option("--jobs", _sentence(of, processes), click.IntRange(1, 1024), is_eager=True),
            click.option(
                "--report/--no-report",
                default=None,
                help="Write report.html; default: of one job, and not of many.",
            ),
            option("--out DIR", about, PATH, callback=folder),
            click.argument(
                "job", type=PATH, metavar="JOB...", nargs=-1, required=True, is_eager=True,
                callback=_jobs,
            ),
        ):  # fmt: skip
            command = decorate(command)
        return command

    return decorated


def _sentence(of: str, what: str) -> str:
    return f"{of}{what}" if of else f"{what[0].upper()}{what[1:]}"


@contextmanager
def interruptible(remedy: str = "") -> Iterator[None]:
    """Within it Ctrl-C ends a fleet with a summary of what is done, and says how to go on."""
    from suta_calib.fleet import FleetInterrupted, fleet_document

    try:
        yield
    except FleetInterrupted as interrupted:
        done = interrupted.done
        if done.results:
            conclude(fleet_document(done, results_folder()))
        count = len(done.results)
        said = f"{count:,} of {count + done.unfinished:,} {done.noun}s are done{remedy}"
        click.echo(said, err=True)
        raise


def answer_of_many(work: JobWork, doing: str) -> Document:
    """The answer of the running command on many jobs; says on stderr how many are done."""
    from suta_calib.fleet import fleet_document, run_jobs
    from suta_calib.threads import usable_cores

    context = click.get_current_context()
    asked, source = context.params, context.get_parameter_source("out")
    beside = source is click.core.ParameterSource.DEFAULT
    with interruptible("; continue with --resume"), LateProgress(doing) as progress:
        fleet = run_jobs(
            replace(work, report=bool(asked["report"])),
            asked["job"],
            None if beside else results_folder(),
            workers=asked["jobs"] or usable_cores(),
            dask=asked["dask"],
            resume=asked["resume"],
            progress=progress,
        )
    return fleet_document(fleet, results_folder())


def answer_of_one(work: JobWork) -> Document:
    """The answer of the running command on its only job; says on stderr how far it is."""
    from suta_calib.fleet import FleetJob, Task

    asked = click.get_current_context().params
    (path,) = asked["job"]
    task = Task(work, FleetJob(path.name, path, results_folder()), asked["resume"], asked["dask"])
    return reported(work.document(work.read(path), task, LateProgress))


def reported(answer: Document) -> Document:
    """The answer on one job, without a page if none is asked for."""
    asked = click.get_current_context().params["report"]
    return answer if asked in (None, True) else replace(answer, written="record")
