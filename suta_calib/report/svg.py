"""Matplotlib figures as SVG that can stand inside an HTML page among others."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final, cast

import numpy as np
from lxml import etree
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from suta_calib.arrays import FloatArray
from suta_calib.plotting.style import style
from suta_calib.units import Unit, shown

_SVG: Final = "{http://www.w3.org/2000/svg}"
_METADATA: Final = {"Date": None, "Creator": None, "Format": None, "Type": None}


@contextmanager
def picture(name: str, size: tuple[float, float]) -> Iterator[Figure]:
    """An empty figure in that look, for `svg_text`.

    Args:
        name: of the plot, unique on the page.
        size: width and height, inch.
    """
    with style(name):
        yield Figure(figsize=size, layout="constrained")


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
    resolution, figure.dpi = figure.dpi, canvas.fixed_dpi
    engine.execute(figure)
    figure.set_layout_engine("none")
    figure.dpi = resolution
    canvas.print_svg(buffer, metadata=_METADATA)
    root = etree.fromstring(buffer.getvalue())
    for metadata in root.findall(f"{_SVG}metadata"):
        root.remove(metadata)
    # Groups are numbered alike in every figure: only what is referred to keeps its id.
    values = " ".join(str(v) for e in root.iter() for v in e.attrib.values() if "#" in str(v))
    for element in root.iter():
        if element.get("id") and f"#{element.get('id')}" not in values:
            del element.attrib["id"]
    width = root.attrib.pop("width").removesuffix("pt")
    del root.attrib["height"]
    root.set("style", f"max-width:{float(width) * 4 / 3:.0f}px")
    root.set("id", name)
    root.set("role", "img")
    root.set("aria-label", description)
    return str(etree.tostring(root, encoding="unicode"))


def shown_array(values: FloatArray, unit: Unit) -> FloatArray:
    """SI values in mm or degrees."""
    return np.asarray(values * shown(1.0, unit))
