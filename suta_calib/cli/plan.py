"""``suta-calib plan``: where to measure next."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from suta_calib.analysis import planning
from suta_calib.cli._fleet import answer_of_many, answer_of_one, are_many, many_jobs
from suta_calib.cli._options import (
    PATH,
    FiniteRange,
    chain_option,
    option,
    region_option,
    seed_option,
)
from suta_calib.cli._output import answer_command
from suta_calib.report.document import Document
from suta_calib.units import from_deg, from_mm, stored


@answer_command
@many_jobs()
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
def plan(job: tuple[Path, ...], **asked: Any) -> Document:
    """Choose what to measure next for JOB (a calibration.yaml), and when to stop.

    Candidates are placements of the job's artefact, flat and tilted, single points touched from
    many directions, and postures for an instrument or a camera. Writes plan.csv, plan.yaml and
    drawings. The exit code is 1 if the calibration with the present data must not be used.

    With several JOBs each is planned for by itself, in several processes, as by a command of its
    own. plan_summary.json and plan_summary.csv have a row for each. The exit code is that of the
    worst.
    """
    del job
    target = asked["target_mm"]
    options = planning.PlanOptions(
        criterion=asked["criterion"],
        repeats=asked["repeats"],
        target=None if target is None else from_mm(target),
        least_gain=stored(asked["least_gain"], "%"),
        pool=planning.Pool(most_tilt=from_deg(asked["tilt"])),
    )
    # Loads what the help does not need.
    from suta_calib.fleet import PlanNext

    same = ("purpose", "chain", "count", "candidates", "region", "seed")
    work = PlanNext(options=options, **{name: asked[name] for name in same})
    if are_many(click.get_current_context().params):
        return answer_of_many(work, "planning")
    return answer_of_one(work)
