"""``suta-calib repeatability``: visits to one point, and encoders at rest."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.analysis import repeatability as repeated
from suta_calib.cli._options import (
    PATH,
    FiniteRange,
    Folder,
    option,
    optional_arm,
    seed_option,
    urdf_option,
)
from suta_calib.cli._output import LateProgress, answer_command
from suta_calib.inputs import UrdfFile
from suta_calib.measurements import SampleColumns, read_csv_table, read_samples
from suta_calib.report.document import Document
from suta_calib.report.repeatability import repeatability_document
from suta_calib.terms.poses import joint_ranges


@answer_command
@click.argument("samples", type=PATH, metavar="[SAMPLES.csv]…", nargs=-1)
@urdf_option("URDF of the arm, calibrated as well as possible.")
@option("--tip", "Link or frame that visited the point.")
@option("--base", "First link of the chain; default: the root link.")
@option(
    "--stationary STREAM",
    "CSV or Parquet of an arm at rest, with time and one column per joint.",
    PATH,
    name="at_rest",
)
@option("--confidence", "Confidence of the intervals, in %.", FiniteRange(50.0, 99.9), 95.0)
@seed_option("Seed of the permutations for the test of directions.")
@option("--out", "Folder for repeatability.json, pictures and report.html.", Folder())
def repeatability(
    samples: tuple[Path, ...],
    urdf: UrdfFile | None,
    tip: str | None,
    base: str | None,
    at_rest: Path | None,
    confidence: float,
    seed: int,
) -> Document:
    """Measure the repeatability of an arm at one point (ISO 9283), and its encoders at rest.

    All rows of SAMPLES.csv are visits to one point. There is a column per joint, and optionally
    `direction` (of the push on the seated tip) and `protocol` (ways of visiting, which are
    compared). With the columns `placement` and `landmark`, as in a calibration's samples, each
    landmark of a placement is a separate point, and the scatter of all repeats is combined. With
    --stationary but without SAMPLES.csv, only the encoders are analysed. The exit code is 1 if an
    arm that should have been at rest moved.
    """
    if not samples and at_rest is None:
        raise click.UsageError("give SAMPLES.csv (visits to one point), --stationary, or both")
    if urdf is None and samples:
        raise click.UsageError("SAMPLES.csv needs --urdf and --tip, the arm that made these visits")
    arm = optional_arm(urdf, tip, base, "visited the point")
    visits = touches = rest = None
    with LateProgress("comparing visits"):
        if arm is not None and samples:
            given = set.intersection(*(set(read_csv_table(path).columns) for path in samples))
            many = given >= {*repeated.POINT}
            label_columns = repeated.POINT if many else (repeated.DIRECTION, repeated.PROTOCOL)
            columns = SampleColumns(labels=tuple(n for n in label_columns if n in given))
            rows = read_samples(samples, joint_ranges(arm), columns)
            if many:
                touches = repeated.repeated_touches(arm, rows, confidence=confidence / 100)
            else:
                visits = repeated.repeatability(arm, rows, confidence=confidence / 100, seed=seed)
        if at_rest is not None and arm is None:
            rest = repeated.stationary(repeated.read_stream(at_rest))
        elif at_rest is not None and arm is not None:
            stream = repeated.read_stream(at_rest, arm.joints)
            units = [joint.unit for joint in joint_ranges(arm)]
            levers = repeated.tip_levers(arm, stream.readings[:1])
            rest = repeated.stationary(stream, units, levers)
    return repeatability_document(repeated.RepeatabilityTest(visits, rest, touches))
