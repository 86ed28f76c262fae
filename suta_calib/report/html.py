"""The whole result as one HTML file that needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from suta_calib.atomic import write_bytes_atomically
from suta_calib.diagnostics.accuracy import TermAccuracy
from suta_calib.report import plots
from suta_calib.report.errors_by import GROUPINGS, by_kind, groups
from suta_calib.report.histogram import error_histogram
from suta_calib.report.result import Result, arm_estimates, labelled_terms
from suta_calib.report.result_json import arm_correlations, versions
from suta_calib.report.sections import environment
from suta_calib.report.tables import by_remedy, explanations, quantity
from suta_calib.report.verdict import judge
from suta_calib.report.words import combination
from suta_calib.solver.solution import Estimate, Solution
from suta_calib.units import NOTHING, percent, text, unit_name

Rows = list[dict[str, Any]]


def write_report(result: Result, path: str | Path) -> None:
    """Write `render_report` to a file.

    Raises:
        OutputError: the file could not be written; nothing half-written is left.
    """
    write_bytes_atomically(path, render_report(result).encode())


def render_report(result: Result) -> str:
    """A self-contained page: verdict, errors, parameters, what the data cannot tell, and plots.

    Args:
        result: job, solution and accuracy.

    Returns:
        HTML with inline CSS and SVG, no scripts and no references to anything outside; every
        text that came from the user is escaped.
    """
    return environment().get_template("report.html.j2").render(_context(result))


def _context(result: Result) -> dict[str, Any]:
    solution = result.solution
    arm = list(arm_estimates(solution).values())
    own = list(solution.estimates.values())[len(arm) :]
    return {
        "title": result.job.spec.path.parent.resolve().name or result.job.spec.path.name,
        "verdict": judge(result),
        "converged": solution.converged,
        "errors": _error_rows(result),
        "parameters": [_parameter_row(e) for e in arm],
        "own": [_parameter_row(e) for e in own],
        "explanations": by_remedy(explanations(solution)),
        "combinations": _combinations(solution),
        "histograms": _histograms(result),
        "grouped": _grouped(result),
        "noise": _noise_rows(result),
        "attempts": solution.attempts,
        "minimum": solution.minimum,
        "timing": solution.timing,
        "job_name": result.job.spec.path.name,
        "job_text": _job_text(result.job.spec.path),
        "versions": versions(),
        **_solution_plots(solution),
    }


def _error_rows(result: Result) -> Rows:
    rows = []
    for name, labelled in labelled_terms(result).items():
        for errors in by_kind([term for _, term in labelled]):
            before, after = errors.metrics
            for state, m in (("before", before), ("after", after)):
                values = (m.rms, m.mean, m.std, m.maximum)
                rows.append(
                    {
                        "set": name,
                        "what": quantity(errors),
                        "state": state,
                        "values": [text(v, errors.unit) for v in values],
                        "unit": unit_name(errors.unit),
                        "count": m.count,
                        "improvement": percent(before.rms, after.rms) if state == "after" else "",
                    }
                )
    return rows


def _parameter_row(e: Estimate) -> dict[str, Any]:
    unmoved = e.state in ("unidentified", "fixed")
    return {
        "name": e.name,
        "unit": unit_name(e.unit),
        "nominal": text(e.nominal, e.unit),
        "value": text(e.value, e.unit),
        "std": text(e.std, e.unit),
        "change": NOTHING if unmoved else text(e.value - e.nominal, e.unit, sign=True),
        "state": e.state,
        "given": ", ".join(e.given),
    }


def _combinations(solution: Solution) -> list[str]:
    found = solution.identification.combinations
    return [combination(c.direction, c.fixed) for c in found if not c.alone]


def _histograms(result: Result) -> Rows:
    found = []
    for name, labelled in labelled_terms(result).items():
        for k, errors in enumerate(by_kind([term for _, term in labelled])):
            if len(errors.before):
                svg = Markup(error_histogram(errors, f"histogram-{name}-{k}"))
                found.append({"title": f"{name.capitalize()}: {quantity(errors)}", "svg": svg})
    # Held-out errors are what a user of the arm will see: they come first.
    return sorted(found, key=lambda plot: not plot["title"].startswith("Validation"))


def _grouped(result: Result) -> Rows:
    found: Rows = []
    accuracy = result.accuracy
    for name, terms in (("Validation", accuracy.validation), ("Calibration", accuracy.calibration)):
        by_label = [plot for label in GROUPINGS for plot in _grouped_plot(name, terms, label)]
        # Files are usually split by label: only without labels do they tell more.
        found += by_label or _grouped_plot(name, terms, "file")
    return found


def _grouped_plot(name: str, terms: Sequence[TermAccuracy], grouping: str) -> Rows:
    of = groups(terms, grouping)
    if len(of) < 2:
        return []
    rest = len(of) - plots.MOST_GROUPS
    title = f"{name}: by {grouping}" + (f" (without the {rest} best)" if rest > 0 else "")
    svg = plots.grouped_errors(of, grouping, f"errors-{name.lower()}-{grouping}")
    return [{"title": title, "svg": Markup(svg)}]


def _noise_rows(result: Result) -> Rows:
    solution = result.solution
    labelled = labelled_terms(result)["calibration"]
    blocks = [(label, term.term.kind, b) for label, term in labelled for b in term.term.blocks]
    return [
        {
            "what": f"{kind.replace('_', ' ')}: {block.name}",
            "label": label,
            "assumed": text(assumed, block.unit, with_unit=True),
            "source": "the job" if block.noise.sigma is not None else "default",
            "found": text(found, block.unit, with_unit=True),
        }
        for (label, kind, block), assumed, found in zip(
            blocks, solution.sigmas, solution.noise, strict=True
        )
    ]


def _solution_plots(solution: Solution) -> dict[str, Any]:
    identification = solution.identification
    values = identification.singular_values
    weak = [combination(c.direction, c.fixed) for c in identification.combinations]
    found: dict[str, Any] = {"changes": "", "singular": "", "correlations": ""}
    if len(values):
        found["singular"] = Markup(plots.singular_values(values, weak, "singular-values"))
    if not solution.converged:
        return found
    estimated = [e for e in arm_estimates(solution).values() if e.std]
    if estimated:
        found["changes"] = Markup(plots.parameter_changes(estimated, "parameter-changes"))
    names, matrix = arm_correlations(solution)
    if len(names) > 1:
        found["correlations"] = Markup(plots.correlation_map(names, matrix, "correlations"))
        found["correlations_left_out"] = max(len(names) - plots.MOST_CORRELATED, 0)
    return found


def _job_text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return "(the job file is not there any more)"
