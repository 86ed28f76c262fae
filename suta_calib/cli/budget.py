"""``suta-calib budget``: what a calibration's errors come from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from suta_calib.cli._analysis import finish_analysis, folder_of, out_option
from suta_calib.cli._output import LateProgress, json_option
from suta_calib.errors import SamplesError

if TYPE_CHECKING:
    from suta_calib.analysis.encoder_noise import EncoderNoise
    from suta_calib.job.calibration import CalibrationJob


@click.command()
@click.argument("job", type=click.Path(path_type=Path), metavar="JOB")
@out_option
@json_option
@click.pass_context
def budget(context: click.Context, job: Path, out: Path | None, as_json: bool) -> None:
    """Split the errors of JOB (a calibration.yaml) by where they come from.

    Encoder noise (as the job's section encoders states it), seating (what repeats of a touch
    scatter), the artefact (its sigma_mm), gross errors, and the model: what none of these explains.
    What the data cannot tell apart stands together, without numbers of its own.
    """
    from suta_calib.analysis.error_budget import error_budget
    from suta_calib.job.calibration import CalibrationJob
    from suta_calib.report.error_budget import budget_dict, budget_section, budget_tables

    loaded = CalibrationJob.load(job)
    folder = folder_of(job, out)
    with LateProgress("solving") as progress:
        result = loaded.run(progress)
    if not result.solution.converged:
        raise SamplesError(
            f"a calibration that may not be used ({result.solution.sentence})",
            "one that converged",
            file=job,
            hint="run suta-calib calibrate, and mend what it names",
        )
    found = error_budget(result.solution, loaded.validation, _encoders(loaded))
    finish_analysis(
        context,
        budget_dict(found),
        lambda: budget_tables(found),
        lambda: budget_section(found),
        folder,
        as_json=as_json,
        usable=True,
    )


def _encoders(job: CalibrationJob) -> EncoderNoise | None:
    from suta_calib.analysis.encoder_noise import EncoderNoise

    stated = job.spec.encoders
    if stated is None:
        return None
    return EncoderNoise(stated.bits, stated.noise_rad, stated.noise_m)
