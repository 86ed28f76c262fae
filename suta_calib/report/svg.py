"""Matplotlib figures as SVG that can stand inside an HTML page among others."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final, cast

from lxml import etree
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from suta_calib.plotting.look import WIDTH
from suta_calib.plotting.style import style
from suta_calib.report.panels import mark, numbered

_SVG: Final = "{http://www.w3.org/2000/svg}"
_METADATA: Final = {"Date": None, "Creator": None, "Format": None, "Type": None}
# Digits of a point that no screen shows.
_FINE: Final = re.compile(r"(-?\d+\.\d\d)\d+")


@contextmanager
def picture(name: str, size: tuple[float, float]) -> Iterator[Figure]:
    """An empty figure in the look that all share, so wide and high, inch, for `svg_text`."""
    with style(name):
        yield Figure(figsize=size, layout="constrained")


def svg_text(figure: Figure, name: str, description: str) -> str:
    """A `picture` as an SVG element under the plot's name, without metadata or clashing ids."""
    buffer = io.BytesIO()
    parts = _lay_out(figure, name)
    cast("Any", FigureCanvasSVG(figure)).print_svg(buffer, metadata=_METADATA)
    root = etree.fromstring(buffer.getvalue())
    for metadata in root.findall(f"{_SVG}metadata"):
        root.remove(metadata)
    if parts:
        numbered(root, name, parts)
    # Groups are numbered alike in every figure: only what is referred to keeps its id.
    values = " ".join(str(v) for e in root.iter() for v in e.attrib.values() if "#" in str(v))
    for element in root.iter():
        if element.get("id") and f"#{element.get('id')}" not in values:
            del element.attrib["id"]
        for key in {"d", "x", "y", "transform"} & set(element.attrib):
            element.set(key, _FINE.sub(r"\1", element.get(key)))
    width = float(root.attrib.pop("width").removesuffix("pt"))
    del root.attrib["height"]
    for key, value in _sized(width).items():
        root.set(key, value)
    root.set("id", name)
    root.set("role", "img")
    root.set("aria-label", description)
    title = etree.Element(f"{_SVG}title")
    title.text = description
    root.insert(0, title)
    return str(etree.tostring(root, encoding="unicode"))


def _lay_out(figure: Figure, name: str) -> str:
    """Place panels, with room for letters that a narrow page enlarges; what `numbered` writes."""
    engine, resolution = cast("Any", figure.get_layout_engine()), figure.dpi
    if engine is None:
        return ""
    figure.dpi = 72.0
    width, height = figure.get_size_inches()
    # A narrow page enlarges what is written in a figure (`templates/style.css`) so many times.
    figure.set_size_inches(width / 1.22, height / 1.22)
    if len(figure.axes) == 1 and not figure.legends and figure.axes[0].get_aspect() == "auto":
        _fill(figure, figure.axes[0])
    else:
        engine.execute(figure)
    figure.set_size_inches(width, height)
    figure.set_layout_engine("none")
    parts = mark(figure, name) if figure.get_figwidth() > WIDTH else ""
    figure.dpi = resolution
    return parts


def _fill(figure: Any, axes: Any) -> None:
    """Give one panel all the room that what is written about it leaves: in one pass, not two."""
    axes.set_position((0.1, 0.15, 0.88, 0.75))
    (outer, inner), pad = (axes.get_tightbbox().padded(3.0), axes.bbox), figure.bbox
    left, bottom = (inner.min - outer.min) / pad.size
    right, top = 1.0 - (outer.max - inner.max) / pad.size
    axes.set_position((left, bottom, right - left, top - bottom))


def _sized(width: float) -> dict[str, str]:
    """Attributes of a figure, so many points wide, that say how large a page may show it.

    One as wide as `WIDTH` fills the text and fits a page of 500 pixels, where what is written in
    it is enlarged. A wider one of several panels can be read, and moved aside.
    """
    fits = 400.0 < width < 72.0 * WIDTH + 1.0
    most, least = (f"{width * pixels:.0f}px" for pixels in (1.8, 0.87 if fits else 1.1))
    size = {"style": f"max-width:{most};min-width:{least}"}
    return {"data-wide": ""} | size if fits else size
