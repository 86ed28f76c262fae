"""The search for outliers for a terminal of 80 columns, and as a section of a report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from rich.console import Group as Lines
from rich.console import RenderableType
from rich.table import Table as ConsoleTable
from rich.text import Text as Line

from suta_calib.analysis.outliers import (
    METRICS,
    Group,
    HeldOut,
    Level,
    Metric,
    Outliers,
    TermOutliers,
)
from suta_calib.analysis.outliers.judgement import GROUPING_NOUN
from suta_calib.report.console import bullet, number_table, verdict_lines
from suta_calib.report.outliers.json import KEYS, exclusion, threshold_text
from suta_calib.report.outliers.plots import outlier_plots
from suta_calib.report.sections import Plot, Section, Table, Text
from suta_calib.units import NOTHING

HEADS: Final = ("error share, %", "Cook", "leave one out, %", "bias, mm")
SHORT: Final = ("share %", "Cook", "l.o.o. %", "bias mm")
DECIMALS: Final[dict[Metric, int]] = {
    "contribution": 1,
    "cooks_distance": 3,
    "leave_one_out": 1,
    "bias": 3,
}
# Larger figures have no place in a column.
WIDEST: Final = 1e5
# Of long levels only the groups with the largest shares are shown.
MOST_GROUPS_SHOWN: Final = 20
EXPLAINED: Final = (
    "Figures are of a fit in which the whole geometry of the arm is free, so that what the arm "
    "itself gets wrong is blamed on nothing that was touched; those of the job's own fit stand "
    "in a table of their own. A figure is flagged (!) if it exceeds its threshold and if noise "
    "alone would do so with a probability of at most {significance:g} anywhere on its level. Three "
    "flags of four make an outlier: every metric has a blind spot, and none convicts alone."
)


def outlier_tables(found: Outliers) -> RenderableType:
    """Tables by level, the verdict, and how to exclude what was named."""
    parts: list[RenderableType] = []
    for term in found.terms:
        for level in term.levels:
            parts += [_console_table(term, level), ""]
    return Lines(*parts, *verdict_lines(found.assessment), *map(bullet, advice(found)))


def outlier_section(found: Outliers) -> Section:
    """Heat maps and tables for ``report.html``."""
    parts: list[Text | Plot | Table] = [
        Text(EXPLAINED.format(significance=found.thresholds.significance))
    ]
    parts += [Plot(svg, title) for title, svg in outlier_plots(found)]
    parts += [_table(term, level) for term in found.terms for level in term.levels]
    parts += [_as_calibrated(term, term.levels[0]) for term in found.terms if term.levels]
    parts += [_touches(term) for term in found.terms if term.touches]
    parts += [Text(sentence) for sentence in advice(found)]
    return Section("outliers", "Outliers", found.assessment, parts)


def advice(found: Outliers) -> list[str]:
    """What excluding would do, and how to do it."""
    if not any(exclusion(found)):
        return ["Nothing was excluded."]
    said = ["Nothing was excluded. Look for the cause first: certificate, seat, burr, label."]
    for term, levels in zip(found.terms, exclusion(found), strict=True):
        if not levels:
            continue
        names = ", ".join(f"{level}: [{', '.join(labels)}]" for level, labels in levels.items())
        said.append(
            f"To leave it out, write into the {term.kind} row of the job: exclude: {{{names}}}"
        )
        said += [
            _effect(
                GROUPING_NOUN[level.name], g.label, term.held_out[level.name][g.label], term.method
            )
            for level in term.levels
            for g in level.outliers
            if g.label in term.held_out.get(level.name, {})
        ]
    return said


def _effect(what: str, label: str, effect: HeldOut, method: str) -> str:
    others = " of the others" if effect.count and what == "landmark" else ""
    return (
        f"Without {what} {label} the held-out RMS{others} goes from {1e3 * effect.before:.3f} to "
        f"{1e3 * effect.after:.3f} mm ({100 * effect.change:+.1f} %, {method})."
    )


def _console_table(term: TermOutliers, level: Level) -> ConsoleTable:
    heads = (*SHORT, "held-out %", "")
    title = f"{term.kind}, by {GROUPING_NOUN[level.name]}"
    table = number_table(title, GROUPING_NOUN[level.name], *heads)
    groups = _shown(level)
    for group in groups:
        cells = [_value(group, metric) for metric in METRICS]
        style = "bold" if group.outlier else ""
        table.add_row(
            Line(group.label), *cells, _change(term, level, group), _word(group), style=style
        )
    limits = ", ".join(
        f"{short.split()[0]} {threshold_text(level, m)}"
        for short, m in zip(SHORT, METRICS, strict=True)
    )
    rest = len(level.groups) - len(groups)
    more = f"; {rest} more with smaller shares" if rest else ""
    table.caption = f"! beyond threshold ({limits}) and chance{more}"
    return table


def _table(term: TermOutliers, level: Level) -> Table:
    heads = (GROUPING_NOUN[level.name], *HEADS, "held-out RMS, %", "verdict")
    rows = [
        (
            group.label,
            *(_value(group, metric) for metric in METRICS),
            _change(term, level, group),
            _word(group),
        )
        for group in _shown(level)
    ]
    limits = [threshold_text(level, metric) for metric in METRICS]
    rows.append(("threshold", *limits, "", ""))
    return Table(
        heads, rows, frozenset(range(1, 6)), f"{term.kind}, by {GROUPING_NOUN[level.name]}"
    )


def _as_calibrated(term: TermOutliers, level: Level) -> Table:
    rows = [
        (g.label, *(_number(g.as_calibrated[metric], metric) for metric in METRICS))
        for g in _shown(level)
    ]
    grouping = GROUPING_NOUN[level.name]
    title = f"{term.kind}, by {grouping}, in the job's own fit: every touch counts, no flags"
    return Table((GROUPING_NOUN[level.name], *HEADS), rows, frozenset(range(1, 5)), title)


def _touches(term: TermOutliers) -> Table:
    rows = [(t.origin, t.what, f"{1e3 * t.size:.2f}") for t in term.touches]
    title = "Single touches set aside for these figures"
    return Table(("row", "what", "residual, mm"), rows, frozenset({2}), title)


def _shown(level: Level) -> Sequence[Group]:
    if len(level.groups) <= MOST_GROUPS_SHOWN:
        return level.groups
    ranked = sorted(level.groups, key=lambda g: (not g.flags, -g.values["contribution"]))
    kept = {g.label for g in ranked[:MOST_GROUPS_SHOWN]}
    return [g for g in level.groups if g.label in kept]


def _value(group: Group, metric: Metric) -> str:
    mark = " !" if metric in group.flags else ""
    return _number(group.values[metric], metric) + mark


def _number(value: float, metric: Metric) -> str:
    if not math.isfinite(value):
        return NOTHING
    shown = KEYS[metric][1] * value
    number = f"{shown:.{DECIMALS[metric]}f}" if abs(shown) < WIDEST else f"{shown:.1e}"
    return number.removeprefix("-") if float(number) == 0 else number


def _word(group: Group) -> str:
    return "outlier" if group.outlier else "suspect" if group.suspect else ""


def _change(term: TermOutliers, level: Level, group: Group) -> str:
    effect = term.held_out.get(level.name, {}).get(group.label)
    return NOTHING if effect is None else f"{100 * effect.change:+.1f}"
