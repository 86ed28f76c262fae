"""Where the errors come from: verdict, JSON, table, picture and section of the report."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Group, RenderableType
from rich.text import Text as Line

from suta_calib.analysis.error_budget import BlockBudget, ErrorBudget, Share, Source
from suta_calib.assessment import Assessment
from suta_calib.report.console import number_table, verdict_lines
from suta_calib.report.sections import Plot, Section, Table, Text
from suta_calib.report.svg import BLUE, GREY, ORANGE, WIDTH, style, svg_text
from suta_calib.units import NOTHING, shown, text, unit_name

NAME: Final = "budget"
TITLE: Final = "Error budget"
ORDER: Final[tuple[Source, ...]] = (
    *("encoders", "seating", "instrument", "artefact", "parameters", "model", "gross"),
)
WORDS: Final[dict[Source, str]] = {
    "gross": "gross errors",
    "encoders": "encoders",
    "seating": "seating",
    "instrument": "instrument",
    "artefact": "artefact",
    "parameters": "calibration's own uncertainty",
    "model": "model (what is left)",
}
# Fill and hatch by the first source of a share: told apart in grey too.
LOOKS: Final[dict[Source, tuple[str, str]]] = {
    "encoders": (BLUE, ""),
    "seating": ("#56B4E9", "///"),
    "instrument": ("#56B4E9", "..."),
    "artefact": ("#009E73", "xx"),
    "parameters": ("#F0E442", "\\\\\\"),
    "model": (ORANGE, ""),
    "gross": (GREY, "++"),
}
TOGETHER: Final = ("white", "oo")
# Of a mean square: more than that are errors to look for, not to split.
MOSTLY_GROSS: Final = 0.5
HEADS: Final = ("where it comes from", "RMS", "unit", "share")
CAPTION: Final = (
    "Mean squares add up, so shares are of the mean square; RMS is its root. Of gross errors: what "
    "rows beyond the Huber threshold whose repeats do not agree with them, and touches with many "
    "of those, have more than the others."
)


def budget_verdict(budget: ErrorBudget) -> Assessment:
    """What dominates, and what the data do not tell."""
    first = _most_telling(budget)
    inside = [s for s in first.shares if s.sources != ("gross",)]
    largest = max(inside, key=lambda s: s.variance)
    total = sum(s.variance for s in inside)
    notes = (*budget.missing, *_on_gross(budget))
    rms = text(first.rms, first.unit, with_unit=True)
    if not total > 0:
        return Assessment.of(
            f"The {first.data} errors ({rms} RMS) leave nothing to split", care=notes
        )
    sentence = (
        f"Of the {first.data} errors ({rms} RMS), gross ones aside, "
        f"{100 * largest.variance / total:.0f} % is {share_words(largest)}"
    )
    return Assessment.of(sentence, care=notes)


def _on_gross(budget: ErrorBudget) -> list[str]:
    """Data of which a few touches make most of the mean square."""
    worst = max((_gross(b) / b.variance for b in budget.blocks if b.variance > 0), default=0.0)
    if worst < MOSTLY_GROSS:
        return []
    return [
        f"Gross errors make {100 * worst:.0f} % of a mean square: suta-calib outliers says which "
        "touches they are."
    ]


def _gross(block: BlockBudget) -> float:
    return block.variance_of("gross") or 0.0


def budget_dict(budget: ErrorBudget) -> dict[str, Any]:
    """The budget as data, mm² and deg² as roots; a share that has no number is null."""
    assessment = budget_verdict(budget)
    return {
        "verdict": {
            "level": assessment.level,
            "sentence": assessment.sentence,
            "notes": assessment.notes,
        },
        "blocks": [_block_dict(b) for b in budget.blocks],
        "tip": {f"{key}_rms_mm": _root_mm(value) for key, value in _tip_rows(budget).items()}
        | {"total_rms_mm": shown(budget.tip.rms, "m")},
        "missing": list(budget.missing),
    }


def budget_tables(budget: ErrorBudget) -> RenderableType:
    """A table for each block, one for the tip, and the verdict."""
    parts: list[RenderableType] = []
    for block in budget.blocks:
        table = number_table(_name(block), HEADS[0], *HEADS[1:])
        for row in _rows(block):
            table.add_row(*row)
        parts.append(table)
    tip = number_table("The tip at the postures visited", HEADS[0], "RMS", "unit")
    for row in _tip_cells(budget):
        tip.add_row(*row)
    return Group(
        *parts, tip, Line(CAPTION, style="dim"), "", *verdict_lines(budget_verdict(budget))
    )


def budget_section(budget: ErrorBudget) -> Section:
    """The same with its picture, for ``report.html``."""
    parts: list[Text | Plot | Table] = [Plot(budget_figure(budget)), Text(CAPTION)]
    numeric = frozenset({1, 3})
    parts += [Table(HEADS, _rows(block), numeric, _name(block)) for block in budget.blocks]
    parts.append(
        Table(
            (HEADS[0], "RMS", "unit"),
            _tip_cells(budget),
            frozenset({1}),
            "The tip at the postures visited, relative to what the calibration held",
        )
    )
    return Section(NAME, TITLE, budget_verdict(budget), parts)


def share_words(share: Share) -> str:
    """``seating``, or ``encoders and seating together``."""
    words = [WORDS[s] for s in ORDER if s in share.sources]
    if len(words) == 1:
        return words[0]
    return f"{', '.join(words[:-1])} and {words[-1]} together"


def budget_figure(budget: ErrorBudget) -> str:
    """Shares of every block's mean square as one horizontal bar each; gross errors left out."""
    blocks = [b for b in budget.blocks if b.variance > 0]
    with style(NAME):
        figure = Figure(figsize=(WIDTH, 1.9 + 0.55 * len(blocks)), layout="constrained")
        axes = figure.subplots()
        shown_once: set[str] = set()
        for place, block in enumerate(blocks):
            _bar(axes, place, block, shown_once)
        axes.set_yticks(range(len(blocks)), [_name(b) for b in blocks], fontsize=8)
        axes.set_ylim(len(blocks) - 0.5, -0.5)
        axes.set_xlim(0, 100)
        axes.set_xlabel("share of the mean square, gross errors aside, %")
        figure.legend(loc="outside upper left", ncols=2, fontsize=8)
        return svg_text(figure, NAME, "Shares of the error budget")


def _bar(axes: Axes, place: int, block: BlockBudget, shown_once: set[str]) -> None:
    inside = [s for s in block.shares if s.sources != ("gross",)]
    total = sum(s.variance for s in inside)
    left = 0.0
    for share in inside:
        part = 100 * share.variance / total if total > 0 else 0.0
        words = share_words(share)
        colour, hatch = LOOKS[share.sources[0]] if len(share.sources) == 1 else TOGETHER
        label = words if words not in shown_once else None
        shown_once.add(words)
        look: dict[str, Any] = {"color": colour, "edgecolor": "black", "hatch": hatch}
        axes.barh(place, part, left=left, height=0.62, linewidth=0.6, label=label, **look)
        if part > 9:
            rms = text(float(np.sqrt(share.variance)), block.unit, with_unit=True)
            box = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
            axes.text(left + part / 2, place, rms, ha="center", va="center", fontsize=8, bbox=box)
        left += part


def _most_telling(budget: ErrorBudget) -> BlockBudget:
    """Held-out data first, lengths first."""
    return min(budget.blocks, key=lambda b: (b.data != "validation", b.unit != "m"))


def _name(block: BlockBudget) -> str:
    kind = block.kind.replace("_", " ")
    what = kind if block.block in kind else f"{kind} {block.block}"
    return f"{block.data}: {what}, {block.count}"


def _rows(block: BlockBudget) -> list[tuple[str, ...]]:
    unit = unit_name(block.unit)
    rows = [
        (share_words(s), text(float(np.sqrt(s.variance)), block.unit), unit, _percent(s, block))
        for s in block.shares
    ]
    return [*rows, ("total", text(block.rms, block.unit), unit, "100 %")]


def _percent(share: Share, block: BlockBudget) -> str:
    return f"{100 * share.variance / block.variance:.1f} %" if block.variance > 0 else NOTHING


def _block_dict(block: BlockBudget) -> dict[str, Any]:
    suffix = unit_name(block.unit)
    shares = [
        {
            "sources": list(s.sources),
            f"rms_{suffix}": shown(float(np.sqrt(s.variance)), block.unit),
            "share_pct": 100 * s.variance / block.variance if block.variance > 0 else None,
        }
        for s in block.shares
    ]
    return {
        "data": block.data,
        "kind": block.kind,
        "block": block.block,
        f"rms_{suffix}": shown(block.rms, block.unit),
        "count": block.count,
        "shares": shares,
    }


def _tip_rows(budget: ErrorBudget) -> dict[str, float | None]:
    tip = budget.tip
    return {"encoders": tip.encoders, "parameters": tip.parameters, "model": tip.model}


def _tip_cells(budget: ErrorBudget) -> list[tuple[str, ...]]:
    words = {
        "encoders": "encoders, one reading",
        "parameters": WORDS["parameters"],
        "model": WORDS["model"],
    }
    rows = [
        (words[key], text(None if value is None else float(np.sqrt(value)), "m"), "mm")
        for key, value in _tip_rows(budget).items()
    ]
    return [*rows, ("total of what has a number", text(budget.tip.rms, "m"), "mm")]


def _root_mm(variance: float | None) -> float | None:
    return None if variance is None else shown(float(np.sqrt(variance)), "m")
