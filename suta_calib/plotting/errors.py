"""Errors before and after a calibration: histograms and boxes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.cbook import boxplot_stats

from suta_calib.arrays import FloatArray
from suta_calib.plotting.look import BLUE, GREY, MOST_GROUPS, ORANGE, TINT, shortened
from suta_calib.plotting.style import legend_above, plain_log
from suta_calib.units import Unit, shown, unit_name


def draw_histogram(
    axes: Any, before: FloatArray, after: FloatArray, unit: Unit, quantity: str
) -> None:
    """Draw a histogram of error norms (n,), SI, before and after, with mean and RMS."""
    sizes = {name: np.abs(shown(e, unit)) for name, e in (("before", before), ("after", after))}
    bins, logarithmic = _bins(*sizes.values())
    if logarithmic:
        plain_log(axes.xaxis, axes.set_xscale)
    handles: dict[str, list[Any]] = {}
    # The errors before stand in front: their hatches let the others through.
    for name, colour, hatch, dash in (("after", BLUE, "", "--"), ("before", ORANGE, "////", ":")):
        values, fill = sizes[name], "none" if hatch else colour
        count = np.histogram(np.clip(values, bins[0], bins[-1]), bins)[0]
        bars: dict[str, Any] = {"facecolor": fill, "edgecolor": colour, "hatch": hatch}
        rms, mean = float(np.sqrt(np.mean(values**2))), float(values.mean())
        label = f"{name} {{:.3g}} {unit_name(unit)}"
        triangle: dict[str, Any] = {"color": colour, "mec": "black", "ms": 7, "clip_on": False}
        handles[name] = [
            axes.stairs(count, bins, fill=True, lw=1.0, zorder=2, label=name, **bars),
            axes.axvline(rms, c="black", lw=1.2, ls=dash, label="RMS " + label.format(rms)),
            *axes.plot(mean, 0.0, "^", zorder=4, label="mean " + label.format(mean), **triangle),
        ]
    lowest = f" (the first bar: {bins[1]:.2g} and less)" if logarithmic else ""
    axes.set_xlabel(f"{quantity} error, {unit_name(unit)}{lowest}")
    axes.set_ylabel("number of errors")
    axes.set_ylim(bottom=0.0)
    legend_above(axes, [*handles["before"], *handles["after"]])


def _bins(before: FloatArray, after: FloatArray) -> tuple[FloatArray, bool]:
    """Edges of the bars, and whether they stand on a log axis."""
    both = np.concatenate([before, after])
    count = int(np.clip(3 * len(before) ** 0.4, 12, 60))
    top = max(float(both.max()), 1e-9)
    middle = sorted(max(float(np.median(e)), 1e-9) for e in (before, after))
    # Two histograms whose medians differ by more than this are both visible only on a log axis.
    if middle[1] <= 4.0 * middle[0]:
        return np.linspace(0.0, top, count + 1), False
    # The few that are almost zero would stretch a log axis: the first bin takes them all.
    low = max(min(float(np.percentile(both, 1)), middle[0] / 3), middle[0] / 100)
    return np.geomspace(low, top * 1.001, count + 1), True


def draw_grouped_errors(
    axes: Any, groups: Mapping[str, FloatArray], grouping: str, unit: Unit = "m"
) -> None:
    """Draw boxes of errors, SI, as Tukey did, one a group, worst median first, in mm or deg.

    A whisker ends at the last error within one and a half boxes; what is beyond is a point.
    """
    ranked = sorted(groups.items(), key=lambda item: -float(np.median(item[1])))[:MOST_GROUPS]
    boxes = boxplot_stats([shown(errors, unit) for _, errors in ranked])
    rows = np.arange(len(boxes))
    low, first, middle, third, high = (
        np.array([box[key] for box in boxes]) for key in ("whislo", "q1", "med", "q3", "whishi")
    )
    axes.barh(rows, third - first, 0.62, first, facecolor=TINT, edgecolor=BLUE)
    ends = np.concatenate([low, third]), np.concatenate([first, high])
    axes.hlines(np.tile(rows, 2), *ends, colors="black", lw=1.0)
    axes.plot(np.concatenate([low, high]), np.tile(rows, 2), "|", c="black", ms=5)
    axes.vlines(middle, rows - 0.31, rows + 0.31, colors="black", lw=1.6)
    widest = max(float(box["fliers"].max(initial=0.0)) for box in boxes)
    for row, box in enumerate(boxes):
        # Of thousands most would hide each other: one for each half of a mark is enough.
        half_marks = np.round(box["fliers"] / max(widest, 1e-300) * 300)
        points = box["fliers"][np.unique(half_marks, return_index=True)[1]]
        axes.plot(points, np.full(len(points), row), "o", mfc="none", mec=GREY, ms=3)
    names = [shortened(f"{name}  ({len(errors)})") for name, errors in ranked]
    axes.set_yticks(rows, names)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlim(left=0.0)
    error = f"error after calibration, {unit_name(unit)}".rstrip(", ")
    axes.set_xlabel(f"{error} (in brackets: number of errors)")
    axes.set_ylabel(grouping)
    axes.grid(axis="x")
