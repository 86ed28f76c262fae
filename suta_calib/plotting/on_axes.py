"""Charts on Matplotlib's axes, for whoever goes on from there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from suta_calib.arrays import FloatArray
from suta_calib.plotting.change import Change
from suta_calib.plotting.chart import Axis, Boxes, Chart, Lines, Mark, Points, Steps
from suta_calib.plotting.errors import error_histogram
from suta_calib.plotting.look import WHITE
from suta_calib.plotting.parameters import parameter_changes, parameter_prospects
from suta_calib.plotting.style import plain_log
from suta_calib.units import Unit

_DASHES: Final = {"": "-", "dashed": "--", "dotted": ":"}
_SHAPES: Final = {"circle": "o", "square": "s", "triangle": "^", "cross": "X"}


def draw_histogram(axes: Any, before: FloatArray, after: FloatArray, unit: Unit, what: str) -> None:
    """Draw an `error_histogram` on `Axes`."""
    draw_chart(axes, error_histogram(before, after, unit, what))


def draw_prospects(
    axes: Any, names: Sequence[str], shares: Sequence[float | None], threshold: float
) -> None:
    """Draw `parameter_prospects` on `Axes`."""
    draw_chart(axes, parameter_prospects(names, shares, threshold))


def draw_changes(figure: Any, changes: Sequence[Change]) -> list[Any]:
    """Draw `parameter_changes` in an empty `Figure` or `SubFigure`; returns the panels' `Axes`."""
    charts = parameter_changes(changes)
    panels: list[Any] = list(figure.subplots(1, len(charts), squeeze=False)[0])
    for axes, chart in zip(panels, charts, strict=True):
        draw_chart(axes, chart)
    return panels


def draw_chart(axes: Any, chart: Chart) -> None:
    """Draw a chart on `Axes`, which are empty."""
    for axis, of, scale, limit in (
        (chart.x, axes.xaxis, axes.set_xscale, axes.set_xlim),
        (chart.y, axes.yaxis, axes.set_yscale, axes.set_ylim),
    ):
        if axis.log:
            plain_log(of, scale)
        elif axis.whole:
            of.set_major_locator(MaxNLocator(integer=True))
        limit(axis.first, axis.last)
        if axis.names is not None:
            values, names = [each[0] for each in axis.names], [each[1] for each in axis.names]
            of.set_ticks(values, names, fontsize=axis.size)
        of.set_label_text(axis.label)
        of.grid(axis.grid)
    axes.set_title(chart.title)
    if chart.equal:
        axes.set_aspect("equal", adjustable="box")
    if chart.bare:
        axes.spines[:].set_visible(False)
    handles = {
        id(mark): _draw(axes, mark, chart.x, chart.y, order)
        for order, mark in enumerate(chart.marks, start=2)
    }
    if legend := chart.legend:
        place: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0, 1)}
        shown = [handles[id(mark)] for mark in legend]
        axes.legend(handles=shown, ncols=chart.columns, fontsize=8, frameon=False, **place)


def _draw(axes: Any, mark: Mark, x: Axis, y: Axis, order: int) -> Any:
    """What Matplotlib made of a mark, for the legend."""
    if isinstance(mark, Steps | Boxes):
        look: dict[str, Any] = {
            "facecolor": mark.fill or "none",
            "edgecolor": mark.edge or "none",
            "hatch": "////" if mark.hatched else "",
            "label": mark.label,
            "zorder": order,
        }
        if isinstance(mark, Steps):
            return axes.stairs(mark.heights, mark.edges, fill=True, linewidth=1.0, **look)
        # Matplotlib 3.7 knows the colours of several bars by this name alone.
        look["color"] = look.pop("facecolor")
        left, right = _within(mark.left, x), _within(mark.right, x)
        bottom, top = _within(mark.bottom, y), _within(mark.top, y)
        return axes.bar(left, top - bottom, right - left, bottom, align="edge", **look)
    if isinstance(mark, Lines):
        lines = np.stack([_within(mark.x, x), _within(mark.y, y)], axis=-1)
        line: dict[str, Any] = {"colors": mark.colour, "linewidths": mark.width}
        line |= {"linestyles": _DASHES[mark.dash], "label": mark.label, "zorder": order}
        return axes.add_collection(LineCollection([*lines], **line))
    if isinstance(mark, Points):
        if isinstance(mark.size, np.ndarray) or not isinstance(mark.fill, str):
            of_each: dict[str, Any] = {"facecolors": mark.fill or "none", "edgecolors": mark.edge}
            of_each |= {"marker": _SHAPES[mark.shape], "label": mark.label, "zorder": order}
            return axes.scatter(mark.x, mark.y, np.square(mark.size), clip_on=False, **of_each)
        point: dict[str, Any] = {"markerfacecolor": mark.fill or "none", "clip_on": False}
        point |= {"markeredgecolor": mark.edge, "markersize": mark.size, "label": mark.label}
        return axes.plot(mark.x, mark.y, _SHAPES[mark.shape], zorder=order, **point)[0]
    for at, up, text, colour in zip(mark.x, mark.y, mark.texts, mark.colours, strict=True):
        middle: dict[str, Any] = {"ha": "center", "va": "center", "zorder": order}
        if mark.haloed:
            middle["path_effects"] = [withStroke(linewidth=2.5, foreground=WHITE)]
        axes.text(at, up, text, color=colour, fontsize=mark.size, **middle)
    return None


def _within(values: FloatArray, axis: Axis) -> FloatArray:
    """Values, those that are infinite at the end of the axis."""
    return np.clip(values, min(axis.first, axis.last), max(axis.first, axis.last))
