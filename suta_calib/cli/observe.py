"""``suta-calib observe``: what a job's data can and cannot determine, before any solving."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from suta_calib.cli._output import console, json_option, print_json, verbose_option

if TYPE_CHECKING:
    from suta_calib.diagnostics.observability import Observability, Prospect


@click.command()
@click.argument("job", type=click.Path(path_type=Path), metavar="JOB")
@json_option
@verbose_option
def observe(job: Path, as_json: bool, verbose: bool) -> None:
    """Say what the data of JOB (a calibration.yaml) can and cannot determine.

    Nothing is solved: the answer follows from the readings, the nominal arm and the assumed
    noise. For each parameter the data cannot tell it says why, and what to measure instead.
    """
    from suta_calib.diagnostics.observability import observe as look
    from suta_calib.job.calibration import CalibrationJob

    found = look(CalibrationJob.load(job).problem())
    if as_json:
        print_json(observability_dict(found))
    else:
        _print(found, verbose)


def observability_dict(found: Observability) -> dict[str, Any]:
    """The answer as data, SI units."""
    return {
        "verdict": found.sentence,
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
            {"held": e.fixed, "sentence": e.sentence, "remedy": e.remedy}
            for e in found.explanations
        ],
    }


def _prospect(p: Prospect) -> dict[str, Any]:
    given = {"given": list(p.given)} if p.given else {}
    known: dict[str, Any] = {"unit": p.unit, "nominal": p.nominal, "plausible": p.plausible}
    return known | {"bound": p.bound, "prior": p.prior, "std": p.std, "state": p.state} | given


def _print(found: Observability, verbose: bool) -> None:
    from suta_calib.report.tables import observability_table, observability_words

    to = console()
    to.print(observability_table(found, verbose=verbose))
    to.print(_conditioning(found))
    to.print(observability_words(found))


def _conditioning(found: Observability) -> str:
    identified = len(found.singular_values)
    if not identified:
        return "The data alone identify nothing."
    indices = ", ".join(f"{name} {value:.3g}" for name, value in found.indices.as_dict().items())
    return (
        f"Of the {identified} that the data identify: condition number {found.condition:.3g}, "
        f"{indices} (parameters in plausible ranges, residuals in sigmas)."
    )
