"""The map of the tip's uncertainty drawn over the arm, from the side and from above."""

from __future__ import annotations

import math
from itertools import product
from typing import Any, Final

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm

from suta_calib.analysis.tip_map import THRESHOLDS, TipMap
from suta_calib.analysis.tip_sections import Slice
from suta_calib.arrays import FloatArray
from suta_calib.plotting.look import ORANGE
from suta_calib.plotting.planar import draw_arm
from suta_calib.units import deg, mm

# Levels of the map, mm.
LEVELS: Final = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
_TITLES: Final = {"side": "from the side", "top": "from above"}


def draw_tip_map(figure: Any, tip_map: TipMap, *, absolute: bool = False) -> list[Axes]:
    """A vertical and a horizontal section, levels labelled in mm.

    Args:
        figure: an empty `Figure` or `SubFigure`.
        tip_map: the maps.
        absolute: the uncertainty in the base frame instead of that after registration.

    Returns:
        A panel for each section.
    """
    grids = [section.absolute if absolute else section.registered for section in tip_map.sections]
    levels = _levels(mm(np.concatenate([grid[np.isfinite(grid)] for grid in grids])))
    panels = list(figure.subplots(1, len(grids), squeeze=False)[0])
    for axes, section, grid in zip(panels, tip_map.sections, grids, strict=True):
        filled = _map(axes, section, mm(grid), levels)
        _arm_and_region(axes, section, tip_map)
    bar = figure.colorbar(
        filled, ax=panels, location="bottom", shrink=0.6, aspect=40, ticks=levels, pad=0.03
    )
    bar.set_label("uncertainty of the tip, mm (3-D); blank: out of reach")
    bar.ax.set_xticklabels([f"{level:g}" for level in levels])
    look: dict[str, Any] = {"ncols": 5, "columnspacing": 6.0, "fontsize": 8, "frameon": False}
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", **look)
    return panels


def _levels(values: FloatArray) -> list[float]:
    """Levels that the map needs, and one on either side of its values."""
    if not len(values):
        return list(LEVELS[:4])
    low = max(int(np.searchsorted(LEVELS, values.min(), "right")) - 1, 0)
    high = min(int(np.searchsorted(LEVELS, values.max())), len(LEVELS) - 1)
    return list(LEVELS[low : max(high, low + 2) + 1])


def _map(axes: Axes, section: Slice, grid: FloatArray, levels: list[float]) -> Any:
    u, v = mm(section.u), mm(section.v)
    shades = colormaps["Blues"].resampled(len(levels) - 1)
    norm = BoundaryNorm(levels, len(levels) - 1)
    masked = np.ma.masked_invalid(grid)
    filled = axes.contourf(u, v, masked, levels, cmap=shades, norm=norm, extend="max")
    lines = axes.contour(u, v, masked, levels, colors="black", linewidths=0.5)
    axes.clabel(lines, fmt="%g", fontsize=7, inline_spacing=2)
    limits, styles = [mm(limit) for limit in THRESHOLDS], ["--", "-"]
    for limit, look in zip(limits, styles, strict=True):
        axes.plot([], [], color="black", lw=1.8, ls=look, label=f"{limit:g} mm")
    axes.contour(u, v, masked, limits, colors="black", linewidths=1.8, linestyles=styles)
    return filled


def _arm_and_region(axes: Axes, section: Slice, tip_map: TipMap) -> None:
    arm = mm(section.project(tip_map.drawn))
    draw_arm(axes, arm)
    corners = np.array(list(product(*zip(tip_map.region.lower, tip_map.region.upper, strict=True))))
    flat = mm(section.project(corners))
    low, high = flat.min(axis=0), flat.max(axis=0)
    frame = np.array([low, [high[0], low[1]], high, [low[0], high[1]], low])
    axes.plot(*frame.T, color="black", lw=1.0, ls=":", label="region")
    place = mm(section.project(tip_map.place[None, :])[0])
    mark: dict[str, Any] = {"color": ORANGE, "mec": "black", "ms": 9, "ls": "none", "zorder": 7}
    axes.plot(*place, "P", label="registered here", **mark)
    # Only where the tip gets, and the arm.
    rows, columns = np.nonzero(np.isfinite(section.registered))
    across = np.concatenate([mm(section.u[columns]), arm[:, 0]])
    upward = np.concatenate([mm(section.v[rows]), arm[:, 1]])
    margin = 40.0
    axes.set_xlim(across.min() - margin, across.max() + margin)
    axes.set_ylim(upward.min() - margin, upward.max() + margin)
    axes.set_aspect("equal")
    axes.grid()
    if section.name == "top":
        axes.set_title(f"{_TITLES[section.name]}, at z = {mm(section.origin[2]):.0f} mm")
        axes.set_xlabel("x, mm")
        axes.set_ylabel("y, mm")
        return
    towards = deg(math.atan2(section.along[1], section.along[0]))
    axes.set_title(f"{_TITLES[section.name]}, plane at {towards:.0f}° from x")
    axes.set_xlabel("distance from the base's z axis, mm")
    axes.set_ylabel("z, mm")
