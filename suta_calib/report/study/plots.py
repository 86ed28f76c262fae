"""Pictures of studies: error by number of sets, and estimates against their prediction."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from suta_calib.analysis.study.sizes import SizeStudy
from suta_calib.analysis.study.spread import ParameterSpread, SpreadStudy
from suta_calib.arrays import FloatArray
from suta_calib.report.svg import BLUE, GREY, ORANGE, WIDTH, style, svg_text

MM: Final = 1e3
# Half-width of a normal distribution's central 95 %, in standard deviations.
TWO_SIDED: Final = 1.96


def size_figure(study: SizeStudy) -> str:
    """An SVG element: mean, scatter and range of the held-out error over the number of sets."""
    with style("study"):
        figure = Figure(figsize=(WIDTH, 4.2), layout="constrained")
        axes = figure.subplots()
        _bands(axes, study)
        _recommendation(axes, study)
        axes.set_title("Error on held-out data by number of sets", pad=38)
        axes.set_xlabel(f"{study.plan.data.sets.unit}s calibrated with")
        axes.set_ylabel("RMS error, mm")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.grid(axis="y")
        axes.legend(ncols=3, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)
        return svg_text(figure, "study", "Held-out error by number of measurement sets")


def spread_figure(study: SpreadStudy, name: str) -> str:
    """An SVG element: the 95 % intervals of the parameters, and the held-out error.

    Args:
        study: a bootstrap or a Monte-Carlo study.
        name: of the picture, unique on the page.
    """
    estimated = {n: p for n, p in study.parameters.items() if np.isfinite(p.ratio)}
    with_errors = study.validation.enough
    with style(name):
        size = (1.3 * WIDTH if with_errors else WIDTH, 1.8 + 0.28 * len(estimated))
        figure = Figure(figsize=size, layout="constrained")
        ratios = (3, 2) if with_errors else (1,)
        first, *others = figure.subplots(1, len(ratios), width_ratios=ratios, squeeze=False)[0]
        _intervals(first, estimated)
        for axes in others:
            _errors(axes, study)
        return svg_text(figure, name, "Scatter of the estimates between trials")


def _bands(axes: Axes, study: SizeStudy) -> None:
    solved = [s for s in study.sizes if len(s.rms)]
    size = np.array([s.size for s in solved])
    mean, low, high = (
        MM * np.array([getattr(s, key) for s in solved]) for key in ("mean", "minimum", "maximum")
    )
    std = MM * np.nan_to_num(np.array([s.std for s in solved]))
    axes.fill_between(
        size, low, high, facecolor="#e8e8e8", edgecolor=GREY, hatch="///", label="range", lw=0.6
    )
    # Where the scatter is lopsided, mean - std is below every error, even below zero.
    lower = np.maximum(mean - std, low)
    axes.fill_between(
        size, lower, mean + std, facecolor="#a9cfe6", edgecolor=BLUE, label="± std", lw=0.6
    )
    axes.plot(size, mean, "o-", color="black", ms=4, lw=1.4, label="mean")
    level = MM * solved[-1].mean * (1 + study.tolerance) if solved else np.nan
    label = f"{100 * study.tolerance:g} % above the mean of {size[-1]}" if solved else ""
    axes.axhline(level, color="black", ls=":", lw=1.0, label=label)


def _recommendation(axes: Axes, study: SizeStudy) -> None:
    chosen = next((s for s in study.sizes if s.size == study.recommended), None)
    if chosen is None or not study.levelled:
        return
    axes.axvline(chosen.size, color=ORANGE, ls="--", lw=1.6, label=f"enough: {chosen.size}")
    axes.plot(chosen.size, MM * chosen.mean, "D", mfc="none", mec="black", mew=1.6, ms=11)


def _intervals(axes: Axes, estimated: dict[str, ParameterSpread]) -> None:
    """95 % of each parameter's trials, in units of the standard deviation predicted."""
    axes.axvspan(
        -TWO_SIDED, TWO_SIDED, facecolor="#e8e8e8", edgecolor=GREY, lw=0.6, label="predicted 95 %"
    )
    places = np.arange(len(estimated))
    rows = [_scaled(p) for p in estimated.values()]
    mean, low, high = np.array(rows).reshape(-1, 3).T
    axes.hlines(places, low, high, color=BLUE, lw=2.2, label="95 % of the trials")
    axes.plot(mean, places, "o", color="black", ms=4, label="mean of the trials")
    off = np.array([not p.as_predicted for p in estimated.values()], dtype=bool)
    if off.any():
        mark: dict[str, Any] = {
            "color": ORANGE,
            "mec": "black",
            "ms": 7,
            "label": "not as predicted",
        }
        axes.plot(high[off], places[off], ">", **mark)
    axes.set_yticks(places, [f"{n}  ×{p.ratio:.2f}" for n, p in estimated.items()])
    axes.set_ylim(len(estimated) - 0.4, -0.6)
    axes.set_title("Estimates, and spread over prediction (×)", pad=38)
    axes.set_xlabel("estimate minus that with all data, in predicted standard deviations")
    axes.grid(axis="x")
    axes.legend(ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)


def _scaled(parameter: ParameterSpread) -> FloatArray:
    numbers = np.array([parameter.spread.mean, *parameter.spread.interval])
    return np.asarray((numbers - parameter.estimate.value) / parameter.predicted)


def _errors(axes: Axes, study: SpreadStudy) -> None:
    axes.hist(
        MM * study.validation.values, bins="auto", facecolor="#a9cfe6", edgecolor=BLUE, lw=0.8
    )
    if np.isfinite(study.full_rms):
        axes.axvline(MM * study.full_rms, color=ORANGE, ls="--", lw=1.8, label="with all data")
        axes.legend(fontsize=8, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)
    axes.set_title("Error on held-out data", pad=38)
    axes.set_xlabel("RMS error, mm")
    axes.set_ylabel("trials")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
