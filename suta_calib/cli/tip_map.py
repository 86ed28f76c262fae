"""``suta-calib tip-map``: how sure the tip is, over the whole workspace."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from suta_calib.cli._analysis import finish_analysis, folder_of, out_option
from suta_calib.cli._numbers import FiniteRange
from suta_calib.cli._output import LateProgress, anyway_option, json_option
from suta_calib.cli._poses import LateStatus
from suta_calib.cli._region import place_option, region_option
from suta_calib.errors import SamplesError

if TYPE_CHECKING:
    from suta_calib.analysis.planning import Region
    from suta_calib.analysis.tip_sections import Knowledge
    from suta_calib.arrays import FloatArray

_PATH = click.Path(path_type=Path)
# Points to register where there is no artefact: the corners of a box as large as one, m.
_HALF = 0.08
_ANYWHERE = 400


@click.command("tip-map")
@click.argument("source", type=_PATH, metavar="JOB|result.json")
@click.option("--urdf", type=_PATH, help="With result.json: the nominal arm it was made from.")
@click.option("--tip", help="With result.json: link or frame of the tip.")
@click.option("--base", help="With result.json: link the chain starts at; default: the root.")
@anyway_option
@region_option
@place_option
@click.option("--tolerance-mm", type=FiniteRange(1e-6), help="Exit code 1 if the RMS is larger.")
@click.option(
    "--grid",
    type=click.IntRange(5, 301),
    default=61,
    show_default=True,
    help="Points along each side of the map.",
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of the search.")
@out_option
@json_option
@click.pass_context
def tip_map(
    context: click.Context,
    source: Path,
    urdf: Path | None,
    tip: str | None,
    base: str | None,
    anyway: bool,
    region: tuple[float, ...] | None,
    register_at: tuple[float, ...] | None,
    tolerance_mm: float | None,
    grid: int,
    seed: int,
    out: Path | None,
    as_json: bool,
) -> None:
    """Map how far the tip may be off because the arm is not known better.

    From the full covariance of JOB's calibration (a calibration.yaml), or of a result.json with
    its arm: figures over a region and a map over the arm, absolute and after registration.
    """
    from suta_calib.analysis.tip_map import tip_map as chart
    from suta_calib.report.tip_map.report import (
        tip_map_dict,
        tip_map_section,
        tip_map_tables,
        tip_map_verdict,
    )

    folder = source.parent if out is None and urdf else folder_of(source, out)
    box = None if region is None else 1e-3 * np.array(region)
    if urdf is not None:
        knowledge, where, centre, points = _from_result(source, urdf, tip, base, box, anyway=anyway)
    else:
        knowledge, where, centre, points = _from_job(source, tip, box)
    place = centre if register_at is None else 1e-3 * np.array(register_at)
    tolerance = None if tolerance_mm is None else 1e-3 * tolerance_mm
    tips = knowledge.arm.forward(knowledge.visited, knowledge.values)[1]
    with LateStatus("mapping"):
        postures = where.postures(knowledge.kinematics, knowledge.visited, tips, seed)
        found = chart(knowledge, where, place, points, postures, grid=grid, seed=seed)
    finish_analysis(
        context,
        tip_map_dict(found, tolerance),
        lambda: tip_map_tables(found, tolerance),
        lambda: tip_map_section(found, tolerance),
        folder,
        as_json=as_json,
        usable=tip_map_verdict(found, tolerance).usable,
    )


Start = tuple["Knowledge", "Region", "FloatArray", "FloatArray"]


def _from_job(job: Path, tip: str | None, box: FloatArray | None) -> Start:
    """What the job's calibration knows, a region, and where and what one registers."""
    from suta_calib.analysis.planning import Region, Situation
    from suta_calib.analysis.tip_sections import Knowledge
    from suta_calib.job.calibration import CalibrationJob
    from suta_calib.solver.solve import solve

    if tip is not None or job.suffix.lower() == ".json":
        raise click.UsageError("a result.json needs --urdf and --tip: the arm it was made from")
    loaded = CalibrationJob.load(job)
    with LateProgress("calibrating") as progress:
        solution = solve(loaded.problem(), loaded.options(), progress)
    if not solution.converged:
        raise SamplesError(
            f"a calibration that may not be used ({solution.sentence})",
            "one that converged",
            file=job,
            hint="run suta-calib calibrate, and mend what it names",
        )
    situation = Situation.of(solution.problem, solution)
    where = Region.around(situation)
    if box is not None:
        where = Region.box(box[::2], box[1::2], situation)
    marks = situation.artefact
    points = _corners()
    if marks is not None and len(marks.landmarks) >= len("xyz"):
        certified = np.array([mark.position for mark in marks.landmarks.values()])
        points = certified - certified.mean(axis=0)
    return Knowledge.of(solution), where, situation.tips[1].mean(axis=0), points


def _from_result(
    result: Path,
    urdf: Path,
    tip: str | None,
    base: str | None,
    box: FloatArray | None,
    *,
    anyway: bool,
) -> Start:
    """The same from a file; the tool points straight down."""
    from suta_calib.analysis.planning import Region
    from suta_calib.analysis.planning.candidates_file import DOWN
    from suta_calib.analysis.tip_sections import Knowledge
    from suta_calib.model.arm import ArmModel
    from suta_calib.simulation.inverse_kinematics import InverseKinematics
    from suta_calib.tracking.uncertainty import read_uncertainty

    if tip is None or box is None:
        raise click.UsageError("a result.json needs --tip and --region: it knows no samples")
    arm = ArmModel.from_urdf(urdf, tip, base)
    read = read_uncertainty(result, arm, anyway=anyway)
    q = InverseKinematics(arm, {}).random_readings(np.random.default_rng(0), _ANYWHERE)
    where = Region(box[::2], box[1::2], np.array(DOWN))
    knowledge = Knowledge(arm, read.values, read.names, read.covariance, read.held, q)
    return knowledge, where, (where.lower + where.upper) / 2, _corners()


def _corners() -> FloatArray:
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    return np.asarray(_HALF * signs)
