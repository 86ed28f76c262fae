"""Heat maps of the four metrics: over the artefact, or group by group."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from suta_calib.analysis.outliers import METRICS, Level, Metric, Outliers, TermOutliers
from suta_calib.analysis.outliers.judgement import GROUPING_NOUN
from suta_calib.arrays import FloatArray
from suta_calib.report.outliers.json import KEYS
from suta_calib.report.svg import BLUE, GREY, ORANGE, WIDTH, style, svg_text

TITLES: Final[dict[Metric, str]] = {
    "contribution": "Error contribution, %",
    "cooks_distance": "Cook's distance",
    "leave_one_out": "RMS falls when left out by, %",
    "bias": "Bias after registration, mm",
}
# Dark on light: the scale is told by grey as well as by colour.
COLOURS: Final = "cividis_r"
SMALLEST, LARGEST = 30.0, 420.0


def outlier_plots(found: Outliers) -> list[tuple[str, str]]:
    """Title and SVG of one picture for each observation that has groups."""
    plots = []
    for k, term in enumerate(found.terms):
        if not term.levels:
            continue
        name = "outliers" if len(found.terms) == 1 else f"outliers-{k + 1}"
        landmarks = term.level("landmarks")
        if landmarks is not None and term.position is not None:
            svg = _over_artefact(term, landmarks, name)
            plots.append((f"{term.kind}: the metrics over the artefact", svg))
        else:
            level = term.levels[-1]
            svg = _by_group(level, name)
            plots.append((f"{term.kind}: the metrics by {GROUPING_NOUN[level.name]}", svg))
    return plots


def _over_artefact(term: TermOutliers, level: Level, name: str) -> str:
    """One panel a metric: size and shade tell the value, which stands beside the label."""
    assert term.position is not None
    axes = _widest(term.position)
    place = 1e3 * term.position[:, axes]
    with style(name):
        figure = Figure(figsize=(WIDTH * 1.25, WIDTH * 1.25), layout="constrained")
        panels = figure.subplots(2, 2)
        for panel, metric in zip(panels.flat, METRICS, strict=True):
            _map(figure, panel, place, level, metric)
        for panel in panels[-1]:
            panel.set_xlabel(f"artefact's {'xyz'[axes[0]]}, mm")
        for panel in panels[:, 0]:
            panel.set_ylabel(f"artefact's {'xyz'[axes[1]]}, mm")
        return svg_text(figure, name, "The four outlier metrics of every landmark") + "\n"


def _map(figure: Figure, axes: Axes, place: FloatArray, level: Level, metric: Metric) -> None:
    scale = KEYS[metric][1]
    values = scale * np.array([g.values[metric] for g in level.groups])
    limit = scale * level.thresholds[metric]
    shown = np.nan_to_num(np.maximum(values, 0.0))
    top = max(float(shown.max()), limit)
    size = SMALLEST + (LARGEST - SMALLEST) * shown / top
    marks: Any = axes.scatter(
        place[:, 0],
        place[:, 1],
        s=size,
        c=shown,
        cmap=COLOURS,
        vmin=0.0,
        vmax=top,
        edgecolors="black",
        lw=0.6,
    )
    for (x, y), group, value, area in zip(place, level.groups, values, size, strict=True):
        flagged = metric in group.flags
        if flagged:
            axes.plot(x, y, "s", mfc="none", mec="black", mew=1.8, ms=np.sqrt(area) + 7)
        axes.annotate(
            f"{group.label} {value:.3g}{' !' if flagged else ''}",
            (x, y),
            (0, -4 - np.sqrt(area) / 2),
            textcoords="offset points",
            ha="center",
            va="top",
            fontsize=7,
            fontweight="bold" if flagged else "normal",
        )
    axes.set_title(TITLES[metric])
    centre = (place.max(axis=0) + place.min(axis=0)) / 2
    half = 0.62 * float(np.ptp(place, axis=0).max())
    axes.set_xlim(centre[0] - half, centre[0] + half)
    axes.set_ylim(centre[1] - half, centre[1] + half)
    axes.set_aspect("equal")
    axes.grid()
    bar = figure.colorbar(marks, ax=axes, shrink=0.8)
    bar.ax.axhline(limit, color="black", lw=1.5, ls="--")
    bar.ax.set_title("- - threshold", fontsize=6, fontweight="normal", loc="center")


def _by_group(level: Level, name: str) -> str:
    """One panel a metric, groups in the order of the file, with the threshold."""
    with style(name):
        figure = Figure(figsize=(WIDTH * 1.25, 6.4), layout="constrained")
        for panel, metric in zip(figure.subplots(2, 2).flat, METRICS, strict=True):
            _stems(panel, level, metric)
        return svg_text(figure, name, f"The four outlier metrics of every {level.name[:-1]}") + "\n"


def _stems(axes: Axes, level: Level, metric: Metric) -> None:
    scale = KEYS[metric][1]
    values = scale * np.array([g.values[metric] for g in level.groups])
    flagged = np.array([metric in g.flags for g in level.groups])
    number = np.arange(1, len(values) + 1)
    axes.vlines(number, 0.0, values, color=GREY, lw=0.8)
    axes.plot(number, values, "o", color=BLUE, ms=3.0)
    axes.plot(number[flagged], values[flagged], "s", mfc=ORANGE, mec="black", ms=6.0)
    for k in np.flatnonzero(flagged):
        axes.annotate(
            level.groups[k].label,
            (number[k], values[k]),
            (4, 4),
            textcoords="offset points",
            fontsize=7,
        )
    limit = scale * level.thresholds[metric]
    axes.axhline(limit, color="black", lw=1.0, ls="--")
    axes.annotate(
        "threshold", (1.0, limit), xycoords=("axes fraction", "data"), fontsize=6, ha="right"
    )
    title = TITLES[metric] if metric != "bias" else "RMS residual, mm"
    axes.set_title(title)
    axes.set_xlabel(f"{GROUPING_NOUN[level.name]}, in the order of the files")
    axes.margins(y=0.15)
    if not np.any(values < 0):
        axes.set_ylim(bottom=0)
    axes.grid(axis="y")


def _widest(position: FloatArray) -> list[int]:
    """The two axes along which the landmarks spread most, in the artefact's order."""
    return sorted(np.argsort(-np.ptp(position, axis=0), kind="stable")[:2].tolist())
