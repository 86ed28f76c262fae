"""A document: a result with its verdict and its parts, in the order in which they are shown.

A document knows nothing of rich, jinja2, csv or files. Four sinks do: `report.console`,
`report.page` (HTML), and `report.files` (JSON, CSV).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any, Literal

from suta_calib.assessment import Assessment, attempt
from suta_calib.display import Displayable as ShowsItself
from suta_calib.report.listing import Json, Place, Table, plain

if TYPE_CHECKING:
    from suta_calib.plotting.scene import Scene

# NAME.json and a section of report.html; result.json and a report.html that begins anew with it;
# the same, but its pictures are on that page only; NAME.json alone; or neither, but the files it
# names.
Written = Literal["report", "result", "opening", "record", "files"]
Look = Literal["plain", "heading", "remedy", "soft", "verbatim"]


@dataclass(frozen=True)
class Text:
    """A paragraph.

    Attributes:
        text: what it says.
        bullet: whether it stands behind a bullet.
        place: where it is shown.
        look: what it is: a heading over the parts that follow, what to do about the bullets
            above it, a remark of less weight, a file's text as it stands.
    """

    text: str
    bullet: bool = False
    place: Place = "everywhere"
    look: Look = "plain"


def remark(text: str) -> Text:
    """A paragraph of less weight, on a page only."""
    return Text(text, place="page", look="soft")


@dataclass(frozen=True, eq=False)
class Figure:
    """A picture on a page, drawn only when the page is.

    Attributes:
        draw: makes an SVG element as `report.svg.svg_text` does, ids unique on the page.
        title: above it.
    """

    draw: Callable[[], str]
    title: str = ""

    @cached_property
    def svg(self) -> str:
        """The SVG element, drawn once; a few words where that fails."""
        notes = list[str]()
        drawn = attempt(f"drawn: {self.title or 'a picture'}", self.draw, "", notes)
        return drawn or _in_words(" ".join(notes))


def _in_words(text: str) -> str:
    """An SVG element with a sentence."""
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 640 40"><text x="8" y="24" '
        f'font-size="11">{escape(text)}</text></svg>'
    )


@dataclass(frozen=True, eq=False)
class SpatialFigure:
    """A scene on a page that its reader turns about; there is one at most."""

    scene: Callable[[], Scene]


@dataclass(frozen=True, eq=False)
class File:
    """A whole file of that name that is written beside the others, and shown nowhere."""

    name: str
    content: Callable[[], str | bytes]

    def as_bytes(self) -> bytes:
        """The content as it stands in the file; text is UTF-8."""
        content = self.content()
        return content if isinstance(content, bytes) else content.encode()


Shown = Text | Figure | SpatialFigure | Table
Part = Shown | File


def section(what: str, parts: Callable[[], Iterable[Part]]) -> list[Part]:
    """Parts of a document, or a sentence in their place where they cannot be computed."""
    notes = list[str]()
    computed = attempt(f"shown: {what}", lambda: list(parts()), None, notes)
    return [*map(Text, notes)] if computed is None else computed


def entry(key: str, compute: Callable[[], Any]) -> Any:
    """What JSON has under a key; null where it cannot be computed."""
    return attempt(f"written: {key}", compute, None)


@dataclass(frozen=True, eq=False)
class Document(ShowsItself):
    """A result that is ready to be shown.

    Attributes:
        name: identifies it: file names begin with it, and a section of a report replaces an
            earlier one of its name.
        title: its heading.
        assessment: the first thing a reader needs.
        parts: what is shown, in order; tables that have a key are written to JSON too.
        data: what else JSON has, SI values already in the reader's unit.
        written: what becomes of it in a folder, beside its pictures and files.
        headline: the one figure that a page begins with; empty for none.
        whole: whether a console shows all rows, however many: of a list that was asked for.
        incomplete: whether a part of what was asked for has no answer at all.
    """

    name: str
    title: str
    assessment: Assessment
    parts: Sequence[Part] = ()
    data: Mapping[str, Any] = field(default_factory=dict)
    written: Written = "report"
    headline: str = ""
    whole: bool = False
    incomplete: bool = False

    @property
    def exit_code(self) -> int:
        """Exit code of the command: 0; 1 if it must not be used; 2 if a part of it is missing."""
        return 2 if self.incomplete else self.assessment.exit_code

    def shown(self, *places: Place) -> list[Shown]:
        """The parts for these places, in order; tables without rows are not."""
        shown: list[Shown] = []
        for part in self.parts:
            where = part.place if isinstance(part, Table | Text) else "everywhere"
            empty = isinstance(part, Table) and not part.cells
            if where in ("everywhere", *places) and not isinstance(part, File) and not empty:
                shown.append(part)
        return shown

    def with_data(self, **data: Any) -> Document:
        """The same with more for JSON, such as the files it was made from."""
        return replace(self, data={**self.data, **data})

    def json(self) -> Json:
        """Everything as one JSON object, ``verdict`` last."""
        listed = {p.key: p.json() for p in self.parts if isinstance(p, Table) and p.key}
        return {**plain(self.data), **listed, "verdict": self.assessment.as_dict()}
