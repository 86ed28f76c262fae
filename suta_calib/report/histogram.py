"""Histograms of errors before and after, as in accuracy reports of measuring arms."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from suta_calib.arrays import FloatArray
from suta_calib.diagnostics.accuracy import Metrics
from suta_calib.report.errors_by import KindErrors
from suta_calib.report.svg import BLUE, ORANGE, WIDTH, plain_log, shown_array, style, svg_text
from suta_calib.units import unit_name

# Two histograms whose medians differ by more than this are both visible only on a log axis.
FAR_APART: Final = 4.0


def error_histogram(errors: KindErrors, name: str) -> str:
    """Histogram of the error norms before and after, with mean and RMS; mm or deg.

    Args:
        errors: of one kind and quantity, at least one.
        name: id of the plot on its page.
    """
    before = np.abs(shown_array(errors.before, errors.unit))
    after = np.abs(shown_array(errors.after, errors.unit))
    unit = unit_name(errors.unit)
    with style(name):
        figure = Figure(figsize=(WIDTH, 3.0), layout="constrained")
        axes = figure.subplots()
        bins, logarithmic = _bins(before, after)
        _histogram(axes, before, bins, ("before", ORANGE, "////", ":"), unit)
        _histogram(axes, after, bins, ("after", BLUE, "", "--"), unit)
        if logarithmic:
            plain_log(axes.xaxis, axes.set_xscale)
        lowest = f" (the first bar: {bins[1]:.2g} and less)" if logarithmic else ""
        axes.set_xlabel(f"{errors.name} error, {unit}{lowest}")
        axes.set_ylabel("number of errors")
        axes.legend(ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1))
        return svg_text(figure, name, f"Histogram of the {errors.name} errors before and after")


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


def _histogram(
    axes: Axes, errors: FloatArray, bins: FloatArray, look: tuple[str, str, str, str], unit: str
) -> None:
    label, colour, hatch, line = look
    filling: dict[str, Any] = {"facecolor": "none" if hatch else colour, "hatch": hatch}
    m = Metrics.of(errors)
    inside = np.clip(errors, bins[0], bins[-1])
    axes.hist(
        inside, bins=list(bins), edgecolor=colour, label=label, zorder=2 + bool(hatch), **filling
    )
    axes.axvline(
        m.rms, color="black", linestyle=line, linewidth=1.2, label=f"RMS {label} {m.rms:.3g} {unit}"
    )
    axes.plot(
        *(m.mean, 0.0, "^"),
        color=colour,
        markeredgecolor="black",
        markersize=7,
        clip_on=False,
        label=f"mean {label} {m.mean:.3g} {unit}",
    )
