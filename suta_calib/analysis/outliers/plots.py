"""The four outlier metrics of one observation: over the artefact, or group by group."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from suta_calib.analysis.outliers.answer import (
    GROUPING_NOUN,
    METRICS,
    Level,
    Metric,
    TermOutliers,
)
from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.plotting.chart import Axis, Chart, Lines, Points, Words, ends
from suta_calib.plotting.look import BLACK, BLUE, GREY, ORANGE, shade
from suta_calib.units import Unit, mm, shown, unit_name

# Unit of each metric, the head of its column, and the title of its plot.
TOLD: Final[dict[Metric, tuple[Unit, str, str]]] = {
    "contribution": ("%", "share %", "Error contribution, %"),
    "cooks_distance": ("1", "Cook", "Cook's distance"),
    "leave_one_out": ("%", "l.o.o. %", "RMS falls when left out by, %"),
    "bias": ("m", "bias mm", "Bias after registration, mm"),
}


def told(metric: Metric, unit: Unit) -> tuple[Unit, str, str]:
    """`TOLD`, where touches are off by angles or other numbers than lengths."""
    if metric != "bias":
        return TOLD[metric]
    name = unit_name(unit)
    return unit, f"bias {name}".rstrip(), f"Bias after registration, {name}".rstrip(", ")


# Points: how high a panel is; how large its marks are, and how far below them words stand.
PANEL: Final = 190.0
SMALLEST, LARGEST = 5.5, 20.5
BELOW: Final = 8.0
# Of what landmarks span, half the width that a map of them shows.
SHOWN: Final = 0.66


def draw_metrics(figure: Any, term: TermOutliers) -> list[Any]:
    """Draw `metric_charts` in an empty `Figure` or `SubFigure`; returns the panels' `Axes`."""
    from suta_calib.plotting.on_axes import draw_chart

    panels: list[Any] = list(figure.subplots(2, 2).flat)
    for axes, chart in zip(panels, metric_charts(term), strict=True):
        draw_chart(axes, chart)
    return panels


def metric_charts(term: TermOutliers) -> list[Chart]:
    """Four panels, one a metric, with the threshold of each.

    Where landmarks are known, size and shade tell the value at each, which stands below it with
    its label; else groups stand in the order of the files.

    Args:
        term: an observation that has groups.
    """
    landmarks = term.level("landmarks")
    if landmarks is not None and term.position is not None:
        return [_map(mm(term.position), landmarks, metric) for metric in METRICS]
    return [_stems(term.levels[-1], metric, term.unit) for metric in METRICS]


def _values(level: Level, metric: Metric, unit: Unit) -> tuple[FloatArray, float, BoolArray]:
    """The metric of every group, and its threshold, as they are shown; and who is flagged."""
    unit = told(metric, unit)[0]
    values = shown(np.array([g.values[metric] for g in level.groups]), unit)
    flagged = np.array([metric in g.flags for g in level.groups])
    return values, shown(level.thresholds[metric], unit), flagged


def _map(position: FloatArray, level: Level, metric: Metric) -> Chart:
    values, limit, flagged = _values(level, metric, "m")
    # The two axes along which the landmarks spread most, in the artefact's order.
    chosen = sorted(np.argsort(-np.ptp(position, axis=0), kind="stable")[:2].tolist())
    x, y = position[:, chosen].T
    drawn = np.nan_to_num(np.maximum(values, 0.0))
    share = drawn / max(float(drawn.max()), limit)
    # Areas tell values.
    size = np.sqrt(SMALLEST**2 + (LARGEST**2 - SMALLEST**2) * share)
    half = SHOWN * float(np.ptp(position[:, chosen], axis=0).max())
    below = y - (size / 2 + BELOW) * 2 * half / PANEL
    texts = [
        f"{group.label} {value:.3g}{' !' * bool(flag)}"
        for group, value, flag in zip(level.groups, values, flagged, strict=True)
    ]
    across, up = (
        Axis(f"artefact's {'xyz'[axis]}, mm", middle - half, middle + half, grid=True)
        for axis, middle in zip(chosen, ((v.max() + v.min()) / 2 for v in (x, y)), strict=True)
    )
    marks = (
        Points(x, y, size, fill=[shade(each) for each in share.tolist()]),
        Points(x[flagged], y[flagged], size[flagged] + 7.0, "square"),
        Words(x, below, texts, [BLACK] * len(texts), size=7.0, haloed=True),
    )
    title = f"{TOLD[metric][2]}\nflagged (!) beyond {limit:.3g}"
    return Chart(marks, across, up, title=title, equal=True)


def _stems(level: Level, metric: Metric, unit: Unit) -> Chart:
    values, limit, flagged = _values(level, metric, unit)
    number = np.arange(1.0, len(values) + 1)
    known = np.isfinite(values)
    n, height = number[known], values[known]
    low, high = ends(np.array([*height, limit, 0.0]))
    named, everywhere = np.flatnonzero(flagged & known), np.array([[-np.inf, np.inf]])
    marks = (
        Lines(np.stack([n, n], axis=1), np.stack([0.0 * n, height], axis=1), 0.8, GREY),
        Points(n, height, 3.0, fill=BLUE, edge=BLUE),
        Points(number[named], values[named], 6.0, "square", ORANGE),
        Words(
            number[named],
            values[named] + BELOW * (high - low) / PANEL,
            [level.groups[k].label for k in named],
            [BLACK] * len(named),
            size=7.0,
            haloed=True,
        ),
        Lines(everywhere, np.full((1, 2), limit), dash="dashed", label="threshold"),
    )
    below = f"{GROUPING_NOUN[level.name]}, in the order of the files"
    title = TOLD[metric][2] if metric != "bias" else f"RMS residual, {unit_name(unit)}"
    return Chart(
        marks,
        Axis(below, 0.0, len(values) + 1.0, whole=True),
        Axis("", 0.0 if height.min(initial=0.0) >= 0.0 else low, high, grid=True),
        title=title,
    )
