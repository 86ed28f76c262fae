"""Results as tables for a terminal of 100 columns; readable without colour."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from suta_calib.assessment import Assessment, Level
from suta_calib.diagnostics.accuracy import Accuracy, Metrics, TermAccuracy
from suta_calib.diagnostics.observability import Explanation, Observability, Prospect, explain
from suta_calib.report.console import bullet, plain_table, verdict_lines
from suta_calib.report.errors_by import KindErrors, by_kind
from suta_calib.report.result import Result
from suta_calib.report.verdict import judge, listed
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Estimate, Solution, State
from suta_calib.units import NOTHING, Unit, percent, text, unit_name

MOST_SENTENCES: Final = 3
MOST_ROWS: Final = 20
# Names that fit into eighty columns beside the figures and the space between them.
LONG_NAME: Final = 14
STATE_COLOUR: Final[dict[State, str]] = {
    "identified": "green",
    "unidentified": "yellow",
    "prior": "cyan",
    "at_bound": "red",
    "fixed": "dim",
}


def summary(result: Result, *, verbose: bool = False) -> RenderableType:
    """Everything a console shows of a calibration: tables, then the words.

    Args:
        result: job, solution and accuracy.
        verbose: also the terms' own parameters (placements, points, instruments).
    """
    parts: list[RenderableType] = []
    if result.solution.converged:
        parts.append(parameter_table(result.solution, verbose=verbose))
    errors = accuracy_table(result.accuracy)
    if not result.solution.converged:
        errors.caption = "not converged: 'after' is only where the solver stopped"
    parts.append(errors)
    return Group(*parts, "", words(result))


def words(result: Result) -> RenderableType:
    """The verdict, what must be known, and why parameters were held and what to do about it."""
    return Group(*verdict_lines(judge(result)), *_explained(_on_the_arm(result.solution)))


def explanations(solution: Solution) -> tuple[Explanation, ...]:
    """Why parameters are held; empty where the solution may not be used."""
    if not solution.converged:
        return ()
    return explain(solution.problem, solution.x, solution.identification)


def _on_the_arm(solution: Solution) -> list[Explanation]:
    arm = set(solution.problem.names[: solution.problem.arm_count])
    return [e for e in explanations(solution) if e.fixed in arm or not arm]


def parameter_table(solution: Solution, *, verbose: bool = False) -> Table:
    """Nominal, value, change and standard deviation of every parameter, mm and deg.

    Args:
        solution: a converged one.
        verbose: also the terms' own parameters, those that stayed where their prior has them
            and, of a long list, those held; otherwise one line counts them.
    """
    table = plain_table("Parameters")
    estimates = list(solution.estimates.values())
    arm = solution.problem.arm_count
    shown = estimates if verbose else _worth_showing(estimates[:arm])
    if max((len(e.name) for e in shown), default=0) > LONG_NAME:
        table.padding = 0
    table.add_column("parameter", overflow="fold", min_width=14)
    for name in ("nominal", "value", "change", "± std"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("state", no_wrap=True)
    if any(e.given for e in shown):
        table.add_column("given", overflow="fold", max_width=24)
    for estimate in shown:
        table.add_row(*_parameter_cells(estimate)[: len(table.columns)])
    if not verbose:
        own = estimates[arm:]
        table.caption = _left_out(solution.problem, own, unmoved=arm - len(shown))
    return table


def accuracy_table(accuracy: Accuracy) -> Table:
    """`errors_table` of the calibration and of the validation data."""
    sets = {"calibration": accuracy.calibration, "validation": accuracy.validation}
    return errors_table(sets)


def errors_table(sets: Mapping[str, Sequence[TermAccuracy]]) -> Table:
    """RMS, mean, standard deviation and maximum before and after, and the improvement.

    Args:
        sets: terms by what their data are; one pair of rows for each, and for each kind and
            quantity where there are several.
    """
    table = plain_table("Errors")
    # Figures must not be cut where a terminal has its usual eighty columns: words fold instead.
    table.padding = 0
    table.add_column("data", no_wrap=True)
    table.add_column("of", overflow="fold", min_width=12, max_width=18)
    table.add_column("state", no_wrap=True)
    for name in ("RMS", "mean", "std", "max"):
        table.add_column(name, justify="right", no_wrap=True, min_width=6)
    table.add_column("count", justify="right", no_wrap=True)
    table.add_column("improvement", justify="right", no_wrap=True)
    for name, terms in sets.items():
        _add_errors(table, name, terms)
    return table


def observability_table(observability: Observability, *, verbose: bool = False) -> Table:
    """Predicted standard deviation of every parameter against its plausible range, mm and deg."""
    table = plain_table("What these readings can determine")
    prospects = list(observability.prospects.values())
    arm = observability.problem.arm_count or len(prospects)
    shown = prospects if verbose else prospects[:arm]
    if max((len(p.name) for p in shown), default=0) > LONG_NAME:
        table.padding = 0
    table.add_column("parameter", overflow="fold", min_width=14)
    for name in ("plausible", "predicted ± std"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("state", no_wrap=True)
    table.add_column("given", overflow="fold", max_width=24)
    for prospect in shown:
        table.add_row(*_prospect_cells(prospect))
    if not verbose:
        table.caption = _left_out(observability.problem, prospects[arm:])
    return table


def observability_words(observability: Observability) -> RenderableType:
    """The verdict in one sentence, then why parameters would be held and what to do about it."""
    level: Level = "care" if observability.unidentified else "good"
    assessment = Assessment(level, observability.sentence)
    return Group(*verdict_lines(assessment), *_explained(observability.explanations))


def _parameter_cells(e: Estimate) -> list[RenderableType]:
    change = NOTHING if e.state in ("unidentified", "fixed") else _change(e)
    return [
        Text(e.name),
        text(e.nominal, e.unit),
        text(e.value, e.unit),
        change,
        text(e.std, e.unit),
        unit_name(e.unit),
        _state(e.state),
        Text(listed(list(e.given), 3)),
    ]


def _change(e: Estimate) -> str:
    return text(e.value - e.nominal, e.unit, sign=True)


def _prospect_cells(p: Prospect) -> list[RenderableType]:
    return [
        Text(p.name),
        f"± {text(p.plausible, p.unit)}",
        text(p.std, p.unit),
        unit_name(p.unit),
        _state(p.state),
        Text(listed(list(p.given), 3)),
    ]


def _state(state: State) -> Text:
    return Text(state.replace("_", " "), style=STATE_COLOUR[state])


def _worth_showing(estimates: Sequence[Estimate]) -> list[Estimate]:
    many = len(estimates) > MOST_ROWS
    return [e for e in estimates if not (_at_prior(e) or (many and e.state == "unidentified"))]


def _at_prior(e: Estimate) -> bool:
    """Whether the data moved it by less than a tenth of what is uncertain about it."""
    return e.state == "prior" and abs(e.value - e.nominal) < 0.1 * (e.std or 0.0)


def _left_out(
    problem: Problem, own: Sequence[Estimate] | Sequence[Prospect], unmoved: int = 0
) -> Text | None:
    parts = [f"{unmoved} of the arm that were not moved"] if unmoved else []
    if own:
        estimated = sum(item.state in ("identified", "prior") for item in own)
        frames = listed(sorted({problem.parameters[item.name].owner for item in own}), 2)
        parts.append(f"{estimated} of {len(own)} unknowns of the observations ({frames})")
    return Text(f"and {', '.join(parts)}: --verbose shows them") if parts else None


def _add_errors(table: Table, name: str, terms: Sequence[TermAccuracy]) -> None:
    if not terms:
        table.add_row(name, NOTHING, "no such data", end_section=True)
    found = by_kind(terms)
    for errors in found:
        before, after = errors.metrics
        better = percent(before.rms, after.rms)
        what = quantity(errors) if len({e.kind for e in found}) > 1 else errors.name
        what = f"{what}, {unit_name(errors.unit)}"
        table.add_row(name, what, "before", *_metric_cells(before, errors.unit), "")
        after_cells = [Text(cell, style="bold") for cell in _metric_cells(after, errors.unit)]
        table.add_row("", "", "after", *after_cells, Text(better, style="bold"), end_section=True)
        name = ""


def quantity(errors: KindErrors) -> str:
    """What was compared, in words: ``pairwise distance``, ``tracked point position``."""
    kind = errors.kind.replace("_", " ")
    return kind if errors.name in kind else f"{kind} {errors.name}"


def _metric_cells(metrics: Metrics, unit: Unit) -> list[str]:
    values = (metrics.rms, metrics.mean, metrics.std, metrics.maximum)
    return [*(text(v, unit) for v in values), str(metrics.count)]


def by_remedy(found: Sequence[Explanation]) -> dict[str, list[str]]:
    """Sentences that share a remedy, by the remedy."""
    together: dict[str, list[str]] = {}
    for e in found:
        together.setdefault(e.remedy, []).append(e.sentence)
    return together


def _explained(found: Sequence[Explanation]) -> list[RenderableType]:
    parts: list[RenderableType] = []
    for remedy, sentences in by_remedy(found).items():
        parts += [bullet(sentence) for sentence in sentences[:MOST_SENTENCES]]
        if len(sentences) > MOST_SENTENCES:
            parts.append(bullet(f"and {len(sentences) - MOST_SENTENCES} more of this sort"))
        parts.append(Padding(Text(f"→ {remedy}", style="italic"), (0, 0, 0, 5)))
    return parts
