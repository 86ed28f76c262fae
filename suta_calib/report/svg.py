"""Matplotlib figures as SVG that can stand inside an HTML page among others."""

from __future__ import annotations

import gc
import io
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final, cast

import numpy as np
from lxml import etree
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from suta_calib.arrays import FloatArray
from suta_calib.plotting.style import WIDTH, style
from suta_calib.report.chart_svg import sized
from suta_calib.report.panels import mark, numbered
from suta_calib.units import Unit, shown

# Width of a letter on average, as a part of its height.
_LETTER: Final = 0.6
_SVG: Final = "{http://www.w3.org/2000/svg}"
_METADATA: Final = {"Date": None, "Creator": None, "Format": None, "Type": None}


@dataclass(frozen=True)
class Margins:
    """Room about the panels of a figure, inch: for what stands there, by how long it is.

    To measure everything that is written takes as long as drawing it; a figure whose margins are
    given is drawn once.

    Attributes:
        left, right, bottom, top: about all panels.
        between: two panels that stand side by side.
        below: the panels of each row, where there are several.
    """

    left: float = 0.75
    right: float = 0.15
    bottom: float = 0.52
    top: float = 0.12
    between: float = 0.0
    below: float = 0.0

    def apply(self, figure: Figure, panels: int = 1, rows: int = 1) -> None:
        """Set the margins of a figure with so many panels side by side, in so many rows."""
        width, height = figure.get_size_inches()
        panel = (width - self.left - self.right - (panels - 1) * self.between) / panels
        row = (height - self.bottom - self.top - (rows - 1) * self.below) / rows
        figure.subplots_adjust(
            left=self.left / width,
            right=1.0 - self.right / width,
            bottom=self.bottom / height,
            top=1.0 - self.top / height,
            wspace=self.between / panel,
            hspace=self.below / row,
        )


def width_of(texts: Iterable[str], points: float) -> float:
    """Room that the longest of some texts takes, inch, in letters of so many points."""
    return _LETTER * points / 72.0 * max(map(len, texts), default=0)


@contextmanager
def picture(
    name: str,
    size: tuple[float, float],
    margins: Margins | None = None,
    panels: int = 1,
    rows: int = 1,
) -> Iterator[Figure]:
    """An empty figure in that look, for `svg_text`.

    Args:
        name: of the plot, unique on the page.
        size: width and height, inch.
        margins: where they are known; they are measured by default.
        panels: side by side, to which the margins apply.
        rows: of them.
    """
    with style(name), _uncollected():
        figure = Figure(figsize=size, layout="constrained" if margins is None else None)
        if margins is not None:
            margins.apply(figure, panels, rows)
        yield figure


@contextmanager
def _uncollected() -> Iterator[None]:
    """Leave garbage for a while: a figure is ten thousand objects that all live until it is drawn.

    To look through them and all others, again and again, takes a sixth of the time.
    """
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def svg_text(figure: Figure, name: str, description: str) -> str:
    """A figure as an SVG element, without XML declaration, metadata or clashing ids.

    Args:
        figure: a `picture` of the same name.
        name: of the plot, unique on the page.
        description: what a reader who cannot see it is told.
    """
    buffer = io.BytesIO()
    # `Figure.savefig` draws everything one time more, only to lay it out.
    canvas, engine = cast("Any", FigureCanvasSVG(figure)), cast("Any", figure.get_layout_engine())
    parts = ""
    if engine is not None:
        resolution, figure.dpi = figure.dpi, canvas.fixed_dpi
        engine.execute(figure)
        figure.set_layout_engine("none")
        if figure.get_figwidth() > WIDTH:
            parts = mark(figure, name)
        figure.dpi = resolution
    canvas.print_svg(buffer, metadata=_METADATA)
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
    width = float(root.attrib.pop("width").removesuffix("pt"))
    del root.attrib["height"]
    for key, value in sized(width).items():
        root.set(key, value)
    root.set("id", name)
    root.set("role", "img")
    root.set("aria-label", description)
    return str(etree.tostring(root, encoding="unicode"))


def shown_array(values: FloatArray, unit: Unit) -> FloatArray:
    """SI values in mm or degrees."""
    return np.asarray(values * shown(1.0, unit))
