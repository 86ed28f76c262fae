"""The look that all benchmarks' tables share."""

from __future__ import annotations

from rich import box
from rich.table import Table


def number_table(title: str, first: str, *numbers: str) -> Table:
    """A column of names, then columns of numbers; without heads where none is given."""
    table = Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        show_header=any((first, *numbers)),
    )
    table.add_column(first, overflow="fold")
    for name in numbers:
        table.add_column(name, justify="right", no_wrap=True)
    return table
