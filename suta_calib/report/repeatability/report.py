"""Repeatability and stationary streams, for a terminal and for report.html."""

from __future__ import annotations

from typing import Any, Final

from rich.console import Group, RenderableType
from rich.text import Text as Line

from suta_calib.analysis.repeatability import Repeatability, Stationary
from suta_calib.assessment import Assessment
from suta_calib.report.console import number_table, verdict_lines
from suta_calib.report.repeatability.json import repeatability_dict, stationary_dict
from suta_calib.report.repeatability.plots import stationary_plot, visits_plot
from suta_calib.report.repeatability.rows import repeatability_tables, stationary_tables
from suta_calib.report.sections import Plot, Section, Table, Text

NAME: Final = "repeatability"
_HOW: Final = (
    "RP is the mean distance of the visits to their barycentre plus three standard deviations "
    "(ISO 9283:1998, 7.2.2). Intervals are those of a jackknife on the logarithm."
)
_PUSH: Final = (
    "A joint gives if, for other directions of the push, its reading moves out of step with the "
    "others' (its play) by more than permuted labels would make any joint's. Means: how far apart "
    "the readings' means are whatever the others do, most of which may be the seat's clearance. "
    "Tip: what the play moves the tip. A joint that gives with a question mark has another that "
    "would explain it nearly as well."
)
_REST: Final = (
    "Allan deviation: how much two successive averages over a time differ. Averaging longer than "
    "to its minimum gains nothing (+: still falling where the record ends). Drift: with half its "
    "95 % interval, correlated noise accounted for."
)


def answer_of(visits: Repeatability | None, rest: Stationary | None) -> dict[str, Any]:
    """Both as JSON data; a stream without visits has the key ``stationary`` alone."""
    answer = {} if visits is None else repeatability_dict(visits)
    if rest is not None:
        answer["stationary"] = stationary_dict(rest)
    return answer


def whole_verdict(visits: Repeatability | None, rest: Stationary | None) -> Assessment:
    """The worse of both, with the notes of both."""
    given = [each.assessment for each in (visits, rest) if each is not None]
    bad = [note for each in given if each.level == "bad" for note in each.notes]
    notes = [note for each in given if each.level != "bad" for note in each.notes]
    return Assessment.of("; ".join(each.sentence for each in given), bad=bad, care=notes)


def shown_tables(visits: Repeatability | None, rest: Stationary | None) -> RenderableType:
    """Everything for a terminal of 80 columns."""
    parts: list[RenderableType] = []
    for table in _tables(visits, rest):
        parts += [_terminal(table), ""]
    return Group(*parts, *verdict_lines(whole_verdict(visits, rest)))


def _tables(visits: Repeatability | None, rest: Stationary | None) -> list[Table]:
    found = [] if visits is None else repeatability_tables(visits)
    return found + ([] if rest is None else stationary_tables(rest))


def _terminal(table: Table) -> RenderableType:
    drawn = number_table(table.title, table.heads[0], *table.heads[1:])
    for row in table.rows:
        drawn.add_row(*(Line(cell) for cell in row))
    return drawn


def section(visits: Repeatability | None, rest: Stationary | None) -> Section:
    """The section of report.html."""
    parts: list[Text | Plot | Table] = []
    if visits is not None:
        parts += [Text(_HOW), Plot(visits_plot(visits)), *repeatability_tables(visits)]
        if visits.directions is not None:
            parts.append(Text(_PUSH))
    if rest is not None:
        parts += [Plot(stationary_plot(rest)), *stationary_tables(rest), Text(_REST)]
    return Section(NAME, "Repeatability", whole_verdict(visits, rest), parts)
