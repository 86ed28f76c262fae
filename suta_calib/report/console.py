"""The terminal's sink: documents as rich shows them, readable without colour."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from textwrap import wrap
from typing import Final

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.segment import Segment
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

# Where a name goes on with its next part, and not a number with its decimals.
# Not within a label, as in stretch[my sheet].x, nor between numbers that belong together.
_BETWEEN_WORDS: Final = re.compile(r"(?:(?<![\d±\s])\s+|\s+(?![-+±\d\s]))(?![^\[\]]*\])")
_AFTER_DOT: Final = re.compile(r"(?<=\.)(?=[^\W\d])")
# `box.SIMPLE_HEAD`, in place of which rich would draw a fence.
_ASCII: Final = box.Box("    \n    \n -- \n" + 5 * "    \n", ascii=True)


def rendered(answer: document.Document, *, verbose: bool = False) -> RenderableType:
    """A document for a terminal: how far to trust it first, then its parts.

    Lines are broken between words only, and a table that does not fit becomes lines: no number and
    no name is ever cut. Print it with ``crop=False``, or a word longer than the terminal is.

    Args:
        answer: the document.
        verbose: whether all tables are shown; else as many rows as a screen has, and a line names
            the others.
    """
    # The parts of smaller answers begin with their one figure.
    headline = answer.headline if answer.written == "opening" else ""
    parts: list[RenderableType] = [*_verdict(answer.assessment, headline)]
    shown = answer.shown("console", *(("detail", "verbose") if verbose else ()))
    most = 25
    room, more, rows = math.inf if verbose or answer.whole else most, list[str](), 0
    for part in shown:
        if isinstance(part, document.Text):
            parts.append(_paragraph(part))
        elif isinstance(part, listing.Table):
            if len(part.cells) > room:
                # The first table's rows are the answer; of another its last may be the outcome.
                if room < most:
                    more.append(part.title)
                    continue
                rows = len(part.cells) - most
                part = replace(part, cells=part.cells[:most])
            room -= len(part.cells)
            parts.append(FittedTable(part))
    if not verbose:
        more += [p.title for p in answer.parts if isinstance(p, listing.Table) and _hidden(p)]
    hidden = [f"{rows} row{'s' * (rows > 1)} of the first table"] if rows else []
    if count := len([title for title in dict.fromkeys(more) if title]):
        hidden.append("one table" if count == 1 else f"{count} tables")
    if hidden:
        parts.append(Wrapped(f"--verbose shows {' and '.join(hidden)} more.", style="dim"))
    return Group(*parts)


def _hidden(table: listing.Table) -> bool:
    return table.place in ("detail", "verbose") and bool(table.cells)


def _verdict(how_far: Assessment, headline: str) -> Iterator[RenderableType]:
    """The verdict, the headline and the notes, and an empty line below them."""
    sentence = how_far.statement
    word = Text(
        f"{how_far.word}. " if sentence else f"{how_far.word}.", style=COLOUR[how_far.level]
    )
    yield Wrapped(sentence, word)
    if headline:
        yield Wrapped(headline, style="bold")
    yield from map(bullet, how_far.notes)
    yield ""


def _paragraph(part: document.Text) -> RenderableType:
    if part.bullet:
        return bullet(part.text)
    if part.look == "remedy":
        return Wrapped(part.text, "     → ", "     ", "italic")
    if part.look == "verbatim":
        return Text(part.text, no_wrap=True, overflow="ignore")
    return Wrapped(part.text, style="bold" if part.look == "heading" else "")


@dataclass(frozen=True, eq=False)
class Wrapped:
    """A text broken between words only; its lines begin with ``first`` and ``rest``."""

    text: str
    first: Text | str = ""
    rest: str = ""
    style: str = ""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        del console
        begin = self.first
        for line in self.text.split("\n"):
            for part in _wrapped(line, options.max_width, str(begin), self.rest) or [str(begin)]:
                words = (part[len(begin) :], self.style)
                yield Text.assemble(begin, words, no_wrap=True, overflow="ignore")
                begin = self.rest


def _wrapped(line: str, width: int, first: str = "", rest: str = "") -> list[str]:
    """Lines no longer than that, unless a word is: a name stays whole."""
    return wrap(
        line,
        width,
        initial_indent=first,
        subsequent_indent=rest,
        break_long_words=False,
        break_on_hyphens=False,
    )


def bullet(note: str) -> Wrapped:
    """A sentence behind a bullet."""
    return Wrapped(note, " • ", "   ")


@dataclass(frozen=True, eq=False)
class FittedTable:
    """A table where the terminal is wide enough for its numbers and words, or else lines."""

    listed: listing.Table

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        listed, width = self.listed, options.max_width
        if listed.title:
            yield Wrapped(listed.title, style="bold")
        for hung in self._below():
            # Rather close together than with broken names, and rather that than cells below.
            for broken, padding in product((False, True), (1, 0)):
                beside = [k for k in range(len(listed.heads)) if k not in hung]
                if widths := self._widths(beside, width, padding, broken=broken):
                    room = dict(zip(beside, widths, strict=True))
                    yield from self._table(console, options, room, padding, hung)
                    return
        for line in self._lines(width):
            yield Text(line, no_wrap=True, overflow="ignore")
        yield ""

    def _below(self) -> Iterator[tuple[int, ...]]:
        """Columns whose cells may stand below their rows: none, the widest in words, or the two."""
        listed = self.listed
        columns = list(zip(listed.heads, *listed.cells, strict=True))
        wordy = [k for k in range(1, len(columns)) if k not in listed.numeric]
        wordy.sort(key=lambda k: max(map(cell_len, columns[k])), reverse=True)
        for count in range(min(2, len(wordy)) + 1):
            yield tuple(sorted(wordy[:count]))

    def _table(
        self,
        console: Console,
        options: ConsoleOptions,
        widths: dict[int, int],
        padding: int,
        hung: tuple[int, ...],
    ) -> RenderResult:
        """A table of columns with their widths, and below each row what stands in the others.

        Rich has no cell across columns: for such cells one table ends and another goes on.
        """
        listed = self.listed
        parts: list[Table | Wrapped] = [self._begun(options, widths, padding)]
        for k, row in enumerate(listed.cells):
            if not isinstance(drawn := parts[-1], Table):
                drawn = self._begun(options, widths, padding, headed=False)
                parts.append(drawn)
            strong, tones = k in listed.strong, listed.tones[k]
            cells = [
                Text(_broken(row[j], room), style="" if (tone := tones[j]) is None else TONE[tone])
                for j, room in widths.items()
            ]
            drawn.add_row(*cells, style="bold" if strong else "", end_section=strong)
            below = (f"{listed.heads[j]} {row[j]}".strip() for j in hung if row[j].strip())
            if remaining_cells := "  ".join(below):
                parts.append(Wrapped(remaining_cells, "   ", "   ", "dim"))
        for k, part in enumerate(parts):
            if isinstance(part, Wrapped):
                yield part
                continue
            # The empty lines about a table stand before the first and behind the last only.
            lines = console.render_lines(part, options, pad=False)
            for line in lines[k > 0 : len(lines) - (k + 1 < len(parts))]:
                yield from line
                yield Segment.line()
        if isinstance(parts[-1], Wrapped):
            yield ""

    def _begun(
        self,
        options: ConsoleOptions,
        widths: dict[int, int],
        padding: int,
        *,
        headed: bool = True,
    ) -> Table:
        listed = self.listed
        drawn = Table(
            box=_ASCII if options.ascii_only else box.SIMPLE_HEAD,
            pad_edge=False,
            padding=(0, padding),
            show_header=headed and any(listed.heads),
            header_style="bold",
        )
        for k, width in widths.items():
            drawn.add_column(
                _broken(listed.heads[k], width),
                justify="right" if k in listed.numeric else "left",
                width=width,
            )
        return drawn

    def _widths(self, beside: list[int], width: int, padding: int, *, broken: bool) -> list[int]:
        """Of the columns ``beside``, in a table so wide; none where it cannot be."""
        every = list(zip(self.listed.heads, *self.listed.cells, strict=True))
        columns = [every[k] for k in beside]
        widths = [max(map(cell_len, column)) for column in columns]
        # Numbers stay on their line, whatever is between them; other cells break between words,
        # and no row becomes a tower.
        split = _pieces if broken else _words
        # Of a cell in a table, at most about.
        lines = 3
        least = [
            widest
            if k in self.listed.numeric
            else max(widest // lines, *(cell_len(word) for cell in column for word in split(cell)))
            for k, widest, column in zip(beside, widths, columns, strict=True)
        ]
        # The frame and what is between two columns.
        room = width - 2 - (1 + 2 * padding) * (len(widths) - 1)
        while sum(widths) > room:
            wide = [k for k in range(len(widths)) if widths[k] > least[k]]
            if not wide:
                return []
            widths[max(wide, key=widths.__getitem__)] -= 1
        return widths

    def _lines(self, width: int) -> Iterator[str]:
        """Every row as its first cell and, behind their headings, as many more as a line takes.

        A row that leaves its first cell empty goes on with what the row before it is about.
        """
        for row in self.listed.cells:
            pairs = zip(self.listed.heads, row, strict=True)
            first, *more = (f"{head} {cell}".strip() for head, cell in pairs if cell.strip())
            lines = [first if row[0].strip() else f"  {first}"]
            for pair in more:
                if len(lines[-1]) + len("  ") + len(pair) > width:
                    lines.append("")
                lines[-1] += f"  {pair}"
            for line in lines:
                yield from _wrapped(line, width, rest="    ")


def _words(text: str) -> list[str]:
    """What no line is broken within."""
    return _BETWEEN_WORDS.split(text.strip())


def _pieces(text: str) -> list[str]:
    """The same, and of names the parts up to their dots."""
    return [piece for word in _words(text) for piece in _AFTER_DOT.split(word)]


def _broken(cell: str, width: int) -> str:
    """A cell's text in which names that are wider than that go on in the next line after a dot."""
    words = []
    for word in cell.split(" "):
        lines = [""]
        for piece in _AFTER_DOT.split(word) if cell_len(word) > width else [word]:
            if lines[-1] and cell_len(lines[-1] + piece) > width:
                lines.append("")
            lines[-1] += piece
        words.append("\n".join(lines))
    return " ".join(words)
