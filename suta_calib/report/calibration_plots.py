"""Plots of a calibration as SVG text. Readable in grey, by colour-blind people, and in print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.colors import BoundaryNorm
from matplotlib.ticker import MaxNLocator

from suta_calib.arrays import FloatArray
from suta_calib.plotting.errors import draw_grouped_errors, draw_histogram
from suta_calib.plotting.look import (
    BLUE,
    MOST_CORRELATED,
    MOST_GROUPS,
    MOST_WRITTEN,
    ORANGE,
    ROW_HEIGHT,
    WIDTH,
    Change,
    shortened,
)
from suta_calib.plotting.parameters import draw_changes
from suta_calib.plotting.style import legend_above, plain_log, shades
from suta_calib.report.svg import picture, svg_text
from suta_calib.units import Unit


def histogram_svg(
    before: FloatArray, after: FloatArray, unit: Unit, quantity: str, name: str
) -> str:
    """Histogram of error norms (n,) before and after, m or rad, with their mean and RMS."""
    with picture(name, (WIDTH, 3.2)) as figure:
        draw_histogram(figure.subplots(), before, after, unit, quantity)
        return svg_text(figure, name, f"Histogram of the {quantity} errors before and after")


def groups_svg(groups: Mapping[str, FloatArray], grouping: str, name: str, unit: Unit = "m") -> str:
    """Box plot of errors after calibration, SI: one box a group, worst median first."""
    # Fewer than three boxes have no room for the name of their axis.
    rows = max(min(len(groups), MOST_GROUPS), 3)
    with picture(name, (WIDTH, 0.6 + 1.1 * ROW_HEIGHT * rows)) as figure:
        draw_grouped_errors(figure.subplots(), groups, grouping, unit)
        return svg_text(figure, name, f"Errors after calibration by {grouping}")


def changes_svg(changes: Sequence[Change], name: str) -> str:
    """Change of every estimated parameter from nominal ± one standard deviation."""
    units = [change.unit for change in changes]
    rows = max(map(units.count, units))
    with picture(name, (WIDTH, 1.1 + ROW_HEIGHT * rows)) as figure:
        draw_changes(figure, changes)
        return svg_text(figure, name, "Changes of the parameters from nominal")


def singular_values_svg(
    values: FloatArray, threshold: float, weak: Sequence[str], name: str
) -> str:
    """Singular values (n,), descending, the threshold of what data tell, and what they do not."""
    floor = max(float(values.max(initial=0.0)), 1.0) * 1e-9
    heights = np.maximum(values, floor)
    by_data, numbers = heights >= threshold, np.arange(1, len(values) + 1)
    with picture(name, (WIDTH, 3.0)) as figure:
        axes = figure.subplots()
        plain_log(axes.yaxis, axes.set_yscale)
        for chosen, colour, hatch, label in (
            (by_data, BLUE, "", "determined by the data"),
            (~by_data, ORANGE, "////", "not determined by the data alone"),
        ):
            axes.bar(
                *(numbers[chosen], heights[chosen] - floor / 2, 0.8, floor / 2),
                facecolor="none" if hatch else colour,
                edgecolor=colour,
                hatch=hatch,
                label=f"{label} ({int(chosen.sum())})",
            )
        axes.axhline(threshold, c="black", lw=0.9, ls="--")
        axes.set_ylim(bottom=floor / 2)
        axes.set_xlim(0.3, len(values) + 0.7)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        held = "held: " + ", ".join(weak[:4]) + (" …" if len(weak) > 4 else "") if weak else ""
        what = "combination of the arm's parameters, best determined first"
        axes.set_xlabel(f"{what}\n{shortened(held, 78)}" if held else what)
        axes.set_ylabel("singular value (no unit)")
        legend_above(axes)
        what = "Singular values of the information on the arm's parameters"
        return svg_text(figure, name, what)


def correlations_svg(names: Sequence[str], matrix: FloatArray, name: str) -> str:
    """Heat map of correlations (n, n), their signs written in; of many those that are largest."""
    strongest = np.abs(matrix - np.eye(len(matrix))).max(axis=1, initial=0.0)
    keep = np.sort(np.argsort(-strongest, kind="stable")[:MOST_CORRELATED])
    shown = matrix[np.ix_(keep, keep)]
    # A small map is no smaller than its scale can be read; beside it stand names and scale.
    side = max(0.243 * len(keep), 2.1)
    beside = 0.07 * max(len(names[k]) for k in keep)
    size = min(side + beside + 1.1, WIDTH), min(side + beside + 0.2, WIDTH)
    with picture(name, size) as figure:
        axes = figure.subplots()
        levels = np.linspace(0.0, 1.0, 11)
        mesh = axes.pcolormesh(
            np.abs(shown),
            cmap=shades(),
            norm=BoundaryNorm(levels, 10),
            edgecolors="face",
        )
        for row, column in np.argwhere((np.abs(shown) >= 0.1) & ~np.eye(len(keep), dtype=bool)):
            value = shown[row, column]
            text = f"{value:+.1f}" if len(keep) <= MOST_WRITTEN else f"{value:+.0f}"[0]
            look: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 6}
            look["color"] = "white" if abs(value) > 0.5 else "black"
            axes.text(column + 0.5, row + 0.5, text.replace("-", "−"), **look)
        at = np.arange(len(keep)) + 0.5
        axes.set_xticks(at, [names[k] for k in keep], fontsize=7, rotation=90)
        axes.set_yticks(at, [names[k] for k in keep], fontsize=7)
        axes.invert_yaxis()
        axes.set_aspect("equal")
        bar = figure.colorbar(mesh, ax=axes, ticks=levels[::2], aspect=16, shrink=0.9)
        bar.set_label("size of the correlation (no unit)")
        return svg_text(figure, name, "Correlations of the estimated parameters")
