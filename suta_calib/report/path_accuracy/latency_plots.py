"""A picture of how long poses took from the frame's arrival to publication."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from suta_calib.report.svg import BLUE, GREY, ORANGE, WIDTH, plain_log, style, svg_text
from suta_calib.tracking.latency import LatencyStatistics

MS: Final = 1e3
_COLOURS: Final = (BLUE, ORANGE, "black", GREY)


def latency_figure(found: Mapping[str, LatencyStatistics], target_ms: float | None = None) -> str:
    """An SVG document: histograms on logarithmic axes, with the 99th percentiles.

    Args:
        found: latencies by the name of what was run.
        target_ms: a limit to draw.
    """
    with style("latency"):
        figure = Figure(figsize=(WIDTH, 3.4), layout="constrained")
        axes = figure.subplots()
        for (name, each), colour in zip(found.items(), _COLOURS, strict=False):
            edges, counts = each.histogram()
            p99 = MS * each.percentile(99)
            label = f"{name}: p50 {MS * each.percentile(50):.3g}, p99 {p99:.3g}, max "
            axes.stairs(
                np.maximum(counts, 0.5),
                MS * edges,
                color=colour,
                baseline=0.5,
                label=f"{label}{MS * each.maximum:.3g} ms ({each.count} poses)",
            )
            axes.axvline(p99, color=colour, lw=0.9, ls=":")
        if target_ms is not None:
            axes.axvline(target_ms, color=GREY, lw=1.2, ls="--")
        plain_log(axes.xaxis, axes.set_xscale)
        plain_log(axes.yaxis, axes.set_yscale)
        axes.set_title(
            "From the frame's last byte to publication (dotted: p99)", pad=12 + 11 * len(found)
        )
        axes.set_xlabel("latency, ms")
        axes.set_ylabel("poses per 2 % bin")
        axes.grid()
        axes.legend(fontsize=8, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)
        return svg_text(figure, "latency", "Histogram of the latency of published poses") + "\n"
