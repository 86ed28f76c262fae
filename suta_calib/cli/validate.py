"""``suta-calib validate``: a job's held-out data through any URDF."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from suta_calib.cli._output import console, json_option, print_json
from suta_calib.errors import JobError

if TYPE_CHECKING:
    from suta_calib.diagnostics.accuracy import Accuracy


@click.command()
@click.argument("urdf", type=click.Path(path_type=Path), metavar="URDF")
@click.argument("job", type=click.Path(path_type=Path), metavar="JOB")
@click.option(
    "--result",
    type=click.Path(path_type=Path),
    help="The result.json beside it: corrects eccentric encoders and yielding joints too.",
)
@json_option
def validate(urdf: Path, job: Path, result: Path | None, as_json: bool) -> None:
    """Run the validation data of JOB through URDF, such as a calibrated.urdf.

    The arm is held as the URDF has it. "before" is the job's own URDF, "after" the given one.
    """
    from suta_calib.analysis.comparison import check_calibrated, compare_arms
    from suta_calib.job.calibration import CalibrationJob
    from suta_calib.model.arm import ArmModel
    from suta_calib.tracking.uncertainty import read_uncertainty

    loaded = CalibrationJob.load(job)
    if not loaded.validation:
        raise JobError(
            "no validation data",
            "at least one row of samples that were not fitted",
            file=job,
            where="validation",
        )
    arm = loaded.spec.arm
    other = ArmModel.from_urdf(urdf, arm.tip, arm.base)
    beside: dict[str, float] = {}
    if result is not None:
        found = read_uncertainty(result, other)
        check_calibrated(loaded.arm, other, found.values)
        beside = found.beside_geometry
    accuracy = compare_arms(loaded.observations, loaded.validation, other, beside)
    if as_json:
        print_json(validation_dict(accuracy, urdf))
    else:
        _print(accuracy, arm.urdf, urdf)


def validation_dict(accuracy: Accuracy, urdf: Path) -> dict[str, Any]:
    """The answer as data; the figures of ``validation`` are those of the first term's kind."""
    from suta_calib.report.result_json import accuracy_dict

    terms = accuracy.validation
    by_term = [{"kind": term.term.kind} | accuracy_dict([term]) for term in terms]
    return {
        "urdf": str(urdf),
        "metrics": {"validation": {**accuracy_dict(terms), "by_term": by_term}},
    }


def _print(accuracy: Accuracy, own: Path, given: Path) -> None:
    from suta_calib.report.tables import errors_table

    to = console()
    to.print(errors_table({"validation": accuracy.validation}))
    to.print(f"before: {own}\nafter:  {given}", soft_wrap=True)
