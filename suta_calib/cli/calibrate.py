"""``suta-calib calibrate``: solve one job or many, write results, say what was found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from suta_calib.atomic import check_folder
from suta_calib.cli._options import PATH, option, results_of
from suta_calib.cli._output import LateProgress, answer_command, results_folder
from suta_calib.job.calibration import CalibrationJob
from suta_calib.report.calibration import calibration_document
from suta_calib.report.document import Document


def _jobs(
    context: click.Context, parameter: click.Parameter, paths: tuple[Path, ...]
) -> tuple[Path, ...]:
    """The jobs that are named, or that match a pattern."""
    del context, parameter
    if len(paths) == 1 and paths[0].is_file():
        return paths
    # Loads what many jobs need.
    from suta_calib.fleet.jobs import with_patterns_read

    return tuple(with_patterns_read(paths))


def _are_many(asked: Mapping[str, Any]) -> bool:
    """Whether the command answers with a summary."""
    several = len(asked["job"]) > 1
    return several or asked["resume"] or any(asked[name] is not None for name in ("jobs", "dask"))


def _folder(context: click.Context, parameter: click.Parameter, out: Path | None) -> Path:
    """Where the answer is written: of many jobs, the summary."""
    del parameter
    asked = context.params
    if not _are_many(asked):
        return results_of(asked["job"][0], out)
    if out is None:
        from suta_calib.fleet import common_folder

        out = common_folder(asked["job"])
    check_folder(out)
    return out


@answer_command
@click.argument(
    "job", type=PATH, metavar="JOB...", nargs=-1, required=True, is_eager=True, callback=_jobs
)
@option(
    "--out DIR",
    "Folder for the results; default: results/ next to the job. Of many jobs: for the summary and "
    "a folder for each; default: each beside its job, the summary in the folder that all share.",
    PATH,
    callback=_folder,
)
@click.option(
    "--report/--no-report",
    default=None,
    help="Write report.html; default: of one job, and not of many.",
)
@click.option(
    "--jobs",
    type=click.IntRange(1, 1024),
    is_eager=True,
    help="Many jobs: number of processes; default: one per core.",
)
@click.option(
    "--dask",
    metavar="ADDRESS",
    is_eager=True,
    help="Many jobs: run on this Dask cluster, such as tcp://host:8786.",
)
@click.option(
    "--resume",
    is_flag=True,
    is_eager=True,
    help="Many jobs: compute only what has no whole result of the same inputs.",
)
def calibrate(
    job: tuple[Path, ...], report: bool | None, jobs: int | None, dask: str | None, resume: bool
) -> Document:
    """Calibrate the arm of JOB (a calibration.yaml) from its measurements.

    Writes calibrated.urdf, result.json, residuals.csv and report.html. If the result must not be
    used, the exit code is 1 and no calibrated.urdf is written: the fit did not converge, the
    residuals are far too large, or the arm is worse than nominal on the validation data.

    With several JOBs each is calibrated by itself, in several processes, and its results are those
    of a command of its own. summary.json and summary.csv have a row for each. No job stops another.
    The exit code is that of the worst: 2 if one could not be read or calibrated, 1 if one must not
    be used, or else 0.
    """
    if not _are_many(click.get_current_context().params):
        answer = calibration_of(job[0])
        return answer if report in (None, True) else replace(answer, written="record")
    return _calibrated(job, report=bool(report), workers=jobs, dask=dask, resume=resume)


def calibration_of(job: Path) -> Document:
    """The answer on a job; says on stderr how far it is."""
    loaded = CalibrationJob.load(job)
    with LateProgress("solving") as progress:
        result = loaded.run(progress, progress.about)
    return calibration_document(result)


def _calibrated(jobs: tuple[Path, ...], *, workers: int | None, **asked: Any) -> Document:
    """The answer on many jobs; says on stderr how many are done."""
    from suta_calib.fleet import calibrate_jobs, fleet_document
    from suta_calib.threads import usable_cores

    source = click.get_current_context().get_parameter_source("out")
    beside = source is click.core.ParameterSource.DEFAULT
    try:
        with LateProgress("calibrating") as progress:
            fleet = calibrate_jobs(
                jobs,
                None if beside else results_folder(),
                workers=workers or usable_cores(),
                progress=progress,
                **asked,
            )
    except KeyboardInterrupt:
        click.echo("results of the jobs that are done are whole: continue with --resume", err=True)
        raise
    return fleet_document(fleet)
