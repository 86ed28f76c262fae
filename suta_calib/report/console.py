"""What every command's answer on a terminal is made of; readable without colour."""

from __future__ import annotations

from typing import Final

from rich import box
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from suta_calib.verdict import Level, Verdict

COLOUR: Final[dict[Level, str]] = {
    "good": "bold green",
    "caution": "bold yellow",
    "bad": "bold red",
}


def verdict_lines(verdict: Verdict) -> list[RenderableType]:
    """The verdict's word and sentence, and its notes as bullets."""
    line = Text(f"{verdict.word}.", style=COLOUR[verdict.level])
    if verdict.sentence:
        line = Text.assemble(line, " ", verdict.sentence[:1].upper() + verdict.sentence[1:])
    return [line, *(bullet(note) for note in verdict.notes)]


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


def number_table(title: str, first: str, *numbers: str) -> Table:
    """A column of names, then columns of numbers; without heads where none is given."""
    table = plain_table(title)
    table.show_header = any((first, *numbers))
    table.add_column(first, overflow="fold")
    for name in numbers:
        table.add_column(name, justify="right", no_wrap=True)
    return table
