"""The acceptance test, for a terminal and for report.html."""

from __future__ import annotations

from typing import Final

from rich.console import Group, RenderableType
from rich.text import Text as Line

from suta_calib.analysis.iso10360 import AcceptanceTest
from suta_calib.report.console import bullet, number_table, verdict_lines
from suta_calib.report.iso10360.json import STANDARD, SYMBOL, length_limit_text
from suta_calib.report.iso10360.plots import NAME, acceptance_plot
from suta_calib.report.sections import Plot, Section, Table, Text
from suta_calib.report.units import NOTHING, text

_TITLE: Final = f"Acceptance test after {STANDARD}"


def acceptance_tables(found: AcceptanceTest) -> RenderableType:
    """Everything for a terminal of 80 columns."""
    parts: list[RenderableType] = []
    for table in _tables(found):
        drawn = number_table(table.title, table.heads[0], *table.heads[1:])
        for row in table.rows:
            drawn.add_row(*(Line(cell) for cell in row))
        parts += [drawn, ""]
    said: list[RenderableType] = [
        Line(rule_text(found)),
        *(bullet(each) for each in found.simplified),
    ]
    return Group(*parts, *verdict_lines(found.verdict), "", *said)


def section(found: AcceptanceTest) -> Section:
    """The section of report.html."""
    parts: list[Text | Plot | Table] = [Plot(acceptance_plot(found)), *_tables(found)]
    parts += [Text(rule_text(found)), *(Text(each) for each in found.simplified)]
    return Section(NAME, _TITLE, found.verdict, parts)


def rule_text(found: AcceptanceTest) -> str:
    """How it was decided, in a sentence."""
    if not found.limits.given:
        return "No limits are given: add mpe to the job to have a decision."
    if found.rule.kind == "simple":
        return "Decision rule: simple; a value up to its limit passes, whatever the uncertainty."
    return (
        f"Decision rule: guarded (ISO 14253-1), guard band {found.rule.factor:g} standard "
        "uncertainties: pass below the limit less the guard band, fail above the limit and the "
        "guard band, undecided between them. U is the test's expanded uncertainty (k = 2): the "
        "artefact's, and what the job states."
    )


def _tables(found: AcceptanceTest) -> list[Table]:
    tables = [_summary(found)]
    if found.measured.lengths is not None:
        tables.append(_placements(found))
    if found.measured.articulations:
        tables.append(_articulations(found))
    if found.measured.spheres:
        tables.append(_spheres(found))
    if found.measured.repeats:
        tables.append(_repeats(found))
    return tables


def _summary(found: AcceptanceTest) -> Table:
    rows = []
    for each in found.characteristics:
        sign = each.symbol in ("E_Uni", "E_Bi", "P_Size")
        limit = NOTHING if each.limit is None else text(each.limit, "m")
        numbers = [text(each.value, "m", sign=sign), limit, text(each.expanded, "m")]
        name = SYMBOL[each.symbol]
        rows.append([name, *numbers, str(each.count), each.decision])
    given = found.limits.length
    stated = "" if given is None else f"; length {length_limit_text(given)}"
    heads = ["worst of each, mm", "value", "limit", "U", "of", ""]
    return Table(heads, rows, frozenset({1, 2, 3, 4}), f"{_TITLE}{stated}")


def _placements(found: AcceptanceTest) -> Table:
    lengths = found.measured.lengths
    assert lengths is not None
    rows = []
    for name, index in lengths.by_placement():
        error = lengths.error[index]
        rms = float((error**2).mean() ** 0.5)
        figures = [float(error.min()), float(error.max()), float(error.mean())]
        shown = [text(value, "m", sign=True) for value in figures]
        rows.append([name, str(len(error)), *shown, text(rms, "m")])
    varied = lengths.repeat_range
    repeated = "" if varied is None else f"; repeats differ by up to {text(varied, 'm')}"
    heads = ["placement", "lengths", "smallest", "largest", "mean", "RMS"]
    return _table(heads, rows, f"Errors of length, mm{repeated}")


def _articulations(found: AcceptanceTest) -> Table:
    rows = []
    for each in found.measured.articulations:
        numbers = (each.diameter, each.maximum, each.two_sigma)
        counts = [str(len(each.names)), str(each.touches)]
        rows.append([each.point, *counts, *(text(value, "m") for value in numbers)])
    heads = ["point", "from", "touches", "L_Dia", "max", "2 sigma"]
    return _table(heads, rows, "One point from several articulations, mm")


def _spheres(found: AcceptanceTest) -> Table:
    rows = []
    for each in found.measured.spheres:
        errors = [text(each.size, "m", sign=True), text(each.form, "m")]
        rows.append([each.sphere, str(len(each.radial)), *errors])
    return _table(["sphere", "touches", "P_Size", "P_Form"], rows, "Probing, mm")


def _repeats(found: AcceptanceTest) -> Table:
    rows = []
    for each in found.measured.repeats:
        numbers = (each.diameter, each.scatter.rp.value, each.scatter.rms.value)
        shown = [text(value, "m") for value in numbers]
        rows.append([each.point, str(each.scatter.count), *shown])
    heads = ["point", "visits", "diameter", "RP", "RMS"]
    return _table(heads, rows, "Repeatability of one point, mm")


def _table(heads: list[str], rows: list[list[str]], title: str) -> Table:
    return Table(heads, rows, frozenset(range(1, len(heads))), title)
