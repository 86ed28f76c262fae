"""Pictures of how a recorded motion follows a reference."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from suta_calib.arrays import FloatArray
from suta_calib.report.svg import BLUE, GREY, ORANGE, WIDTH, shown_array, style, svg_text
from suta_calib.tracking.path_accuracy import PathAccuracy
from suta_calib.units import unit_name

MM: Final = 1e3
MS: Final = 1e3
LARGE: Final = 1.3 * WIDTH
_MOST_POINTS: Final = 2000


def dynamics_figure(found: PathAccuracy) -> str:
    """An SVG document: error over time, distance by latency, and what happens at reversals."""
    with style("dynamics"):
        figure = Figure(figsize=(LARGE, 5.6), layout="constrained")
        below = ["latency", "reversals"] + ["hysteresis"] * (found.per == "joint")
        layout: Any = [["time"] * len(below), below]
        panels = figure.subplot_mosaic(layout)
        _over_time(panels["time"], found)
        _by_latency(panels["latency"], found)
        _at_reversals(panels["reversals"], found)
        if found.per == "joint":
            _hysteresis(panels["hysteresis"], found)
        description = "Dynamic accuracy: error over time, by latency, and at reversals"
        return svg_text(figure, "dynamics", description) + "\n"


def _over_time(axes: Axes, found: PathAccuracy) -> None:
    for error, colour, label in (
        (found.error_same_time, ORANGE, "at the same time"),
        (found.error, BLUE, "latency removed"),
    ):
        time, size = _thinned(found.time, MM * np.linalg.norm(error, axis=1))
        axes.plot(time, size, color=colour, lw=0.9, label=label)
    axes.set_ylim(bottom=0)
    axes.set_title("Distance from the reference", pad=24)
    axes.set_xlabel("time, s")
    axes.set_ylabel("distance, mm")
    axes.grid(axis="y")
    axes.legend(ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)


def _by_latency(axes: Axes, found: PathAccuracy) -> None:
    alignment = found.alignment
    axes.plot(MS * alignment.shifts, MM * alignment.rms, color=BLUE, lw=1.2)
    axes.axvline(MS * alignment.latency, color=GREY, lw=1.2, ls="--")
    axes.set_ylim(bottom=0)
    axes.set_title(
        f"Latency {MS * alignment.latency:.3f} ± {MS * alignment.latency_std:.3f} ms", pad=24
    )
    axes.set_xlabel("latency taken out, ms")
    axes.set_ylabel("RMS distance, mm")
    axes.grid()


def _at_reversals(axes: Axes, found: PathAccuracy) -> None:
    for shift, colour, mark, what in (
        (-0.2, BLUE, "o", "before"),
        (0.0, ORANGE, "s", "after"),
        (0.2, "black", "D", "jump"),
    ):
        values = [
            each.jump if what == "jump" else getattr(each, f"error_{what}")
            for each in found.reversals
        ]
        places = np.arange(len(values)) + shift
        axes.plot(places, MM * np.array(values), mark, color=colour, ms=4.5, label=what)
    axes.margins(y=0.1)
    axes.set_ylim(bottom=0)
    axes.set_title("Error of the tip where it turns back", pad=24)
    axes.set_ylabel("RMS, mm")
    axes.legend(ncols=3, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)
    _name(axes, found)


def _hysteresis(axes: Axes, found: PathAccuracy) -> None:
    """Each joint's hysteresis with twice its standard uncertainty, in mm for one that slides."""
    for k, each in enumerate(found.reversals):
        pair = found.hysteresis.get(each.channel.name)
        if pair is not None:
            size, std = shown_array(np.array(pair), each.channel.unit)
            axes.errorbar(k, size, 2 * std, fmt="o", color=BLUE, ms=5, capsize=4)
    axes.axhline(0, color=GREY, lw=0.8)
    units = {unit_name(each.channel.unit) for each in found.reversals}
    axes.set_title("Hysteresis (bars: 2 std)", pad=24)
    axes.set_ylabel(f"hysteresis, {' or '.join(sorted(units))}")
    _name(axes, found)


def _name(axes: Axes, found: PathAccuracy) -> None:
    names = [each.channel.name for each in found.reversals]
    axes.set_xticks(range(len(names)), names)
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.tick_params(axis="x", labelrotation=45 if len(names) > 3 else 0)
    axes.grid(axis="y")


def _thinned(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The largest of every few rows, so that no peak is lost and the file stays small."""
    step = max(1, len(time) // _MOST_POINTS)
    rows = len(time) // step * step
    return time[:rows:step], values[:rows].reshape(-1, step).max(axis=1)
