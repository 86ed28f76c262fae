"""How sure the tip is over the workspace, told: figures, and the map drawn over the arm."""

from __future__ import annotations

import math
from functools import partial
from itertools import product
from typing import Any, Final

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm

from suta_calib.analysis.tip_map import THRESHOLDS, Figures, OpenDirection, TipMap
from suta_calib.analysis.tip_sections import Slice
from suta_calib.arrays import FloatArray
from suta_calib.report.document import Document, Figure, Part, Text
from suta_calib.report.listing import Column, Listing, plain, written
from suta_calib.report.plan import region_record, region_text
from suta_calib.report.plan_plots import draw_arm
from suta_calib.report.svg import ORANGE, WIDTH, picture, svg_text
from suta_calib.units import deg, mm, shown

NAME: Final = "tip_map"
TITLE: Final = "How sure the tip is"
# Levels of the map, mm.
LEVELS: Final = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
_MARGIN: Final = 40.0
_TITLES: Final = {"side": "from the side", "top": "from above"}
# Figures of other instruments, mm, as the field quotes them; each is of another kind.
FIELD: Final = (
    ("optical tracking", 0.30, "RMS often quoted for optical navigation; not measured here"),
    ("electromagnetic tracking", 0.48, "RMS often quoted for EM navigation; not measured here"),
    ("mechanical CMM arm", 0.024, "maximum permissible error (ISO 10360-12): a limit, no spread"),
)
OURS: Final = "predicted 3-D RMS, this calibration's part only, after registration"
_WHAT: Final = (
    "Standard uncertainty of the tip's position in three dimensions that the calibration's "
    "covariance gives. Not in it: encoder noise, seating, compliance, what the registration's own "
    "touches scatter, and what the model lacks. Registered: after a rigid registration at the "
    "place named ('plan' fits over its whole region instead); absolute: in the base frame, with "
    "held parameters taken as exact."
)


def _within(k: int) -> Column[Figures]:
    """The share of the region within a threshold."""
    limit = f"{mm(THRESHOLDS[k]):g}"

    def cell(figures: Figures) -> str:
        return f"{shown(figures.within[k], '%'):.0f} %"

    return Column(f"within_{limit}mm", f"≤ {limit}", lambda f: f.within[k], "%", cell=cell)


FIGURES: Final = Listing[Figures](
    "",
    Column("rms", "RMS", unit="m"),
    Column("median", "median", unit="m"),
    Column("p95", "95 %", unit="m"),
    Column("max", "max", lambda figures: figures.maximum, "m"),
    *(_within(k) for k in range(len(THRESHOLDS))),
)
BOTH: Final = Listing[tuple[str, Figures]](
    "Uncertainty of the tip in the region, mm, and share within",
    Column("", "", lambda row: row[0]),
    *(c.over(lambda row: row[1]) for c in FIGURES.columns),
)
OTHERS: Final = Listing[tuple[str, float, str]](
    "Beside others: figures of different kinds",
    Column("what", "", lambda row: row[0]),
    Column("value_mm", "mm", lambda row: row[1], form=".3g"),
    Column("kind", "what the figure is", lambda row: row[2]),
)
HELD: Final = Listing[OpenDirection](
    "",
    Column("parameter", value=lambda each: each.fixed),
    Column("plausible", unit=lambda each: each.unit),
    Column("tip", value=lambda each: each.effect, unit="m"),
)
SECTION: Final = Listing[Slice](
    "",
    *written("along", "up"),
    *written("origin", "u", "v", "registered", "absolute", unit="m"),
)


def tip_map_document(found: TipMap) -> Document:
    """Figures over the region, the map over the arm, and the field's figures beside them."""
    place = "({:.0f}, {:.0f}, {:.0f})".format(*mm(found.place))
    where = (
        f"Region: {region_text(found.region)}. "
        f"Registered at {found.registration} points about {place} mm."
    )
    parts: list[Part] = [
        Figure(partial(tip_map_plot, found), "Uncertainty of the tip after registration, mm"),
        BOTH.of((("registered", found.registered), ("absolute", found.absolute))),
        OTHERS.of((("this arm", mm(found.registered.rms), OURS), *FIELD)),
        Text(where, bullet=True),
        Text(_WHAT, bullet=True),
    ]
    data = {
        "registered": FIGURES.record(found.registered),
        "absolute": FIGURES.record(found.absolute),
        "region": region_record(found.region),
        "registration": {"place_mm": plain(found.place, "m"), "points": found.registration},
        "held": HELD.records(found.open_directions),
        "sections": {each.name: SECTION.record(each) for each in found.sections},
        "field": OTHERS.records(FIELD),
        "tolerance_mm": plain(found.tolerance, "m"),
    }
    return Document(NAME, TITLE, found.assessment, parts, data)


def tip_map_plot(found: TipMap, name: str = NAME, *, absolute: bool = False) -> str:
    """An SVG element: a vertical and a horizontal section, levels labelled in mm.

    Args:
        found: the maps.
        name: id of the plot on its page.
        absolute: the uncertainty in the base frame instead of that after registration.
    """
    grids = [each.absolute if absolute else each.registered for each in found.sections]
    levels = _levels(mm(np.concatenate([grid[np.isfinite(grid)] for grid in grids])))
    with picture(name, (1.35 * WIDTH, 5.4)) as figure:
        panels = figure.subplots(1, len(grids))
        for axes, each, grid in zip(panels, found.sections, grids, strict=True):
            filled = _map(axes, each, mm(grid), levels)
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
    low = max(int(np.searchsorted(LEVELS, values.min(), "right")) - 1, 0)
    high = min(int(np.searchsorted(LEVELS, values.max())), len(LEVELS) - 1)
    return list(LEVELS[low : max(high, low + 2) + 1])


def _map(axes: Axes, each: Slice, grid: FloatArray, levels: list[float]) -> Any:
    u, v = mm(each.u), mm(each.v)
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


def _arm_and_region(axes: Axes, each: Slice, found: TipMap) -> None:
    arm = mm(each.project(found.drawn))
    draw_arm(axes, arm)
    corners = np.array(list(product(*zip(found.region.lower, found.region.upper, strict=True))))
    flat = mm(each.project(corners))
    low, high = flat.min(axis=0), flat.max(axis=0)
    frame = np.array([low, [high[0], low[1]], high, [low[0], high[1]], low])
    axes.plot(*frame.T, color="black", lw=1.0, ls=":", label="region")
    place = mm(each.project(found.place[None, :])[0])
    mark: dict[str, Any] = {"color": ORANGE, "mec": "black", "ms": 9, "ls": "none", "zorder": 7}
    axes.plot(*place, "P", label="registered here", **mark)
    # Only where the tip gets, and the arm.
    rows, columns = np.nonzero(np.isfinite(each.registered))
    across = np.concatenate([mm(each.u[columns]), arm[:, 0]])
    upward = np.concatenate([mm(each.v[rows]), arm[:, 1]])
    axes.set_xlim(across.min() - _MARGIN, across.max() + _MARGIN)
    axes.set_ylim(upward.min() - _MARGIN, upward.max() + _MARGIN)
    axes.set_aspect("equal")
    axes.grid()
    if each.name == "top":
        axes.set_title(f"{_TITLES[each.name]}, at z = {mm(each.origin[2]):.0f} mm")
        axes.set_xlabel("x, mm")
        axes.set_ylabel("y, mm")
        return
    towards = deg(math.atan2(each.along[1], each.along[0]))
    axes.set_title(f"{_TITLES[each.name]}, plane at {towards:.0f}° from x")
    axes.set_xlabel("distance from the base's z axis, mm")
    axes.set_ylabel("z, mm")
