"""What an answer is tested for: every hypothesis in its own words, and how well it is found."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from markdown_pieces import first_paragraph, table

from suta_calib.registry import shipped
from suta_calib.terms import KINDS
from suta_calib.trust.hypothesis import (
    Hypothesis,
    Pattern,
    Reinterpretation,
    known_hypotheses,
)
from suta_calib.trust.misreadings import Misreading
from suta_calib.trust.rule import Rule

MEASURED = Path(__file__).resolve().parents[2] / "benchmarks" / "results" / "hypotheses.json"


def hypotheses_page() -> Iterator[str]:
    """The tables of all hypotheses, one for each shape, and the one rule that they share."""
    rule, measured = Rule(), json.loads(MEASURED.read_text(encoding="utf-8"))
    yield "# What an answer is tested for\n\n"
    yield (
        "Data can be wrong in many ways, and a model can be too simple. Each way is a "
        "*hypothesis*, one file in `suta_calib/trust/hypotheses/`. There are three sorts.\n\n"
    )
    sets = measured["false_alarms"].get("sets", 0)
    for shape, heading, text in (
        (None, "Effects that no parameter describes", of_effects(rule)),
        (Reinterpretation, "Data with another interpretation", of_readings(rule)),
        (Pattern, "Patterns of the samples", of_patterns()),
    ):
        yield f"## {heading}\n\n{text}\n\n"
        rows = (
            (name, h.about, where(h), first_paragraph(type(h)), *figures(h, measured))
            for name, h in shipped(known_hypotheses()).items()
            if (isinstance(h, shape) if shape else not isinstance(h, Reinterpretation | Pattern))
        )
        heads = "hypothesis", "what is wrong", "commands", "how it is described"
        yield table((*heads, "fault that was tried", "found"), rows)
        yield "\n"
    alarms = measured["false_alarms"].get("by_hypothesis", {})
    said = ", ".join(f"{name} {count}" for name, count in alarms.items()) or "none"
    yield (
        "## How the figures were measured\n\n"
        "`benchmarks/hypotheses.py` puts the fault of each hypothesis into sound simulated data "
        "and counts how often the hypothesis is what is named first. For effects it also makes "
        "the fault smaller, down to the smallest part that is still named in 90 % of the sets."
    )
    yield f" False alarms in {sets} sound sets of all sorts: {said}.\n" if sets else "\n"


def of_effects(rule: Rule) -> str:
    """The test of added variables, and the three conditions of a report."""
    return (
        "After a fit has converged, one statistical test looks for errors that the model lacks "
        "(`suta_calib/trust/evidence.py`). It adds the derivatives of such an error to the fit, "
        "and estimates its size together with all parameters. The drop in the squared residuals "
        "is compared with the remaining noise. The strongest effect is reported under three "
        "conditions: all tests of one answer together give a false alarm in at most "
        f"{rule.false_alarm:g} of sound answers; it explains {rule.share:.0%} of the "
        "squared residuals (or less where the hypothesis says so); and its size is "
        f"{rule.times_std:g} times its standard deviation."
    )


def of_readings(rule: Rule) -> str:
    """When another reading is named."""
    return (
        "If the result contradicts the data, every change to the samples or terms that is listed "
        "here is tried on the nominal arm. The best changes are then fitted like the job "
        "(`suta_calib/trust/rereading.py`). A change is reported if it reduces the misfit by a "
        f"factor of {rule.far_better:g}, to a size that the noise explains."
    )


def of_patterns() -> str:
    """What needs no fit."""
    return (
        "These are found in the samples without a fit: real measurements do not repeat to the last "
        "digit, and do not stay constant while an arm moves. A wrong label is found in the "
        "residuals of a robust fit, which gives such a row no weight."
    )


def figures(hypothesis: Hypothesis, measured: dict[str, Any]) -> tuple[str, str]:
    """The fault that was tried, and how well it is found."""
    says = getattr(type(hypothesis), "fault", type(hypothesis).spoil).__doc__ or ""
    fault = says.partition("\n")[0]
    of_it = measured["power"].get(hypothesis.name)
    if of_it is None:
        return fault, "not measured"
    if of_it["named"] is None:
        return fault, "refused before anything is solved"
    if of_it["smallest_part"] is not None and of_it["smallest_part"] < 1.0:
        return fault, f"from {of_it['smallest_part']:g} of it on, in 90 %"
    return fault, f"in {of_it['named']} of {of_it['sets']} sets"


def where(hypothesis: Hypothesis) -> str:
    """The kinds of observation and the commands that can have it."""
    commands = (
        "`calibrate`, `extend`" if hypothesis.needs_arm else "`pivot`, `hand-eye`, `register`"
    )
    if isinstance(hypothesis, Misreading) and hypothesis.needs_arm and hypothesis.reads_pairs:
        commands += ", `hand-eye`"
    kinds = [
        f"`{name}`"
        for name, kind in shipped(KINDS).items()
        if any(issubclass(kind, one) for one in hypothesis.applies_to)
    ]
    return commands if len(kinds) == len(shipped(KINDS)) else f"{commands} over {', '.join(kinds)}"
