"""Errors beside geometry that are worth having: for a terminal, and as a section of the report."""

from __future__ import annotations

from textwrap import fill
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from rich.console import Group, RenderableType
from rich.text import Text as Line

from suta_calib.analysis.model_selection import ModelSelection
from suta_calib.analysis.model_selection.candidate import ModelCandidate
from suta_calib.report.console import number_table, verdict_lines
from suta_calib.report.model_selection.json import (
    LOOKS_LIKE,
    NAME,
    Validated,
    estimate_text,
    extend_verdict,
    row_text,
    validation_rms,
)
from suta_calib.report.sections import Plot, Section, Table, Text
from suta_calib.report.svg import BLUE, ORANGE, WIDTH, shown_array, style, svg_text
from suta_calib.units import text

TITLE: Final = "Errors beside geometry"
HEADS: Final = ("unknowns beside the job's", "fitted", "held out", "change", "± error")
CAPTION: Final = (
    "RMS in mm, each error counted up to the Huber threshold. Change: of the held-out variance "
    "against the job's model, with its standard error over the folds."
)
TEST_HEADS: Final = ("joint", "looks like", "chance", "beside geometry")
MOST_TESTS: Final = 6
# Rows of a table on a terminal, and columns of one.
MOST_MODELS: Final = 12
WIDE: Final = 78
# Letters of a name beside a plot.
LONG: Final = 60


def extend_tables(choice: ModelSelection, validated: Validated | None = None) -> RenderableType:
    """The models, what the chosen one adds, and the verdict."""
    table = number_table("Models, cross-validated", HEADS[0], *HEADS[1:])
    best = _best(choice)
    for each in best:
        table.add_row(*_cells(choice, each))
    if more := len(choice.tried) - len(best):
        table.caption = Line(f"and {more} worse ones that were tried: report.html has them all")
    parts: list[RenderableType] = [table, Line(CAPTION, style="dim"), ""]
    parts += [Line(f"{n}  {estimate_text(choice, n)}") for n in choice.added]
    if validated is not None:
        parts.append(Line(_on_validation(validated)))
    parts += verdict_lines(extend_verdict(choice))
    return Group(*parts, *(Line(wrapped(row_text(row))) for row in choice.rows))


def short(name: str) -> str:
    """A name that fits beside a plot: models that grew from one another differ at the end."""
    return name if len(name) < LONG else f"{name[: LONG // 3]} … {name[-(LONG - LONG // 3) :]}"


def _best(choice: ModelSelection) -> list[ModelCandidate]:
    """The job's own model, the chosen one, and the best of the others, as they were tried."""
    by_loss = sorted(choice.tried, key=lambda c: (c is not choice.chosen, c.held_out.loss))
    kept = {id(c) for c in (choice.job, *by_loss[: MOST_MODELS - 1])}
    return [c for c in choice.tried if id(c) in kept]


def wrapped(row: str) -> str:
    """A line of YAML, to be copied: what does not fit goes on indented, which YAML allows."""
    return fill(row, WIDE, initial_indent="  ", subsequent_indent=" " * 6, break_long_words=False)


def extend_section(choice: ModelSelection, validated: Validated | None = None) -> Section:
    """The same with its picture, for ``report.html``."""
    rows = [_cells(choice, each) for each in choice.tried]
    parts: list[Text | Plot | Table] = [
        Plot(models_figure(choice)),
        Table(HEADS, rows, frozenset(range(1, len(HEADS))), "Models, cross-validated"),
        Text(f"{CAPTION} Left out each time: {'; '.join(choice.folds)}."),
    ]
    if validated is not None:
        parts.append(Text(_on_validation(validated)))
    if choice.added:
        told = [(n, estimate_text(choice, n)) for n in choice.added]
        parts.append(Table(("parameter", "value"), told, title="What it adds"))
    if choice.rows:
        lines = [(row_text(row),) for row in choice.rows]
        parts.append(Table(("a line each",), lines, title="Rows for the job's parameters"))
    parts.append(_tests(choice))
    return Section(NAME, TITLE, extend_verdict(choice), parts)


def models_figure(choice: ModelSelection) -> str:
    """Fitted and held-out RMS of the best models that were tried, mm."""
    models = sorted(_best(choice), key=lambda c: c.held_out.rms)
    names = [f"→ {short(m.name)}" if m is choice.chosen else short(m.name) for m in models]
    places = np.arange(len(models))
    with style(NAME):
        figure = Figure(figsize=(WIDTH, 1.3 + 0.3 * len(models)), layout="constrained")
        axes = figure.subplots()
        for values, colour, mark, label in (
            ([m.fitted for m in models], ORANGE, "s", "fitted data"),
            ([m.held_out.rms for m in models], BLUE, "o", "data left out"),
        ):
            axes.plot(shown_array(np.array(values), "m"), places, mark, color=colour, label=label)
        axes.set_yticks(places, names, fontsize=8)
        axes.invert_yaxis()
        axes.grid()
        axes.set_xlim(left=0)
        axes.set_xlabel("RMS, mm (arrow: chosen)")
        axes.legend(ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1))
        return svg_text(figure, NAME, "Fitted and held-out errors of the models that were tried")


def _cells(choice: ModelSelection, each: ModelCandidate) -> list[str]:
    name = f"{each.name} ←" if each is choice.chosen else each.name
    lengths = [text(each.fitted, "m"), text(each.held_out.rms, "m")]
    if each is choice.job:
        return [name, *lengths, "", ""]
    gain, error = (100 * v / choice.job.held_out.loss for v in each.gain_over(choice.job))
    return [name, *lengths, f"{-gain:+.1f} %", f"{error:.1f} %"]


def _on_validation(validated: Validated) -> str:
    job, chosen = validation_rms(validated).values()
    return f"On the validation data: RMS {job:.3f} mm with the job's model, {chosen:.3f} mm chosen."


def _tests(choice: ModelSelection) -> Table:
    rows = [
        (t.joint, LOOKS_LIKE[t.family], f"{t.p:.2g}", f"{t.p_beside_geometry:.2g}")
        for t in choice.tests[:MOST_TESTS]
    ]
    title = "What the residuals of the job's model look like: chance of it if there is nothing"
    return Table(TEST_HEADS, rows, frozenset({2, 3}), title)
