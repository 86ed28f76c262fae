"""The four outlier metrics of one observation: over the artefact, or group by group."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes

from suta_calib.analysis.outliers.answer import (
    GROUPING_NOUN,
    METRICS,
    Level,
    Metric,
    TermOutliers,
)
from suta_calib.arrays import FloatArray
from suta_calib.plotting.style import BLUE, GREY, ORANGE
from suta_calib.units import Unit, mm, shown

# Unit of each metric, the head of its column, and the title of its plot.
TOLD: Final[dict[Metric, tuple[Unit, str, str]]] = {
    "contribution": ("%", "share %", "Error contribution, %"),
    "cooks_distance": ("1", "Cook", "Cook's distance"),
    "leave_one_out": ("%", "l.o.o. %", "RMS falls when left out by, %"),
    "bias": ("m", "bias mm", "Bias after registration, mm"),
}
# Dark on light: the scale is told by grey as well as by colour.
COLOURS: Final = "cividis_r"
SMALLEST, LARGEST = 30.0, 420.0


def draw_metrics(figure: Any, term: TermOutliers) -> list[Axes]:
    """Four panels, one a metric, with the threshold of each.

    Where landmarks are known, size and shade tell the value at each, which stands beside its
    label; else groups stand in the order of the files.

    Args:
        figure: an empty `Figure` or `SubFigure`.
        term: an observation that has groups.
    """
    panels = figure.subplots(2, 2)
    landmarks = term.level("landmarks")
    if landmarks is not None and term.position is not None:
        # The two axes along which the landmarks spread most, in the artefact's order.
        spread = np.ptp(term.position, axis=0)
        axes = sorted(np.argsort(-spread, kind="stable")[:2].tolist())
        for panel, metric in zip(panels.flat, METRICS, strict=True):
            _map(figure, panel, mm(term.position[:, axes]), landmarks, metric)
        for panel in panels[-1]:
            panel.set_xlabel(f"artefact's {'xyz'[axes[0]]}, mm")
        for panel in panels[:, 0]:
            panel.set_ylabel(f"artefact's {'xyz'[axes[1]]}, mm")
    else:
        for panel, metric in zip(panels.flat, METRICS, strict=True):
            _stems(panel, term.levels[-1], metric)
    return list(panels.flat)


def _values(level: Level, metric: Metric) -> tuple[FloatArray, float]:
    """The metric of every group, and its threshold, as they are shown."""
    unit = TOLD[metric][0]
    values = shown(np.array([g.values[metric] for g in level.groups]), unit)
    return values, shown(level.thresholds[metric], unit)


def _map(figure: Any, axes: Axes, place: FloatArray, level: Level, metric: Metric) -> None:
    values, limit = _values(level, metric)
    drawn = np.nan_to_num(np.maximum(values, 0.0))
    top = max(float(drawn.max()), limit)
    size = SMALLEST + (LARGEST - SMALLEST) * drawn / top
    look: dict[str, Any] = {"cmap": COLOURS, "vmin": 0.0, "vmax": top, "lw": 0.6}
    marks: Any = axes.scatter(place[:, 0], place[:, 1], s=size, c=drawn, edgecolors="black", **look)
    below: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "va": "top"}
    for (x, y), group, value, area in zip(place, level.groups, values, size, strict=True):
        flagged = metric in group.flags
        if flagged:
            axes.plot(x, y, "s", mfc="none", mec="black", mew=1.8, ms=np.sqrt(area) + 7)
        label = f"{group.label} {value:.3g}{' !' if flagged else ''}"
        weight = "bold" if flagged else "normal"
        offset = (0, -4 - np.sqrt(area) / 2)
        axes.annotate(label, (x, y), offset, fontsize=7, fontweight=weight, **below)
    axes.set_title(TOLD[metric][2])
    centre = (place.max(axis=0) + place.min(axis=0)) / 2
    half = 0.62 * float(np.ptp(place, axis=0).max())
    axes.set_xlim(centre[0] - half, centre[0] + half)
    axes.set_ylim(centre[1] - half, centre[1] + half)
    axes.set_aspect("equal")
    axes.grid()
    bar = figure.colorbar(marks, ax=axes, shrink=0.8)
    bar.ax.axhline(limit, color="black", lw=1.5, ls="--")
    bar.ax.set_title("- - threshold", fontsize=6, fontweight="normal", loc="center")


def _stems(axes: Axes, level: Level, metric: Metric) -> None:
    values, limit = _values(level, metric)
    flagged = np.array([metric in g.flags for g in level.groups])
    number = np.arange(1, len(values) + 1)
    axes.vlines(number, 0.0, values, color=GREY, lw=0.8)
    axes.plot(number, values, "o", color=BLUE, ms=3.0)
    axes.plot(number[flagged], values[flagged], "s", mfc=ORANGE, mec="black", ms=6.0)
    for k in np.flatnonzero(flagged):
        label, at = level.groups[k].label, (number[k], values[k])
        axes.annotate(label, at, (4, 4), textcoords="offset points", fontsize=7)
    axes.axhline(limit, color="black", lw=1.0, ls="--")
    axes.annotate(
        "threshold", (1.0, limit), xycoords=("axes fraction", "data"), fontsize=6, ha="right"
    )
    axes.set_title(TOLD[metric][2] if metric != "bias" else "RMS residual, mm")
    axes.set_xlabel(f"{GROUPING_NOUN[level.name]}, in the order of the files")
    axes.margins(y=0.15)
    if not np.any(values < 0):
        axes.set_ylim(bottom=0)
    axes.grid(axis="y")
