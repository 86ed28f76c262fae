"""The map of the tip's uncertainty, drawn over the arm; readable in grey."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure

from suta_calib.analysis.tip_map import THRESHOLDS, TipMap
from suta_calib.analysis.tip_sections import Slice
from suta_calib.arrays import FloatArray
from suta_calib.report.planning.plots import draw_arm
from suta_calib.report.svg import ORANGE, WIDTH, style, svg_text

MM: Final = 1e3
LEVELS: Final = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
_MARGIN: Final = 40.0
_TITLES: Final = {"side": "from the side", "top": "from above"}


def tip_map_figure(found: TipMap, name: str = "tip_map", *, absolute: bool = False) -> str:
    """An SVG element: a vertical and a horizontal section, levels labelled in mm.

    Args:
        found: the maps.
        name: id of the plot on its page.
        absolute: the uncertainty in the base frame instead of that after registration.
    """
    grids = [each.absolute if absolute else each.registered for each in found.sections]
    levels = _levels(MM * np.concatenate([grid[np.isfinite(grid)] for grid in grids]))
    with style(name):
        figure = Figure(figsize=(1.35 * WIDTH, 5.4), layout="constrained")
        panels = figure.subplots(1, len(grids))
        for axes, each, grid in zip(panels, found.sections, grids, strict=True):
            filled = _map(axes, each, MM * grid, levels)
            _arm_and_region(axes, each, found)
        bar = figure.colorbar(
            filled, ax=panels, location="bottom", shrink=0.6, aspect=40, ticks=levels, pad=0.03
        )
        bar.set_label("uncertainty of the tip, mm (3-D standard); blank: out of reach")
        bar.ax.set_xticklabels([f"{level:g}" for level in levels])
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=5, fontsize=8)
        description = "Map of the tip's uncertainty, from the side and from above"
        return svg_text(figure, name, description)


def _levels(values: FloatArray) -> list[float]:
    """Levels that the map needs, and one on either side of its values."""
    if not len(values):
        return list(LEVELS[:4])
    low = max([k for k, level in enumerate(LEVELS) if level <= values.min()], default=0)
    high = min(
        [k for k, level in enumerate(LEVELS) if level >= values.max()], default=len(LEVELS) - 1
    )
    return list(LEVELS[low : max(high, low + 2) + 1])


def _map(axes: Axes, each: Slice, grid: FloatArray, levels: list[float]) -> Any:
    u, v = MM * each.u, MM * each.v
    shades = colormaps["Blues"].resampled(len(levels) - 1)
    norm = BoundaryNorm(levels, len(levels) - 1)
    masked = np.ma.masked_invalid(grid)
    filled = axes.contourf(u, v, masked, levels, cmap=shades, norm=norm, extend="max")
    lines = axes.contour(u, v, masked, levels, colors="black", linewidths=0.5)
    axes.clabel(lines, fmt="%g", fontsize=7, inline_spacing=2)
    limits = [MM * limit for limit in THRESHOLDS]
    styles = ["--", "-"]
    for limit, look in zip(limits, styles, strict=True):
        axes.plot([], [], color="black", lw=1.8, ls=look, label=f"{limit:g} mm")
    axes.contour(u, v, masked, limits, colors="black", linewidths=1.8, linestyles=styles)
    return filled


def _arm_and_region(axes: Axes, each: Slice, found: TipMap) -> None:
    draw_arm(axes, MM * each.project(found.drawn))
    corners = np.array(
        [
            [x, y, z]
            for x in (found.region.lower[0], found.region.upper[0])
            for y in (found.region.lower[1], found.region.upper[1])
            for z in (found.region.lower[2], found.region.upper[2])
        ]
    )
    flat = MM * each.project(corners)
    low, high = flat.min(axis=0), flat.max(axis=0)
    frame = np.array([low, [high[0], low[1]], high, [low[0], high[1]], low])
    axes.plot(*frame.T, color="black", lw=1.0, ls=":", label="region")
    place = MM * each.project(found.place[None, :])[0]
    mark: dict[str, Any] = {"color": ORANGE, "mec": "black", "ms": 9, "ls": "none", "zorder": 7}
    axes.plot(*place, "P", label="registered here", **mark)
    _name(axes, each)
    _crop(axes, each, MM * each.project(found.drawn))


def _crop(axes: Axes, each: Slice, arm: FloatArray) -> None:
    """Only where the tip gets, and the arm."""
    rows, columns = np.nonzero(np.isfinite(each.registered))
    across = np.concatenate([MM * each.u[columns], arm[:, 0]])
    upward = np.concatenate([MM * each.v[rows], arm[:, 1]])
    axes.set_xlim(across.min() - _MARGIN, across.max() + _MARGIN)
    axes.set_ylim(upward.min() - _MARGIN, upward.max() + _MARGIN)


def _name(axes: Axes, each: Slice) -> None:
    axes.set_aspect("equal")
    axes.grid()
    if each.name == "top":
        axes.set_title(f"{_TITLES[each.name]}, at z = {MM * each.origin[2]:.0f} mm")
        axes.set_xlabel("x, mm")
        axes.set_ylabel("y, mm")
        return
    towards = np.degrees(np.arctan2(each.along[1], each.along[0]))
    axes.set_title(f"{_TITLES[each.name]}, plane at {towards:.0f}° from x")
    axes.set_xlabel("distance from the base's z axis, mm")
    axes.set_ylabel("z, mm")
