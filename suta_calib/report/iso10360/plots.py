"""Pictures of an acceptance test: errors against their limits."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from suta_calib.analysis.iso10360 import AcceptanceTest, LengthErrors
from suta_calib.geometry import FloatArray
from suta_calib.report.svg import BLUE, GREY, ORANGE, WIDTH, style, svg_text

MM: Final = 1e3
LARGE: Final = 1.3 * WIDTH
# Room for a legend of two rows between a title and its axes, pt.
_ABOVE: Final = 30
NAME: Final = "iso10360"
_LOOKS: Final = ((BLUE, "o"), (ORANGE, "s"), ("black", "D"), (GREY, "^"), (BLUE, "P"))


def acceptance_plot(found: AcceptanceTest) -> str:
    """An SVG: errors of lengths by length, deviations of places below."""
    name = f"{NAME}_errors"
    measured = found.measured
    below = [
        key
        for key, given in (("articulations", measured.articulations), ("spheres", measured.spheres))
        if given
    ]
    rows: Any = [["lengths"] * max(1, len(below))] if measured.lengths is not None else []
    rows += [below] if below else []
    rows = rows or [["repeats"]]
    with style(name):
        figure = Figure(figsize=(LARGE, 3.1 * len(rows)), layout="constrained")
        panels = figure.subplot_mosaic(rows)
        if measured.lengths is not None:
            _lengths(panels["lengths"], found, measured.lengths)
        if measured.articulations:
            _articulations(panels["articulations"], found)
        if measured.spheres:
            _spheres(panels["spheres"], found)
        if "repeats" in panels:
            _repeats(panels["repeats"], found)
        return svg_text(figure, name, "Errors of the acceptance test against their limits, mm")


def _lengths(axes: Axes, found: AcceptanceTest, lengths: LengthErrors) -> None:
    for k, (placement, rows) in enumerate(lengths.by_placement()):
        colour, marker = _LOOKS[k % len(_LOOKS)]
        places = MM * lengths.length[rows], MM * lengths.error[rows]
        axes.plot(*places, marker, color=colour, ms=3, mew=0.7, mfc="none", label=placement)
    _length_limits(axes, found, lengths)
    axes.axhline(0, color=GREY, lw=0.8)
    axes.set_title("Errors of length, one mark for every pair of landmarks")
    axes.set_xlabel("calibrated length, mm")
    axes.set_ylabel("measured − calibrated, mm")
    axes.grid(axis="y")
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5), borderaxespad=0.3)


def _length_limits(axes: Axes, found: AcceptanceTest, lengths: LengthErrors) -> None:
    """The limit, and on either side of it the band in which nothing is proved."""
    if found.limits.length is None:
        return
    order = np.argsort(lengths.length)
    length = lengths.length[order]
    limit = found.limits.length.at(length)
    guard = found.rule.guard(found.length_expanded[order])
    for sign in (1, -1):
        axes.plot(
            MM * length, sign * MM * limit, "k--", lw=1.2, label="limit" if sign > 0 else None
        )
        if guard.any():
            axes.fill_between(
                MM * length,
                sign * MM * (limit - guard),
                sign * MM * (limit + guard),
                color=GREY,
                alpha=0.35,
                lw=0,
                label="undecided" if sign > 0 else None,
            )


def _articulations(axes: Axes, found: AcceptanceTest) -> None:
    start = 1
    ticks: list[str] = []
    for k, each in enumerate(found.measured.articulations):
        colour, marker = _LOOKS[k % len(_LOOKS)]
        places = np.arange(start, start + len(each.names))
        label = f"{each.point} (L_Dia {MM * each.diameter:.3f})"
        axes.plot(places, MM * each.deviations, marker, color=colour, ms=5, mfc="none", label=label)
        start += len(each.names)
        ticks += each.names
    _limit_line(axes, found.limits.location, 0.5, "half the limit")
    if len(ticks) <= 12:
        axes.set_xticks(range(1, start), ticks, rotation=45, ha="right")
    else:
        axes.set_xlabel("articulation, in order")
    axes.set_title("Distance to the mean place", pad=_ABOVE)
    axes.set_ylabel("mm")
    _finish(axes)


def _spheres(axes: Axes, found: AcceptanceTest) -> None:
    for k, each in enumerate(found.measured.spheres):
        colour, marker = _LOOKS[k % len(_LOOKS)]
        touches = np.arange(1, len(each.radial) + 1)
        label = f"{each.sphere} (size {MM * each.size:+.3f}, form {MM * each.form:.3f})"
        axes.plot(touches, MM * each.radial, marker, color=colour, ms=4, mfc="none", label=label)
    axes.axhline(0, color=GREY, lw=0.8)
    axes.set_title("Distance to the fitted sphere", pad=_ABOVE)
    axes.set_xlabel("touch, in order")
    axes.set_ylabel("mm")
    axes.grid(axis="y")
    _legend_above(axes)


def _repeats(axes: Axes, found: AcceptanceTest) -> None:
    sizes: FloatArray = np.array([each.diameter for each in found.measured.repeats])
    names = [each.point for each in found.measured.repeats]
    axes.bar(names, MM * sizes, color=BLUE, hatch="//", edgecolor="white")
    _limit_line(axes, found.limits.repeatability, 1.0, "limit")
    axes.set_title("Smallest sphere that holds the visits", pad=_ABOVE)
    axes.set_ylabel("diameter, mm")
    _finish(axes)


def _limit_line(axes: Axes, limit: float | None, share: float, label: str) -> None:
    if limit is not None:
        axes.axhline(share * MM * limit, color="black", ls="--", lw=1.2, label=label)


def _finish(axes: Axes) -> None:
    axes.margins(y=0.1)
    axes.set_ylim(bottom=0)
    axes.grid(axis="y")
    if axes.get_legend_handles_labels()[0]:
        _legend_above(axes)


def _legend_above(axes: Axes) -> None:
    """Between the title and the axes, where nothing is drawn."""
    axes.legend(
        fontsize=7,
        ncols=2,
        loc="lower left",
        bbox_to_anchor=(0, 1),
        borderaxespad=0.2,
        handletextpad=0.2,
        columnspacing=1.0,
    )
