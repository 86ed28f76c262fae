"""The page's sink: documents as sections of a report, each in place of its earlier self.

An analysis of a job stands in the report of its calibration, below what is there. Where there is
no report, or for an analysis that has no job, it makes a page of its own. A page is of one job.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from functools import cache
from html import escape, unescape
from typing import Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from suta_calib.assessment import attempt
from suta_calib.plotting.look import BLUE, GREY, LINE, ORANGE, TINT
from suta_calib.report.document import Document, Figure, SpatialFigure
from suta_calib.report.listing import Table
from suta_calib.report.panels import separated
from suta_calib.report.spatial import scene_html

# Documents that a report begins anew with.
BEGINS: Final = ("opening", "result")
# Widths of a page at which tables that need as much begin to stack, px.
_ROOM: Final = tuple(range(320, 1000, 60))
_COLOUR: Final = re.compile(r"#[0-9a-fA-F]{6}\b")
_END: Final = "<!-- analyses -->"
_JOB: Final = re.compile(r'<meta name="job" content="([^"]*)">')
_SECTION: Final = re.compile(r'<section id="([^"]*)">')
_HEADING: Final = re.compile(r'<h2 id="([^"]*)">(.*?)</h2>')
_CONTENTS: Final = re.compile(r'<nav class="contents">.*?</nav>', re.DOTALL)


def page_with(answer: Document, page: str | None, job: str = "") -> str:
    """A page with the document in it.

    Args:
        answer: what is to be shown; every text in it is escaped.
        page: HTML of an earlier report, or None for a page of its own.
        job: the file that the answer is on; empty for none.

    Returns:
        HTML that needs nothing else: the earlier page with this section below its others, or in
        the place of the one of the same name; a page of its own where it opens a report.
    """
    templates = environment()
    begins = answer.written in BEGINS or page is None or not belongs(page, job)
    # A page with this result alone gets a new date.
    begins = begins or (page is not None and _SECTION.findall(page) == [escape(answer.name)])
    if begins or page is None or not _place(page):
        now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
        page = templates.get_template("analyses.html.j2").render(
            title=answer.title, job=job, written=now
        )
    shown = templates.get_template("document.html.j2").render(answer=answer, job=job).strip()
    earlier = re.compile(rf'<section id="{re.escape(answer.name)}">.*?</section>\n?', re.DOTALL)
    if earlier.search(page):
        return _with_contents(earlier.sub(lambda _: shown + "\n", page, count=1))
    place = _place(page)
    before, after = page.rsplit(place, 1)
    return _with_contents(f"{before}{shown}\n{place}{after}")


def belongs(page: str, job: str) -> bool:
    """Whether what is on a job may stand on a page: of the same one, or of none that is known."""
    of = _JOB.search(page)
    return not (job and of and of[1]) or unescape(of[1]) == job


def holds_others(answer: Document, page: str) -> bool:
    """Whether a page tells of more than this answer."""
    return any(unescape(name) != answer.name for name in _SECTION.findall(page))


def environment() -> Environment:
    """Templates of the report: every text is escaped, a missing value is an error."""
    templates = Environment(
        loader=PackageLoader("suta_calib.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.tests["figure"] = lambda part: isinstance(part, Figure)
    templates.tests["space"] = lambda part: isinstance(part, SpatialFigure)
    templates.tests["table"] = lambda part: isinstance(part, Table)
    templates.filters["drawn"] = _drawn
    templates.filters["stacked"] = _stacked
    templates.globals["room"] = _ROOM
    templates.filters["turnable"] = lambda space: Markup(_turnable(space, templates))
    return templates


def _turnable(space: SpatialFigure, templates: Environment) -> str:
    """The scene as HTML, or why there is none."""
    notes = list[str]()
    drawn = attempt(
        "drawn: the arm", lambda: scene_html(space.scene(), "scene", templates), "", notes
    )
    return drawn or f'<p class="soft">{escape(" ".join(notes))}</p>'


def _drawn(figure: Figure) -> Markup:
    return Markup(separated(themed(figure.svg)))


def themed(svg: str) -> str:
    """A figure in the colours of its page, where they are those that figures share.

    What has others, a map of numbers to colours, says with ``data-mapped`` that it stays.
    """
    theme = _theme()
    if set(map(str.lower, _COLOUR.findall(svg))) <= set(theme):
        return _COLOUR.sub(lambda row: f"var(--{theme[row[0].lower()]})", svg)
    return svg.replace("<svg ", '<svg data-mapped="" ', 1)


@cache
def _theme() -> dict[str, str]:
    """What figures are drawn in, and what the page's style calls it."""
    return {
        "#000000": "ink",
        "#ffffff": "paper",
        BLUE.lower(): "blue",
        ORANGE.lower(): "amber",
        GREY.lower(): "grey",
        TINT.lower(): "tint",
        LINE: "line",
        "#1f77b4": "blue",  # Matplotlib's own, of marks that are covered
    }


def _stacked(table: Table) -> str:
    """The class of a table that needs that much room beside each other: it stacks its cells below.

    Estimated from letters, for nobody knows the reader's font: the next of some steps up.
    """
    if not any(table.heads):
        return ""
    # Width of a letter, and of what is about a cell, px; letters in which a text may be set.
    letter, about, prose = 8.3, 14.0, 24
    needed = about * len(table.heads)
    for k, column in enumerate(zip(table.heads, *table.cells, strict=True)):
        words = column if k in table.numeric else " ".join(column).split()
        shortest = max(map(len, words), default=0)
        needed += letter * max(shortest, min(prose, max(map(len, column))))
    return next((f"over-{step}" for step in _ROOM if needed <= step), f"over-{_ROOM[-1]}")


def _with_contents(page: str) -> str:
    """The page with the list of its headings, where it has a place for one and there are some."""
    headings = _HEADING.findall(page)
    # Headings go on after a comma or a colon; a list of them need not.
    items = "".join(
        f'<li><a href="#{at}">{re.split("[,:] ", title, maxsplit=1)[0]}</a></li>'
        for at, title in headings
    )
    listed = f"<ul>{items}</ul>" if len(headings) > 1 else ""
    return _CONTENTS.sub(lambda _: f'<nav class="contents">{listed}</nav>', page, count=1)


def _place(page: str) -> str:
    """What a new section goes before; a page from before there were sections has its end."""
    return next((mark for mark in (_END, "</body>") if mark in page), "")
