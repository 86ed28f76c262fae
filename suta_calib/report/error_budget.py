"""Report of an error budget: a table for each block of residuals, and one for the tip."""

from __future__ import annotations

import math
from functools import partial
from typing import Any, Final

from suta_calib.analysis.error_budget import (
    WORDS,
    BlockBudget,
    ErrorBudget,
    Share,
    Source,
    TipBudget,
)
from suta_calib.plotting.look import BLUE, GREY, ORANGE, WIDTH
from suta_calib.report.document import Document, Figure, Part, Text
from suta_calib.report.errors import in_words
from suta_calib.report.listing import Column, Listing, written
from suta_calib.report.svg import picture, svg_text
from suta_calib.units import shown, text, unit_name

NAME: Final = "budget"
TITLE: Final = "Error budget"
# Fill and hatch by the first source of a share: readable in grey too.
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
CAPTION: Final = (
    "Mean squares add up, so shares are of the mean square; RMS is its square root. Gross errors: "
    "the additional error of rows beyond the Huber threshold that do not agree with their repeats, "
    "and of touches with many such rows."
)


def _rms(source: str, heading: str) -> Column[TipBudget]:
    """Root of a mean square that may have no number."""

    def root(tip: TipBudget) -> float | None:
        variance = getattr(tip, source)
        return None if variance is None else math.sqrt(variance)

    return Column(f"{source}_rms", heading, root, "m")


TIP: Final = Listing[TipBudget](
    "Error of the tip in the measured postures, if the fixed parameters are exact",
    _rms("encoders", "encoders, one reading"),
    _rms("parameters", WORDS["parameters"]),
    _rms("model", WORDS["model"]),
    Column("total_rms", "total of the known parts", lambda tip: tip.rms, "m"),
    key="tip",
)
BLOCK: Final = Listing[BlockBudget](
    "",
    *written("data", "kind", "block"),
    Column("rms", unit=lambda block: block.unit),
    Column("count"),
)


def budget_document(budget: ErrorBudget) -> Document:
    """Every block's mean square and the tip's by source, and what would tell more."""
    parts: list[Part] = [Figure(partial(budget_plot, budget))]
    for block in budget.blocks:
        total = Share((), block.variance)
        parts.append(_shares(block).of((*block.shares, total)))
    parts += [TIP.facts(budget.tip, ("source", "RMS", "unit")), Text(CAPTION)]
    blocks = [
        {
            **BLOCK.record(block),
            **({"chain": block.chain} if block.chain else {}),
            "shares": _shares(block).records(block.shares),
        }
        for block in budget.blocks
    ]
    data = {"blocks": blocks, "missing": list(budget.missing)}
    return Document(NAME, TITLE, budget.assessment, parts, data)


def budget_plot(budget: ErrorBudget) -> str:
    """An SVG: shares of every block's mean square as a horizontal bar; gross errors left out."""
    blocks = [b for b in budget.blocks if b.variance > 0]
    with picture(NAME, (WIDTH, 1.9 + 0.55 * len(blocks))) as figure:
        axes = figure.subplots()
        labelled: set[str] = set()
        for place, block in enumerate(blocks):
            left, total = 0.0, sum(s.variance for s in block.inside)
            for share in block.inside:
                part = shown(share.variance / total, "%") if total > 0 else 0.0
                colour, hatch = LOOKS[share.sources[0]] if len(share.sources) == 1 else TOGETHER
                label = share.words if share.words not in labelled else None
                labelled.add(share.words)
                look: dict[str, Any] = {"color": colour, "edgecolor": "black", "hatch": hatch}
                axes.barh(place, part, left=left, height=0.62, linewidth=0.6, label=label, **look)
                if part > 9:
                    rms = text(share.rms, block.unit, with_unit=True)
                    place_of: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 8}
                    box = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
                    axes.text(left + part / 2, place, rms, bbox=box, **place_of)
                left += part
        axes.set_yticks(range(len(blocks)), [_name(b) for b in blocks], fontsize=8)
        axes.set_ylim(len(blocks) - 0.5, -0.5)
        axes.set_xlim(0, 100)
        axes.set_xlabel("share of the mean square without gross errors, %")
        figure.legend(loc="outside upper left", ncols=2, fontsize=8)
        return svg_text(figure, NAME, "Shares of the error budget")


def _name(block: BlockBudget) -> str:
    return f"{block.data}: {in_words(block.kind, block.block, block.chain)}, {block.count}"


def _shares(block: BlockBudget) -> Listing[Share]:
    """Rows of one block; a share of no source is the whole."""

    def part(share: Share) -> float | None:
        return share.variance / block.variance if block.variance > 0 else None

    def name(share: Share) -> str:
        return share.words if share.sources else "total"

    return Listing(
        _name(block),
        Column("sources", "source", cell=name),
        Column("rms", "RMS", unit=block.unit),
        Column("", "unit", lambda _: unit_name(block.unit)),
        Column("share", "share, %", part, "%"),
    )
