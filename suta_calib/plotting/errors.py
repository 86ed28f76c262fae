"""Errors before and after a calibration: histograms and boxes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cbook import boxplot_stats
from matplotlib.collections import PolyCollection

from suta_calib.arrays import FloatArray
from suta_calib.plotting.limits import MOST_GROUPS
from suta_calib.plotting.style import BLUE, GREY, ORANGE, TINT, plain_log, shortened
from suta_calib.units import Unit, shown, unit_name

# Half the height of a box, of which one stands every unit.
_BOX: Final = 0.31
# Two histograms whose medians differ by more than this are both visible only on a log axis.
FAR_APART: Final = 4.0


def draw_histogram(
    axes: Axes, before: FloatArray, after: FloatArray, unit: Unit, what: str
) -> None:
    """Histogram of error norms before and after, with mean and RMS, in the reader's unit.

    Args:
        axes: to draw on.
        before: (n,) at least one, SI.
        after: the same.
        unit: of both.
        what: the errors are of, such as ``distance``.
    """
    sizes = {name: np.abs(shown(e, unit)) for name, e in (("before", before), ("after", after))}
    bins, logarithmic = _bins(*sizes.values())
    looks = (("before", ORANGE, "////", ":"), ("after", BLUE, "", "--"))
    for name, colour, hatch, line in looks:
        values = sizes[name]
        look: dict[str, Any] = {
            "facecolor": "none" if hatch else colour,
            "edgecolor": colour,
            "hatch": hatch,
            "linewidth": 1.0,
        }
        count = np.histogram(np.clip(values, bins[0], bins[-1]), bins)[0]
        axes.stairs(count, bins, fill=True, label=name, zorder=2 + bool(hatch), **look)
        rms, mean = float(np.sqrt(np.mean(values**2))), float(values.mean())
        told = (
            f"{figure} {name} {size:.3g} {unit_name(unit)}"
            for figure, size in (("RMS", rms), ("mean", mean))
        )
        axes.axvline(rms, color="black", linestyle=line, linewidth=1.2, label=next(told))
        mark: dict[str, Any] = {"color": colour, "markeredgecolor": "black", "markersize": 7}
        axes.plot(mean, 0.0, "^", clip_on=False, label=next(told), **mark)
    if logarithmic:
        plain_log(axes.xaxis, axes.set_xscale)
    lowest = f" (the first bar: {bins[1]:.2g} and less)" if logarithmic else ""
    axes.set_xlabel(f"{what} error, {unit_name(unit)}{lowest}")
    axes.set_ylabel("number of errors")
    axes.legend(ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1), frameon=False)


def _bins(before: FloatArray, after: FloatArray) -> tuple[FloatArray, bool]:
    both = np.concatenate([before, after])
    count = int(np.clip(3 * len(before) ** 0.4, 12, 60))
    top = max(float(both.max()), 1e-9)
    middle = sorted(max(float(np.median(e)), 1e-9) for e in (before, after))
    if middle[1] <= FAR_APART * middle[0]:
        return np.linspace(0.0, top, count + 1), False
    # The few that are almost zero would stretch a log axis: the first bin takes them all.
    low = max(min(float(np.percentile(both, 1)), middle[0] / 3), middle[0] / 100)
    return np.geomspace(low, top * 1.001, count + 1), True


def draw_groups(axes: Axes, groups: Mapping[str, FloatArray], grouping: str) -> None:
    """Box plot of errors, one box a group, worst median first, mm.

    Args:
        axes: to draw on.
        groups: errors, m, by the group's name; those beyond `MOST_GROUPS` are left out.
        grouping: what the groups are, e.g. ``landmark``.
    """
    ranked = sorted(groups.items(), key=lambda item: -float(np.median(item[1])))[:MOST_GROUPS]
    _boxes(axes, [shown(e, "m") for _, e in ranked])
    labels = [shortened(f"{n}  ({len(e)})") for n, e in ranked]
    axes.set_yticks(range(1, 1 + len(ranked)), labels=labels)
    axes.set_ylim(len(ranked) + 0.5, 0.5)
    axes.set_xlim(left=0)
    axes.grid(axis="x")
    axes.set_xlabel("error after calibration, mm (in brackets: number of errors)")
    axes.set_ylabel(grouping, labelpad=16)


def _boxes(axes: Axes, groups: Sequence[FloatArray]) -> None:
    """Lying boxes as Tukey drew them, at 1, 2, …: `Axes.boxplot` with few artists for all.

    Whiskers end at the last errors within one and a half boxes; what is beyond is a point.
    """
    found = boxplot_stats(groups)
    at = np.arange(1.0, len(found) + 1)
    low, q1, middle, q3, high = (
        np.array([float(box[key]) for box in found])
        for key in ("whislo", "q1", "med", "q3", "whishi")
    )
    corners = [(q1, -_BOX), (q3, -_BOX), (q3, _BOX), (q1, _BOX)]
    boxes = np.stack([np.column_stack([x, at + y]) for x, y in corners], axis=1)
    axes.add_collection(PolyCollection([*boxes], facecolors=TINT, edgecolors=BLUE, linewidths=1))
    for x, end in ((low, q1), (high, q3)):
        axes.hlines(at, x, end, color="black", linewidth=1)
        axes.vlines(x, at - _BOX / 2, at + _BOX / 2, color="black", linewidth=1)
    axes.vlines(middle, at - _BOX, at + _BOX, color="black", linewidth=1.6)
    beyond = [np.asarray(box["fliers"]) for box in found]
    axes.plot(
        np.concatenate(beyond),
        np.repeat(at, [len(each) for each in beyond]),
        "o",
        markerfacecolor="none",
        markersize=3,
        markeredgecolor=GREY,
    )
