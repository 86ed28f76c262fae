"""The terminal's sink: documents as rich shows them, readable without colour."""

from __future__ import annotations

from typing import Final

from rich import box
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from suta_calib.assessment import Level
from suta_calib.report import document, listing
from suta_calib.report.listing import Tone

COLOUR: Final[dict[Level, str]] = {"good": "bold green", "care": "bold yellow", "bad": "bold red"}
TONE: Final[dict[Tone, str]] = {
    "good": "green",
    "note": "cyan",
    "care": "yellow",
    "bad": "red",
    "soft": "dim",
}
# Columns of the narrowest terminal in which no number may be cut.
NARROW: Final = 80


def rendered(answer: document.Document) -> RenderableType:
    """A document for a terminal of 80 columns: its parts, and how far to trust it last."""
    parts: list[RenderableType] = []
    for part in answer.shown("console"):
        if isinstance(part, document.Text):
            if part.bullet:
                parts.append(bullet(part.text))
            elif part.look == "remedy":
                parts.append(Padding(Text(f"→ {part.text}", style="italic"), (0, 0, 0, 5)))
            elif part.look == "verbatim":
                parts.append(Text(part.text, no_wrap=True, overflow="ignore"))
            else:
                parts.append(Text(part.text, style="bold" if part.look == "heading" else ""))
        elif isinstance(part, listing.Table):
            parts.append(table(part))
    # A table ends with an empty line of its own.
    apart = [] if not parts or (isinstance(parts[-1], Table) and parts[-1].box) else [""]
    how_far = answer.assessment
    verdict = Text(f"{how_far.word}.", style=COLOUR[how_far.level])
    if said := how_far.sentence:
        verdict = Text.assemble(verdict, " ", said[:1].upper() + said[1:])
    return Group(*parts, *apart, verdict, *map(bullet, how_far.notes))


def table(listed: listing.Table) -> Table:
    """Rows of a document; names wrap, numbers never do."""
    drawn = Table(
        title=listed.title,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        show_header=any(listed.heads),
        header_style="bold",
    )
    widths = [max(map(len, column)) for column in zip(listed.heads, *listed.cells, strict=True)]
    if sum(widths) + 2 * len(widths) > NARROW:
        drawn.padding = 0
    for k, head in enumerate(listed.heads):
        right = k in listed.numeric
        drawn.add_column(head, justify="right" if right else "left", no_wrap=right, overflow="fold")
    for k, row in enumerate(listed.cells):
        strong = k in listed.strong
        cells = [
            Text(cell, style="" if tone is None else TONE[tone])
            for cell, tone in zip(row, listed.tones[k], strict=True)
        ]
        drawn.add_row(*cells, style="bold" if strong else "", end_section=strong)
    return drawn


def bullet(note: str) -> Table:
    """A sentence behind a bullet, indented where it wraps."""
    grid = Table.grid(padding=(0, 1))
    grid.add_row(" •", Text(note))
    return grid
