"""The four outlier metrics of one observation: over the artefact, or group by group."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from suta_calib.analysis.outliers.result import (
    GROUPING_NOUN,
    METRIC_LABELS,
    METRICS,
    Level,
    Metric,
    TermOutliers,
    metric_labels,
)
from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.plotting.look import BEHIND, BLUE, GREY, ORANGE
from suta_calib.plotting.style import legend_above, shades, thinned
from suta_calib.units import Unit, mm, shown, unit_name

# The area of a mark shows the value: diameters of the smallest and the largest mark, points.
SMALLEST, LARGEST = 5.5, 20.5


def draw_metrics(figure: Any, term: TermOutliers) -> list[Any]:
    """Draw four panels, one a metric, with the threshold of each.

    Where landmarks are known, size and shade tell the value at each, which stands below it with
    its label; else groups stand in the order of the files.

    Args:
        figure: an empty `Figure` or `SubFigure`.
        term: an observation that has groups.

    Returns:
        The panels' `Axes`.
    """
    panels: list[Any] = list(figure.subplots(2, 2).flat)
    landmarks = term.level("landmarks")
    for axes, metric in zip(panels, METRICS, strict=True):
        if landmarks is not None and term.position is not None:
            _draw_map(axes, mm(term.position), landmarks, metric)
        else:
            _draw_stems(axes, term.levels[-1], metric, term.unit)
    return panels


def _values(level: Level, metric: Metric, unit: Unit) -> tuple[FloatArray, float, BoolArray]:
    """The metric of every group, and its threshold, as they are shown; and who is flagged."""
    unit = metric_labels(metric, unit)[0]
    values = shown(np.array([g.values[metric] for g in level.groups]), unit)
    flagged = np.array([metric in g.flags for g in level.groups])
    return values, shown(level.thresholds[metric], unit), flagged


def _draw_map(axes: Any, position: FloatArray, level: Level, metric: Metric) -> None:
    values, limit, flagged = _values(level, metric, "m")
    # The two axes along which the landmarks spread most, in the artefact's order.
    chosen = sorted(np.argsort(-np.ptp(position, axis=0), kind="stable")[:2].tolist())
    x, y = position[:, chosen].T
    positive = np.nan_to_num(np.maximum(values, 0.0))
    share = positive / max(float(positive.max()), limit)
    area = SMALLEST**2 + (LARGEST**2 - SMALLEST**2) * share
    marks: dict[str, Any] = {"edgecolors": "black", "clip_on": False, "zorder": 3}
    axes.scatter(x, y, area, share, cmap=shades(), vmin=0.0, vmax=1.0, **marks)
    square: dict[str, Any] = marks | {"marker": "s", "facecolors": "none"}
    axes.scatter(x[flagged], y[flagged], np.square(np.sqrt(area[flagged]) + 7.0), **square)
    for k, group in enumerate(level.groups):
        text = f"{group.label} {values[k]:.3g}{' !' * bool(flagged[k])}"
        below: dict[str, Any] = {"xytext": (0, -np.sqrt(area[k]) / 2 - 2.0), "va": "top"}
        below |= {"textcoords": "offset points", "ha": "center", "fontsize": 7, "bbox": BEHIND}
        axes.annotate(text, (x[k], y[k]), zorder=4, **below)
    # Of what landmarks span, half the width that a map of them shows.
    half = 0.66 * float(np.ptp(position[:, chosen], axis=0).max())
    middle_x, middle_y = ((v.max() + v.min()) / 2 for v in (x, y))
    axes.set_xlim(middle_x - half, middle_x + half)
    axes.set_ylim(middle_y - half, middle_y + half)
    axes.set_aspect("equal")
    axes.set_xlabel(f"artefact's {'xyz'[chosen[0]]}, mm")
    axes.set_ylabel(f"artefact's {'xyz'[chosen[1]]}, mm")
    axes.set_title(f"{METRIC_LABELS[metric][2]}\nflagged (!) beyond {limit:.3g}")
    axes.grid()


def _draw_stems(axes: Any, level: Level, metric: Metric, unit: Unit) -> None:
    values, limit, flagged = _values(level, metric, unit)
    finite = np.isfinite(values)
    number, height = np.arange(1.0, len(values) + 1)[finite], values[finite]
    rows = thinned(number, height)
    axes.vlines(number[rows], 0.0, height[rows], colors=GREY, lw=0.8)
    axes.plot(number[rows], height[rows], "o", c=BLUE, ms=3)
    axes.axhline(limit, c="black", lw=1.0, ls="--", label="threshold")
    for k in np.flatnonzero(flagged & finite):
        axes.plot(k + 1, values[k], "s", c=ORANGE, mec="black", ms=6)
        above: dict[str, Any] = {"xytext": (0, 6), "textcoords": "offset points", "ha": "center"}
        axes.annotate(level.groups[k].label, (k + 1, values[k]), fontsize=7, bbox=BEHIND, **above)
    if height.min(initial=0.0) >= 0.0:
        axes.set_ylim(bottom=0.0)
    axes.set_xlim(0.0, len(values) + 1.0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel(f"{GROUPING_NOUN[level.name]}, in the order of the files")
    axes.grid(axis="y")
    residual = f"RMS residual, {unit_name(unit)}".rstrip(", ")
    legend_above(axes, title=METRIC_LABELS[metric][2] if metric != "bias" else residual)
