"""``suta-calib tip-map``: how sure the tip is, over the whole workspace."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from suta_calib.analysis.comparison import check_nominal
from suta_calib.analysis.tip_map import TipMapOptions, tip_map_of_result, tip_map_of_solution
from suta_calib.analysis.tip_sections import Knowledge
from suta_calib.cli._options import (
    PATH,
    FiniteRange,
    anyway_option,
    chain_option,
    option,
    out_option,
    place_option,
    region_option,
    seed_option,
    urdf_option,
)
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.inputs import UrdfFile
from suta_calib.job.calibration import CalibrationJob
from suta_calib.model.arm import ArmModel
from suta_calib.report.document import Document
from suta_calib.report.tip_map import tip_map_document
from suta_calib.tracking.uncertainty import read_uncertainty
from suta_calib.units import from_mm

if TYPE_CHECKING:
    from suta_calib.analysis.tip_map import TipMap, TipMapOptions
    from suta_calib.arrays import FloatArray


@answer_command
@click.argument("job", type=PATH, metavar="JOB|result.json", is_eager=True)
@chain_option
@urdf_option("With result.json: the nominal arm from which it was made.")
@option("--tip", "With result.json: link or frame of the tip.")
@option("--base", "With result.json: first link of the chain; default: the root.")
@anyway_option
@region_option
@place_option
@option("--tolerance-mm", "Largest acceptable RMS; above it the exit code is 1.", FiniteRange(1e-6))
@option("--grid", "Number of points along each side of the map.", click.IntRange(5, 301), 61)
@seed_option("Seed of the search.")
@out_option
def tip_map(
    job: Path,
    chain: str,
    urdf: UrdfFile | None,
    tip: str | None,
    base: str | None,
    anyway: bool,
    region: FloatArray | None,
    register_at: FloatArray | None,
    tolerance_mm: float | None,
    grid: int,
    seed: int,
) -> Document:
    """Map the uncertainty of the tip that comes from the uncertainty of the calibration.

    The full covariance of JOB's calibration (a calibration.yaml), or of a result.json with its arm,
    gives figures for a region and a map over the workspace, absolute and after registration.
    """
    tolerance = None if tolerance_mm is None else from_mm(tolerance_mm)
    options = TipMapOptions(region, register_at, tolerance, grid, seed, chain)
    if urdf is not None:
        result = _of_result(job, urdf, tip, base, options, anyway=anyway)
    elif tip is not None or job.suffix.lower() == ".json":
        raise click.UsageError(
            "a result.json needs --urdf and --tip, the arm from which it was made"
        )
    else:
        result = _of_job(job, options, anyway=anyway)
    return tip_map_document(result)


def _of_job(job: Path, options: TipMapOptions, *, anyway: bool) -> TipMap:
    with LateProgress("calibrating") as progress:
        solution = CalibrationJob.load(job).usable_solution(progress, anyway=anyway)
    with LateProgress("mapping"):
        return tip_map_of_solution(solution, options)


def _of_result(
    result: Path,
    urdf: UrdfFile,
    tip: str | None,
    base: str | None,
    options: TipMapOptions,
    *,
    anyway: bool,
) -> TipMap:
    if tip is None or options.box is None:
        raise click.UsageError(
            "a result.json needs --tip and --region, because it contains no samples"
        )
    arm = ArmModel.from_urdf(urdf, tip, base)
    read = read_uncertainty(result, arm, anyway=anyway)
    check_nominal(arm, result, read.values)
    knowledge = Knowledge.unvisited(
        arm, read.values, read.names, read.covariance, read.fixed, read.held
    )
    with LateProgress("mapping"):
        return tip_map_of_result(knowledge, options)
