"""``suta-calib calibrate``: solve a job, write its results, say what was found."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from suta_calib.cli._output import (
    NOT_USABLE,
    LateProgress,
    check_folder,
    console,
    json_option,
    print_json,
    verbose_option,
)

if TYPE_CHECKING:
    from suta_calib.job.calibration import CalibrationResult


@click.command()
@click.argument("job", type=click.Path(path_type=Path), metavar="JOB")
@click.option(
    "--out", type=click.Path(path_type=Path), help="Folder to write into; results/ beside the job."
)
@json_option
@verbose_option
@click.pass_context
def calibrate(
    context: click.Context, job: Path, out: Path | None, as_json: bool, verbose: bool
) -> None:
    """Calibrate the arm of JOB (a calibration.yaml) from its measurements.

    Writes calibrated.urdf, result.json, residuals.csv and report.html. Exits with 1 where the
    answer must not be used: not converged, residuals that drown the data, or worse than nominal on
    validation data.
    """
    from suta_calib.job.calibration import CalibrationJob
    from suta_calib.report.verdict import judge
    from suta_calib.report.write import write_results

    folder = job.parent / "results" if out is None else out
    loaded = CalibrationJob.load(job)
    check_folder(folder)
    with LateProgress("solving") as progress:
        result = loaded.run(progress)
    files = write_results(result, folder)
    if as_json:
        from suta_calib.report.result_json import result_dict

        print_json(result_dict(result) | {"files": {k: str(p) for k, p in files.items()}})
    else:
        _print(result, files, verbose)
    if judge(result).level == "bad":
        context.exit(NOT_USABLE)


def _print(result: CalibrationResult, files: dict[str, Path], verbose: bool) -> None:
    from suta_calib.report.tables import summary

    to = console()
    to.print(summary(result, verbose=verbose))
    folder = files["result.json"].parent
    to.print(f"Written to {folder}: {', '.join(files)}", soft_wrap=True)
    to.print(f"Report: {files['report.html']}", soft_wrap=True)
