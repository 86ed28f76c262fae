"""The page's sink: documents as sections of ``report.html``, each in place of its earlier self.

An analysis of a job stands in the report of its calibration, below what is there. Where there is
no report, or for an analysis that has no job, it makes a page of its own.
"""

from __future__ import annotations

import re
from typing import Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from suta_calib.report.document import Document, Figure, Folded
from suta_calib.report.listing import Table

_END: Final = "<!-- analyses -->"


def page_with(answer: Document, page: str | None) -> str:
    """A page with the document in it.

    Args:
        answer: what is to be shown; every text in it is escaped.
        page: HTML of an earlier report, or None for a page of its own.

    Returns:
        HTML that needs nothing else: the earlier page with this section below its others, or in
        the place of the one of the same name; a page of its own where it opens a report.
    """
    templates = environment()
    if answer.written == "opening" or page is None or not _place(page):
        page = templates.get_template("analyses.html.j2").render(title=answer.title)
    shown = templates.get_template("document.html.j2").render(answer=answer).strip()
    earlier = re.compile(rf'<section id="{re.escape(answer.name)}">.*?</section>\n?', re.DOTALL)
    if earlier.search(page):
        return earlier.sub(lambda _: shown + "\n", page, count=1)
    place = _place(page)
    before, after = page.rsplit(place, 1)
    return f"{before}{shown}\n{place}{after}"


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
    templates.tests["folded"] = lambda part: isinstance(part, Folded)
    templates.tests["table"] = lambda part: isinstance(part, Table)
    templates.filters["drawn"] = lambda figure: Markup(figure.svg)
    return templates


def _place(page: str) -> str:
    """What a new section goes before; a page from before there were sections has its end."""
    return next((mark for mark in (_END, "</body>") if mark in page), "")
