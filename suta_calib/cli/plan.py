"""``suta-calib plan``: where to measure next."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from suta_calib.cli._analysis import finish_analysis, folder_of, out_option
from suta_calib.cli._numbers import FiniteRange
from suta_calib.cli._output import LateProgress, json_option
from suta_calib.cli._poses import LateStatus
from suta_calib.cli._region import box_of, region_option

if TYPE_CHECKING:
    from suta_calib.analysis.planning import Place, PlanOptions, Situation

_PATH = click.Path(path_type=Path)


@click.command()
@click.argument("job", type=_PATH, metavar="JOB")
@click.option(
    "-n", "count", type=click.IntRange(1, 50), default=3, show_default=True, help="How many."
)
@click.option(
    "--candidates", type=_PATH, help="candidates.yaml; searched in the region by default."
)
@click.option(
    "--criterion",
    type=click.Choice(["tip", "d"]),
    default="tip",
    show_default=True,
    help="Lessen the tip's uncertainty in the region, or the parameters' (D-optimal).",
)
@region_option
@click.option("--repeats", type=click.IntRange(1, 100), help="Of a placement; as in the data.")
@click.option(
    "--tilt",
    type=FiniteRange(0, 90),
    default=40.0,
    show_default=True,
    help="Largest tilt of the artefact looked at, deg.",
)
@click.option("--target-mm", type=FiniteRange(1e-6), help="Uncertainty of the tip to reach.")
@click.option(
    "--least-gain",
    type=FiniteRange(0.1, 99),
    default=5.0,
    show_default=True,
    help="Stop where one more lessens the tip's uncertainty by less, %.",
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of the search.")
@out_option
@json_option
@click.pass_context
def plan(
    context: click.Context,
    job: Path,
    count: int,
    candidates: Path | None,
    criterion: str,
    region: tuple[float, ...] | None,
    repeats: int | None,
    tilt: float,
    target_mm: float | None,
    least_gain: float,
    seed: int,
    out: Path | None,
    as_json: bool,
) -> None:
    """Choose what to measure next for JOB (a calibration.yaml), and say when to stop.

    Candidates are placements of the job's artefact, flat and tilted, single points touched from
    many directions, and postures where an instrument or a camera is used. Writes plan.csv,
    plan.yaml and drawings. Exits with 1 where the calibration of the present data may not be used.
    """
    from suta_calib.analysis.planning import PlanOptions, Pool
    from suta_calib.analysis.planning import plan as choose
    from suta_calib.report.planning.json import plan_dict, plan_verdict
    from suta_calib.report.planning.report import bench_files, plan_section
    from suta_calib.report.planning.tables import plan_tables

    folder = folder_of(job, out)
    situation = _situation(job)
    options = PlanOptions(
        count,
        criterion,
        repeats,
        None if target_mm is None else 1e-3 * target_mm,
        least_gain / 100,
        pool=Pool(most_tilt=math.radians(tilt)),
        seed=seed,
    )
    places, options = _places(candidates, situation, options)
    with LateStatus("planning"):
        found = choose(situation, options, places, box_of(region, situation))
    finish_analysis(
        context,
        plan_dict(found),
        lambda: plan_tables(found),
        lambda: plan_section(found),
        folder,
        as_json=as_json,
        usable=plan_verdict(found).usable,
        texts=bench_files(found),
    )


def _situation(job: Path) -> Situation:
    """The job at its solution, or at nominal where its data cannot be fitted yet."""
    from suta_calib.analysis.planning import Situation
    from suta_calib.errors import SamplesError
    from suta_calib.job.calibration import CalibrationJob
    from suta_calib.solver.solve import solve

    loaded = CalibrationJob.load(job)
    problem = loaded.problem()
    try:
        with LateProgress("calibrating") as progress:
            solution = solve(problem, loaded.options(), progress)
    except SamplesError:  # too little data is what a plan is for
        return Situation.of(problem)
    return Situation.of(problem, solution)


def _places(
    file: Path | None, situation: Situation, options: PlanOptions
) -> tuple[tuple[Place, ...] | None, PlanOptions]:
    from dataclasses import replace

    from suta_calib.analysis.planning import read_candidates

    if file is None:
        return None, options
    artefact = situation.artefact
    repeats = options.repeats or situation.repeats
    touches = 20 if artefact is None else repeats * len(artefact.landmarks)
    read = read_candidates(file, situation.arm, touches)
    return read.places, replace(options, repeats=options.repeats or read.repeats)
