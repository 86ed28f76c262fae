"""The terminal's sink: documents as rich shows them, readable without colour."""

from __future__ import annotations

from typing import Final

from rich import box
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from suta_calib.assessment import Assessment, Level
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
            parts.append(_paragraph(part))
        elif isinstance(part, listing.Table):
            parts.append(table(part))
    # A table ends with an empty line of its own.
    apart = [] if not parts or (isinstance(parts[-1], Table) and parts[-1].box) else [""]
    return Group(*parts, *apart, *verdict_lines(answer.assessment))


def _paragraph(part: document.Text) -> RenderableType:
    if part.bullet:
        return bullet(part.text)
    if part.look == "remedy":
        return Padding(Text(f"→ {part.text}", style="italic"), (0, 0, 0, 5))
    if part.look == "verbatim":
        return Text(part.text, no_wrap=True, overflow="ignore")
    return Text(part.text, style="bold" if part.look == "heading" else "")


def table(listed: listing.Table) -> Table:
    """Rows of a document; names wrap, numbers never do."""
    drawn = plain_table(listed.title)
    drawn.show_header = any(listed.heads)
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


def verdict_lines(assessment: Assessment) -> list[RenderableType]:
    """The verdict's word and sentence, and its notes as bullets."""
    line = Text(f"{assessment.word}.", style=COLOUR[assessment.level])
    if assessment.sentence:
        line = Text.assemble(line, " ", assessment.sentence[:1].upper() + assessment.sentence[1:])
    return [line, *(bullet(note) for note in assessment.notes)]


def bullet(note: str) -> Table:
    """A sentence behind a bullet, indented where it wraps."""
    grid = Table.grid(padding=(0, 1))
    grid.add_row(" •", Text(note))
    return grid


def plain_table(title: str) -> Table:
    """An empty table in the look all commands share."""
    return Table(
        title=title,
        title_justify="left",
        title_style="bold",
        caption_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        header_style="bold",
    )
