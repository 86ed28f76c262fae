"""``suta-calib observe``: what a job's data can and cannot determine, before any solving."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from suta_calib.cli._output import console, json_option, print_explanations, print_json

if TYPE_CHECKING:
    from rich.table import Table

    from suta_calib.analysis.observability import Observability, Prospect


@click.command()
@click.argument("job", type=click.Path(path_type=Path), metavar="JOB")
@json_option
def observe(job: Path, as_json: bool) -> None:
    """Say what the data of JOB (a calibration.yaml) can and cannot determine.

    Nothing is solved: the answer follows from the readings, the nominal arm and the assumed
    noise. For each parameter the data cannot tell it says why, and what to measure instead.
    """
    from suta_calib.analysis.observability import observe as look
    from suta_calib.job import CalibrationJob

    found = look(CalibrationJob.load(job).problem())
    if as_json:
        print_json(observability_dict(found))
    else:
        _print(found)


def observability_dict(found: Observability) -> dict[str, Any]:
    """The answer as data, SI units."""
    return {
        "verdict": found.verdict,
        "samples": found.samples,
        "equations": found.equations,
        "unknowns": found.unknowns,
        "rank": found.rank,
        "asked": found.asked,
        "condition": found.condition,
        "singular_values": found.singular_values.tolist(),
        "indices": found.indices.as_dict(),
        "parameters": {name: _prospect(p) for name, p in found.prospects.items()},
        "unidentified": list(found.unidentified),
        "unobservable": [c.direction for c in found.identification.combinations if not c.alone],
        "explanations": [
            {"held": e.held, "sentence": e.sentence, "remedy": e.remedy} for e in found.explanations
        ],
    }


def _prospect(p: Prospect) -> dict[str, Any]:
    given = {"given": list(p.given)} if p.given else {}
    known: dict[str, Any] = {"unit": p.unit, "nominal": p.nominal, "plausible": p.plausible}
    return known | {"bound": p.bound, "prior": p.prior, "std": p.std, "state": p.state} | given


def _print(found: Observability) -> None:
    to = console()
    to.print(_table(found))
    to.print(found.verdict + ".", soft_wrap=True)
    indices = "  ".join(f"{name} {value:.3g}" for name, value in found.indices.as_dict().items())
    identified = len(found.singular_values)
    to.print(
        f"For the {identified} that the data identify: condition number {found.condition:.3g}; "
        f"{indices} (parameters in plausible ranges, residuals in sigmas).",
        soft_wrap=True,
    )
    if found.explanations:
        to.print("What these data cannot tell, and what to do:", soft_wrap=True)
        print_explanations(to, found.explanations)


def _table(found: Observability) -> Table:
    from rich.table import Table

    from suta_calib.report.units import SHOWN_UNIT, text

    table = Table(title="What the data can tell")
    table.add_column("parameter", no_wrap=True)
    for heading in ("predicted ±", "plausible ±", "prior ±"):
        table.add_column(heading, justify="right")
    table.add_column("unit")
    table.add_column("state")
    table.add_column("given", overflow="fold")
    count = found.problem.arm_count or len(found.prospects)
    for p in list(found.prospects.values())[:count]:
        numbers = [text(v, p.unit) for v in (p.std, p.plausible, p.prior)]
        table.add_row(p.name, *numbers, SHOWN_UNIT[p.unit], p.state, ", ".join(p.given))
    return table
