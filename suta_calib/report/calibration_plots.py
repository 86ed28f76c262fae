"""Plots of a calibration as SVG text. Readable in grey, by colour-blind people, and in print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.plotting.change import Change
from suta_calib.plotting.chart import Axis, Boxes, Chart, Lines, Mark, Words, ends
from suta_calib.plotting.errors import error_histogram, grouped_errors
from suta_calib.plotting.limits import MOST_CORRELATED, MOST_WRITTEN
from suta_calib.plotting.look import (
    BLACK,
    BLUE,
    ORANGE,
    ROW_HEIGHT,
    SHADES,
    WHITE,
    shade,
    shortened,
)
from suta_calib.plotting.parameters import parameter_changes
from suta_calib.report.chart_svg import chart_svg
from suta_calib.units import Unit

# Points: heights of panels, of a row of boxes and of few of them; of a cell of a map, which is no
# smaller than its scale can be read; how wide that scale is.
_HISTOGRAM: Final = 135.0
_BARS: Final = 144.0
_BOX_ROW: Final = 15.0
_LEAST_BOXES: Final = 50.0
_CELL: Final = 17.5
_LEAST_MAP: Final = 150.0
_SCALE: Final = 11.0


def histogram_svg(
    before: FloatArray, after: FloatArray, unit: Unit, quantity: str, name: str
) -> str:
    """Histogram of the error norms before and after, with mean and RMS; mm or deg.

    Args:
        before: (n,) error norms with the nominal arm, at least one, m or rad.
        after: (n,) the same with the calibrated one.
        unit: m or rad.
        quantity: what errs, e.g. ``distance``.
        name: id of the plot on its page.
    """
    chart = error_histogram(before, after, unit, quantity)
    description = f"Histogram of the {quantity} errors before and after"
    return chart_svg([chart], name, description, _HISTOGRAM)


def groups_svg(groups: Mapping[str, FloatArray], grouping: str, name: str, unit: Unit = "m") -> str:
    """Box plot of the errors after calibration, one box a group, worst median first.

    Args:
        groups: errors, in SI, by the group's name; not empty.
        grouping: what the groups are, e.g. ``landmark``.
        name: id of the plot on its page.
        unit: SI unit of the errors.
    """
    chart = grouped_errors(groups, grouping, unit)
    height = max(_BOX_ROW * (chart.y.first - chart.y.last), _LEAST_BOXES)
    return chart_svg([chart], name, f"Errors after calibration by {grouping}", height)


def changes_svg(changes: Sequence[Change], name: str) -> str:
    """Change of every estimated parameter from nominal with ± one standard deviation; mm and deg.

    Args:
        changes: at least one.
        name: id of the plot on its page.
    """
    charts = parameter_changes(changes)
    # A panel of fewer parameters is as high as the others: so are its rows.
    height = 72.0 * ROW_HEIGHT * max(chart.y.first - chart.y.last for chart in charts)
    return chart_svg(charts, name, "Changes of the parameters from nominal", height)


def singular_values_svg(
    values: FloatArray, threshold: float, weak: Sequence[str], name: str
) -> str:
    """Singular values on a log axis, and the threshold below which the data alone do not tell.

    Args:
        values: (n,) descending, dimensionless.
        threshold: below it the data alone do not tell.
        weak: the directions that were held, by name.
        name: id of the plot on its page.
    """
    floor = max(float(values.max(initial=0.0)), 1.0) * 1e-9
    height = np.maximum(values, floor)
    estimated = height >= threshold
    k = np.arange(1.0, len(values) + 1)
    bottom = floor / 2
    marks: list[Mark] = [
        Boxes(
            *(k[chosen] - 0.4, k[chosen] + 0.4, np.full(chosen.sum(), bottom), height[chosen]),
            fill="" if hatched else colour,
            edge=colour,
            hatched=hatched,
            label=f"{label} ({int(chosen.sum())})",
        )
        for chosen, colour, hatched, label in (
            (estimated, BLUE, False, "told by the data"),
            (~estimated, ORANGE, True, "not told by the data alone"),
        )
    ]
    everywhere = np.array([[-np.inf, np.inf]])
    marks.append(Lines(everywhere, np.full((1, 2), threshold), 0.9, dash="dashed"))
    top = ends(np.array([*height, threshold]), log=True, least=bottom)[1]
    chart = Chart(
        marks,
        Axis(
            "direction of the arm's parameters, strongest first",
            *(0.3, len(values) + 0.7),
            whole=True,
        ),
        Axis("singular value (no unit)", bottom, top, log=True),
    )
    note = "held: " + ", ".join(weak[:4]) + (" …" if len(weak) > 4 else "") if weak else ""
    description = "Singular values of the information on the arm's parameters"
    return chart_svg([chart], name, description, _BARS, note=shortened(note, 78))


def correlations_svg(names: Sequence[str], matrix: FloatArray, name: str) -> str:
    """Heat map of the size of the correlations, their signs written in; dimensionless.

    Args:
        names: (n,) parameters.
        matrix: (n, n) correlations; where there are too many, those most correlated are shown.
        name: id of the plot on its page.
    """
    strongest = np.abs(matrix - np.eye(len(matrix))).max(axis=1, initial=0.0)
    keep = np.sort(np.argsort(-strongest, kind="stable")[:MOST_CORRELATED])
    part = matrix[np.ix_(keep, keep)]
    row, column = (each.ravel().astype(float) for each in np.indices(part.shape))
    value = part.ravel()
    written = (np.abs(value) >= 0.1) & (row != column)
    texts = [
        f"{v:+.1f}".replace("-", "−") if len(keep) <= MOST_WRITTEN else ("+" if v > 0 else "−")
        for v in value[written]
    ]
    colours = [WHITE if abs(v) > 0.5 else BLACK for v in value[written]]
    at = [(float(k), names[j]) for k, j in enumerate(keep)]
    last = len(keep) - 0.5
    cells = Chart(
        [
            Boxes(column - 0.5, column + 0.5, row - 0.5, row + 0.5, [*map(shade, np.abs(value))]),
            Words(column[written], row[written], texts, colours),
        ],
        Axis("", -0.5, last, names=at, size=7.0),
        Axis("", last, -0.5, names=at, size=7.0),
    )
    sizes = np.arange(len(SHADES)) / len(SHADES)
    nothing, one = np.zeros(len(sizes)), np.ones(len(sizes))
    scale = Chart(
        [Boxes(nothing, one, sizes, sizes + 1.0 / len(sizes), SHADES)],
        Axis("", 0.0, 1.0, names=[]),
        Axis(
            "size of the correlation (no unit)",
            *(0.0, 1.0),
            names=[(each, f"{each:.1f}") for each in np.linspace(0.0, 1.0, 6)],
        ),
    )
    side = max(_CELL * len(keep), _LEAST_MAP)
    description = "Correlations of the estimated parameters"
    return chart_svg([cells, scale], name, description, side, [side, _SCALE])
