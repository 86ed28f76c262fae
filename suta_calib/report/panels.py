"""Figures of several panels on a page: taken apart, to stand in a column where it is narrow.

A figure of one panel can be made smaller, as what is written in it is enlarged; one of three
would be too small to read. It is drawn once, as one SVG, which is also the file, and says where
its panels are (`mark`); a page cuts it there (`separated`). Where they have room, the parts stand
as they were drawn, without a seam.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import deepcopy
from html import escape
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

from lxml import etree

from suta_calib.plotting.look import WIDTH

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# What the root says: of each part its first and last x, y, points from the top left, and its row.
_PARTS: Final = "data-parts"
# What each panel and legend says: the part it is in; the ground behind them is in none.
_PART: Final = "data-part"
_DEFINITIONS: Final = "{http://www.w3.org/2000/svg}defs"

_Span = tuple[float, float]
_Box = tuple[_Span, _Span]


def mark(figure: Figure, name: str) -> str:
    """Number the parts of a figure that is laid out, and name what is in each.

    Rows are told apart first, panels that stand beside each other in each row next.

    Args:
        figure: whose panels and legends are given ids; at 72 dots per inch.
        name: of the plot, unique on the page.

    Returns:
        What `separated` needs, for `numbered`; empty where no two parts stand beside each other.
    """
    width, height = (72.0 * float(inches) for inches in figure.get_size_inches())
    artists: list[Any] = [*figure.axes, *figure.legends, *figure.texts]
    boxes: list[_Box] = []
    for artist in artists:
        box = artist.get_tightbbox()
        boxes.append(((box.x0, box.x1), (height - box.y1, height - box.y0)))
    parts: list[tuple[_Span, _Span, int]] = []
    for row, (inside, high) in enumerate(_cut(boxes, range(len(boxes)), 1, height)):
        for these, wide in _cut(boxes, inside, 0, width):
            for k in these:
                artists[k].set_gid(f"{name}-part-{len(parts)}-{k}")
            parts.append((wide, high, row))
    if len({row for *_, row in parts}) == len(parts):
        return ""
    # It lies behind all parts; behind one of them, it would cover others.
    figure.patch.set_gid(f"{name}-part-ground-0")
    return ";".join(f"{x[0]:.1f} {x[1]:.1f} {y[0]:.1f} {y[1]:.1f} {row}" for x, y, row in parts)


def numbered(root: Any, name: str, parts: str) -> None:
    """Write into a drawn figure what `mark` has found."""
    root.set(_PARTS, parts)
    begin = f"{name}-part-"
    for element in root.iter():
        if element.get("id", "").startswith(begin):
            element.set(_PART, element.get("id").removeprefix(begin).split("-")[0])


def separated(svg: str) -> str:
    """A figure of `svg_text` for a page: in its parts where several stand beside each other."""
    if f" {_PARTS}=" not in svg:
        return svg

    root = etree.fromstring(svg)
    name, description = root.get("id"), root.get("aria-label")
    parts = root.get(_PARTS).split(";")
    for key in (_PARTS, "id", "role", "aria-label", "data-wide"):
        root.attrib.pop(key, None)
    rows: dict[str, list[str]] = {}
    for number, part in enumerate(parts):
        *edges, row = part.split()
        rows.setdefault(row, []).append(_piece(root, number, *map(float, edges)))
    shown = "\n".join(f"<div>{''.join(pieces)}</div>" for pieces in rows.values())
    attributes = f'id="{name}" role="img" aria-label="{escape(description)}"'
    return f'<div class="panels" {attributes}>\n{shown}\n</div>'


def _piece(root: Any, number: int, left: float, right: float, top: float, bottom: float) -> str:
    """One part of a figure as an SVG of its own."""
    # Pixels on a page per point from which on panels stand beside each other, and at most.
    beside = 1.1
    enlarged = 1.5
    piece = deepcopy(root)
    strange = [
        element for element in piece.iter() if element.get(_PART, str(number)) != str(number)
    ]
    # What all refer to stands in the first: ids are the page's.
    strange += piece.findall(_DEFINITIONS) if number else []
    for element in strange:
        element.getparent().remove(element)
    width = right - left
    piece.set("viewBox", f"{left:.1f} {top:.1f} {width:.1f} {bottom - top:.1f}")
    look = f"flex:{width:.0f} 1 {width * beside:.0f}px;max-width:{width * enlarged:.0f}px"
    piece.set("style", look)
    if width > 72.0 * WIDTH:
        piece.set("data-wider", "")
    return str(etree.tostring(piece, encoding="unicode"))


def _cut(
    boxes: Sequence[_Box], inside: Sequence[int], axis: int, end: float
) -> Iterator[tuple[list[int], _Span]]:
    """Boxes that overlap along an axis, and the stretch of it that is theirs alone."""
    groups: list[tuple[list[int], list[float]]] = []
    for k in sorted(inside, key=lambda k: boxes[k][axis]):
        low, high = boxes[k][axis]
        # Two panels whose outlines overlap by less stand apart, points.
        if groups and low < groups[-1][1][1] - 1.0:
            groups[-1][0].append(k)
            groups[-1][1][1] = max(groups[-1][1][1], high)
        else:
            groups.append(([k], [low, high]))
    seams = [(a[1][1] + b[1][0]) / 2.0 for a, b in pairwise(groups)]
    for (these, _), span in zip(
        groups, zip([0.0, *seams], [*seams, end], strict=True), strict=True
    ):
        yield these, span
