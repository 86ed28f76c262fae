"""``suta-calib plan``: where to measure next."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from suta_calib.analysis import planning
from suta_calib.check import Checker
from suta_calib.check.design import design_check
from suta_calib.check.read_back import read_back
from suta_calib.cli._options import (
    PATH,
    FiniteRange,
    chain_option,
    job_argument,
    option,
    out_option,
    region_option,
    seed_option,
)
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.job.calibration import CalibrationJob
from suta_calib.report.check_design import check_design_document
from suta_calib.report.document import Document
from suta_calib.report.plan import plan_document
from suta_calib.tracking.read_back import is_result
from suta_calib.units import from_deg, from_mm, stored

if TYPE_CHECKING:
    from suta_calib.arrays import FloatArray


@answer_command
@job_argument
@chain_option
@option(
    "-n",
    "Number of measurements to choose; default: 3, for a check 5.",
    click.IntRange(1, 50),
    name="count",
)
@option(
    "--for",
    "What the measurements are for: to calibrate better, or to check a calibration later; JOB may "
    "then be a folder of results.",
    click.Choice(["calibration", "check"]),
    "calibration",
    name="purpose",
)
@option("--candidates", "candidates.yaml; default: candidates within the region.", PATH)
@option(
    "--criterion",
    "Reduce the uncertainty of the tip in the region, or that of the parameters (D-optimal).",
    click.Choice(["tip", "d"]),
    "tip",
)
@region_option
@option("--repeats", "Repeats of each placement; default: as in the data.", click.IntRange(1, 100))
@option(
    "--tilt", "Largest tilt of the artefact that is considered, in deg.", FiniteRange(0, 90), 40.0
)
@option("--target-mm", "Target for the uncertainty of the tip.", FiniteRange(1e-6))
@option(
    "--least-gain",
    "Stop when one more measurement reduces the uncertainty of the tip by less than this, in %.",
    FiniteRange(0.1, 99),
    5.0,
)
@seed_option("Seed of the search.")
@out_option
def plan(
    job: Path,
    chain: str,
    count: int | None,
    purpose: str,
    candidates: Path | None,
    criterion: str,
    region: FloatArray | None,
    repeats: int | None,
    tilt: float,
    target_mm: float | None,
    least_gain: float,
    seed: int,
) -> Document:
    """Choose what to measure next for JOB (a calibration.yaml), and when to stop.

    Candidates are placements of the job's artefact, flat and tilted, single points touched from
    many directions, and postures for an instrument or a camera. Writes plan.csv, plan.yaml and
    drawings. The exit code is 1 if the calibration with the present data must not be used.
    """
    if purpose == "check":
        return _for_check(job, chain, count or 5, candidates, region, seed)
    loaded = CalibrationJob.load(job)
    with LateProgress("calibrating") as progress:
        situation = planning.situation_of_job(loaded, progress, chain)
    options = planning.PlanOptions(
        count or 3,
        criterion,
        repeats,
        None if target_mm is None else from_mm(target_mm),
        stored(least_gain, "%"),
        pool=planning.Pool(most_tilt=from_deg(tilt)),
        seed=seed,
    )
    places = None
    if candidates is not None:
        places, options = planning.candidate_places(candidates, situation, options)
    where = None if region is None else planning.Region.box(region[0], region[1], situation)
    with LateProgress("planning") as progress:
        chosen = planning.plan(situation, options, places, where, progress)
    return plan_document(chosen)


def _for_check(
    job: Path,
    chain: str,
    count: int,
    candidates: Path | None,
    region: FloatArray | None,
    seed: int,
) -> Document:
    """What would show most of what may change."""
    if is_result(job):
        checker = read_back(job).checker
    else:
        with LateProgress("calibrating") as progress:
            checker = Checker(CalibrationJob.load(job).usable_solution(progress))
    solution = checker.solution
    situation = planning.Situation.of(solution.problem, solution, "", chain)
    places = None
    if candidates is not None:
        options = planning.PlanOptions(count)
        places, _ = planning.candidate_places(candidates, situation, options)
    where = None if region is None else planning.Region.box(region[0], region[1], situation)
    return check_design_document(design_check(situation, checker, count, places, where, seed))
