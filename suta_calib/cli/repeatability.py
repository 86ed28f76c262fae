"""``suta-calib repeatability``: visits to one point, and encoders at rest."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from suta_calib.cli._options import (
    PATH,
    FiniteRange,
    Folder,
    optional_arm,
    seed_option,
)
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.report.document import Document

if TYPE_CHECKING:
    from suta_calib.analysis.repeatability import Repeatability, Stationary
    from suta_calib.model.arm import ArmModel


@answer_command
@click.argument("samples", type=PATH, metavar="[SAMPLES.csv]", required=False)
@click.option("--urdf", type=PATH, help="The arm, as well calibrated as it is.")
@click.option("--tip", help="Link or frame that visited the point.")
@click.option("--base", help="Link the chain starts from; default: the root link.")
@click.option(
    "--stationary",
    "at_rest",
    type=PATH,
    metavar="STREAM",
    help="CSV or Parquet of an arm at rest: time and a column per joint.",
)
@click.option(
    "--confidence", type=FiniteRange(50.0, 99.9), default=95.0, help="Of the intervals, %."
)
@seed_option("Of the permutations that tell directions from noise.")
@click.option(
    "--out", type=Folder(), help="Folder for repeatability.json, pictures and report.html."
)
def repeatability(
    samples: Path | None,
    urdf: Path | None,
    tip: str | None,
    base: str | None,
    at_rest: Path | None,
    confidence: float,
    seed: int,
) -> Document:
    """How well an arm comes back to one point (ISO 9283), and what its encoders do at rest.

    All rows of SAMPLES.csv visited one point: a column per joint, and optionally `direction` (of
    the push on the seated tip) and `protocol` (ways to visit, compared with one another). Without
    SAMPLES.csv, --stationary alone looks at the encoders. Exits with 1 where an arm that should
    have been at rest moved.
    """
    from suta_calib.analysis.repeatability import RepeatabilityTest
    from suta_calib.report.repeatability import repeatability_document

    arm = _arm(samples, urdf, tip, base, at_rest)
    with LateProgress("comparing visits"):
        visits = _visits(arm, samples, confidence / 100, seed) if arm and samples else None
        rest = None if at_rest is None else _rest(arm, at_rest)
    return repeatability_document(RepeatabilityTest(visits, rest))


def _arm(
    samples: Path | None, urdf: Path | None, tip: str | None, base: str | None, at_rest: Path | None
) -> ArmModel | None:
    if samples is None and at_rest is None:
        raise click.UsageError("give SAMPLES.csv (visits to one point), --stationary, or both")
    if urdf is None and samples is not None:
        raise click.UsageError("SAMPLES.csv needs --urdf and --tip: whose visits these are")
    return optional_arm(urdf, tip, base, "visited the point")


def _visits(arm: ArmModel, path: Path, confidence: float, seed: int) -> Repeatability:
    from suta_calib.analysis.repeatability import DIRECTION, PROTOCOL, repeatability
    from suta_calib.job.calibration import joint_ranges
    from suta_calib.measurements import SampleColumns, read_csv_table, read_samples

    columns = read_csv_table(path).columns
    labels = tuple(name for name in (DIRECTION, PROTOCOL) if name in columns)
    samples = read_samples([path], joint_ranges(arm), SampleColumns(labels=labels))
    return repeatability(arm, samples, confidence=confidence, seed=seed)


def _rest(arm: ArmModel | None, path: Path) -> Stationary:
    from suta_calib.analysis.repeatability import read_stream, stationary, tip_levers
    from suta_calib.job.calibration import joint_ranges

    if arm is None:
        return stationary(read_stream(path))
    stream = read_stream(path, arm.joints)
    units = [joint.unit for joint in joint_ranges(arm)]
    return stationary(stream, units, tip_levers(arm, stream.readings[:1]))
