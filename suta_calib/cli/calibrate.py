"""``suta-calib calibrate``: solve a job, write its results, say what was found."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from suta_calib.cli._output import (
    LateProgress,
    check_folder,
    console,
    json_option,
    print_explanations,
    print_json,
)

if TYPE_CHECKING:
    from suta_calib.job import CalibrationResult

NOT_CONVERGED: Final = 1


@click.command()
@click.argument("job", type=click.Path(path_type=Path), metavar="JOB")
@click.option(
    "--out", type=click.Path(path_type=Path), help="Folder to write into; results/ beside the job."
)
@json_option
@click.option("--verbose", "-v", is_flag=True, help="List the unknowns of the terms too.")
@click.pass_context
def calibrate(
    context: click.Context, job: Path, out: Path | None, as_json: bool, verbose: bool
) -> None:
    """Calibrate the arm of JOB (a calibration.yaml) from its measurements.

    Writes calibrated.urdf, result.json, residuals.csv and report.html. Exits with 1 where the
    solver did not converge: then there is no calibrated.urdf.
    """
    from suta_calib.job import CalibrationJob
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
    if not result.solution.converged:
        context.exit(NOT_CONVERGED)


def _print(result: CalibrationResult, files: dict[str, Path], verbose: bool) -> None:
    from suta_calib.report.tables import accuracy_table, parameter_table
    from suta_calib.report.verdict import judge

    to = console()
    if result.solution.converged:
        to.print(parameter_table(result.solution, verbose=verbose))
        to.print(accuracy_table(result.accuracy))
    _print_open_directions(result)
    verdict = judge(result)
    to.print(f"{verdict.word}: {verdict.sentence}.", soft_wrap=True)
    for note in verdict.notes:
        to.print(note, soft_wrap=True)
    where = files.get("report.html", next(iter(files.values())))
    to.print(f"Written to {where.parent}: {', '.join(p.name for p in files.values())}")
    to.print(f"Report: {where}", soft_wrap=True)


def _print_open_directions(result: CalibrationResult) -> None:
    from suta_calib.analysis.observability import explain

    solution = result.solution
    if not solution.converged or not solution.identification.combinations:
        return
    to = console()
    to.print("What these data cannot tell, and what to do:", soft_wrap=True)
    print_explanations(to, explain(solution.problem, solution.x, solution.identification))
