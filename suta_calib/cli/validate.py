"""``suta-calib validate``: a job's held-out data through any URDF."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from suta_calib.cli._output import console, json_option, print_json
from suta_calib.errors import JobError

if TYPE_CHECKING:
    from rich.table import Table

    from suta_calib.analysis.accuracy import Accuracy, Metrics, TermAccuracy
    from suta_calib.model.parameters import Unit


@click.command()
@click.argument("urdf", type=click.Path(path_type=Path), metavar="URDF")
@click.argument("job", type=click.Path(path_type=Path), metavar="JOB")
@json_option
def validate(urdf: Path, job: Path, as_json: bool) -> None:
    """Run the validation data of JOB through URDF, such as a calibrated.urdf.

    The arm is held as the URDF has it. "before" is the job's own URDF, "after" the given one.
    """
    from suta_calib.analysis.comparison import compare_arms
    from suta_calib.job import CalibrationJob
    from suta_calib.model.arm import ArmModel

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
    accuracy = compare_arms(loaded.observations, loaded.validation, other)
    if as_json:
        print_json(validation_dict(accuracy, urdf))
    else:
        _print(accuracy, arm.urdf, urdf)


def validation_dict(accuracy: Accuracy, urdf: Path) -> dict[str, Any]:
    """The answer as data; the figures of ``validation`` are those of the first term's kind."""
    terms = accuracy.validation
    overall = {w: _numbers(accuracy.overall(terms, w), "m") for w in ("before", "after")}
    return {
        "urdf": str(urdf),
        "metrics": {"validation": {**overall, "by_term": [_by_term(t) for t in terms]}},
    }


def _by_term(term: TermAccuracy) -> dict[str, Any]:
    found: dict[str, Any] = {"kind": term.term.kind}
    for which in ("before", "after"):
        found[which] = _numbers(getattr(term, which), "m")
        for block in term.blocks[1:]:
            found[which] |= {"rms_deg": _numbers(_of(block, which), "rad")["rms_deg"]}
    return found


def _of(block: Any, which: str) -> Metrics:
    from suta_calib.analysis.accuracy import Metrics

    return Metrics.of(getattr(block, which))


def _numbers(metrics: Metrics, unit: Unit) -> dict[str, float | int]:
    from suta_calib.report.units import SHOWN_UNIT, shown

    values = (metrics.rms, metrics.mean, metrics.std, metrics.maximum)
    named = zip(("rms", "mean", "std", "max"), values, strict=True)
    found: dict[str, float | int] = {f"{k}_{SHOWN_UNIT[unit]}": shown(v, unit) for k, v in named}
    return found | {"count": metrics.count}


def _print(accuracy: Accuracy, own: Path, given: Path) -> None:
    to = console()
    to.print(_table(accuracy))
    to.print(f"before: {own}\nafter:  {given}", soft_wrap=True)


def _table(accuracy: Accuracy) -> Table:
    from rich import box
    from rich.table import Table

    from suta_calib.report.errors_by import by_kind
    from suta_calib.report.tables import quantity
    from suta_calib.report.units import percent

    table = Table(title="Validation errors", title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("of", min_width=12)
    table.add_column("arm", no_wrap=True)
    for heading in ("RMS", "mean", "std", "max", "unit", "count", "gain"):
        table.add_column(heading, justify="right", no_wrap=True)
    for errors in by_kind(accuracy.validation):
        before, after = errors.metrics
        table.add_row(quantity(errors), "before", *_cells(before, errors.unit), "")
        gain = percent(before.rms, after.rms)
        table.add_row("", "after", *_cells(after, errors.unit), gain, end_section=True)
    return table


def _cells(metrics: Metrics, unit: Unit) -> list[str]:
    from suta_calib.report.units import SHOWN_UNIT, text

    values = (metrics.rms, metrics.mean, metrics.std, metrics.maximum)
    return [*(text(v, unit) for v in values), SHOWN_UNIT[unit], str(metrics.count)]
