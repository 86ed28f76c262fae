"""What an analysis adds to ``report.html``: one section, in place of its earlier self.

An analysis of a job stands in the report of its calibration, below what is there. Where there is
no report, or for an analysis that has no job, it makes a page of its own.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined

from suta_calib.assessment import Assessment
from suta_calib.report.files import write_texts

REPORT: Final = "report.html"
_END: Final = "<!-- analyses -->"


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str


@dataclass(frozen=True)
class Plot:
    """A picture: an SVG element as `report.svg.svg_text` makes it, ids unique on the page."""

    svg: str
    title: str = ""


@dataclass(frozen=True)
class Table:
    """Cells as they are shown; ``numeric`` are the columns that stand flush right."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    numeric: frozenset[int] = frozenset()
    title: str = ""


@dataclass(frozen=True)
class Section:
    """One analysis on a page.

    Attributes:
        name: identifies it: a section replaces an earlier one of its name.
        title: its heading.
        assessment: the first thing a reader needs.
        parts: what follows, in order.
    """

    name: str
    title: str
    assessment: Assessment
    parts: Sequence[Text | Plot | Table] = field(default_factory=tuple)


def page_with(section: Section, page: str | None, title: str = "") -> str:
    """A page with the section in it.

    Args:
        section: what is to be shown; every text in it is escaped.
        page: HTML of an earlier report, or None for a page of its own.
        title: of a page of its own.

    Returns:
        HTML that needs nothing else: the earlier page with this section below its others, or in
        the place of the one of the same name.
    """
    templates = environment()
    if page is None or not _place(page):
        page = templates.get_template("analyses.html.j2").render(title=title or section.title)
    shown = templates.get_template("section.html.j2").render(section=section).strip()
    earlier = re.compile(rf'<section id="{re.escape(section.name)}">.*?</section>\n?', re.DOTALL)
    if earlier.search(page):
        return earlier.sub(lambda _: shown + "\n", page, count=1)
    place = _place(page)
    before, after = page.rsplit(place, 1)
    return f"{before}{shown}\n{place}{after}"


def _place(page: str) -> str:
    """What a new section goes before; a page from before there were sections has its end."""
    return next((mark for mark in (_END, "</body>") if mark in page), "")


def environment() -> Environment:
    """Templates of the report: every text is escaped, a missing value is an error."""
    return Environment(
        loader=PackageLoader("suta_calib.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def write_analysis(
    answer: Mapping[str, Any],
    section: Section,
    folder: Path,
    texts: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, Any]:
    """Write what an analysis found: ``NAME.json``, its pictures, its section in ``report.html``.

    Args:
        answer: content of ``NAME.json``, NAME being the section's.
        section: goes into the folder's report, or makes one.
        folder: created if it is not there.
        texts: further whole files by name. Plots of the section are written as
            ``NAME.svg``, or ``NAME_1.svg``, ``NAME_2.svg``, … where there are several.

    Returns:
        ``answer`` with ``files``, the paths written by name; what ``NAME.json`` holds.

    Raises:
        OutputError: the folder or a file in it cannot be written.
    """
    report = folder / REPORT
    page = report.read_text(encoding="utf-8", errors="replace") if report.is_file() else None
    contents = {**texts, **_pictures(section), REPORT: page_with(section, page)}
    return write_texts(answer, contents, folder, f"{section.name}.json")


def _pictures(section: Section) -> dict[str, str]:
    plots = [part.svg for part in section.parts if isinstance(part, Plot)]
    if len(plots) == 1:
        return {f"{section.name}.svg": plots[0]}
    return {f"{section.name}_{k}.svg": svg for k, svg in enumerate(plots, start=1)}
