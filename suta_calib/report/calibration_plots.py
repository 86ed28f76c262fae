"""Plots of a calibration as SVG text. Readable in grey, by colour-blind people, and in print."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import BoundaryNorm
from matplotlib.ticker import MaxNLocator

from suta_calib.arrays import FloatArray
from suta_calib.plotting.change import Change
from suta_calib.plotting.errors import draw_groups, draw_histogram
from suta_calib.plotting.limits import MOST_CORRELATED, MOST_GROUPS, MOST_WRITTEN
from suta_calib.plotting.parameters import MOST_LETTERS, draw_changes
from suta_calib.plotting.style import BLUE, ORANGE, ROW_HEIGHT, WIDTH, plain_log, shortened
from suta_calib.report.svg import Margins, picture, svg_text, width_of
from suta_calib.units import Unit

# Height of the smallest map of correlations, inch: its scale has to be read.
_LEAST_BAR: Final = 2.4


def error_histogram(
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
    with picture(name, (WIDTH, 3.0), Margins(top=0.6)) as figure:
        draw_histogram(figure.subplots(), before, after, unit, quantity)
        return svg_text(figure, name, f"Histogram of the {quantity} errors before and after")


def grouped_errors(groups: Mapping[str, FloatArray], grouping: str, name: str) -> str:
    """Box plot of the errors after calibration, one box a group, worst median first; mm.

    Args:
        groups: errors, m, by the group's name; not empty.
        grouping: what the groups are, e.g. ``landmark``.
        name: id of the plot on its page.
    """
    labels = [f"{shortened(each)}  (9999)" for each in groups]
    size = WIDTH, 0.6 + 0.21 * min(len(groups), MOST_GROUPS)
    with picture(name, size, Margins(left=0.5 + width_of(labels, 9))) as figure:
        draw_groups(figure.subplots(), groups, grouping)
        return svg_text(figure, name, f"Errors after calibration by {grouping}")


def singular_values(values: FloatArray, threshold: float, weak: Sequence[str], name: str) -> str:
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
    with picture(name, (WIDTH, 2.8), Margins(bottom=0.72 if weak else 0.52, top=0.28)) as figure:
        axes = figure.subplots()
        k = np.arange(1, len(values) + 1)
        bottom = floor / 2
        kinds = (
            (estimated, BLUE, "", "told by the data"),
            (~estimated, ORANGE, "////", "not told by the data alone"),
        )
        for chosen, colour, hatch, label in kinds:
            axes.bar(
                *(k[chosen], height[chosen] - bottom),
                bottom=bottom,
                color=colour if not hatch else "white",
                edgecolor=colour,
                hatch=hatch,
                label=f"{label} ({int(chosen.sum())})",
            )
        axes.axhline(threshold, color="black", linewidth=0.9, linestyle="--")
        plain_log(axes.yaxis, axes.set_yscale)
        axes.set_ylim(bottom=bottom)
        axes.set_xlim(0.3, len(values) + 0.7)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlabel("direction of the arm's parameters, strongest first")
        axes.set_ylabel("singular value (no unit)")
        axes.legend(ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1))
        if weak:
            note = "held: " + ", ".join(weak[:4]) + (" …" if len(weak) > 4 else "")
            figure.text(0.01, 0.02, shortened(note, 78), fontsize=8)
        return svg_text(figure, name, "Singular values of the information on the arm's parameters")


def correlation_map(names: Sequence[str], matrix: FloatArray, name: str) -> str:
    """Heat map of the size of the correlations, their signs written in; dimensionless.

    Args:
        names: (n,) parameters.
        matrix: (n, n) correlations; where there are too many, those most correlated are shown.
        name: id of the plot on its page.
    """
    strongest = np.abs(matrix - np.eye(len(matrix))).max(axis=1, initial=0.0)
    keep = np.sort(np.argsort(-strongest, kind="stable")[:MOST_CORRELATED])
    shown_names, part = [names[k] for k in keep], matrix[np.ix_(keep, keep)]
    side, beside = 0.24 * len(keep), width_of(shown_names, 7) + 0.15
    margins = Margins(beside, 0.95, beside, 0.1)
    size = beside + max(side, _LEAST_BAR) + 0.95, beside + max(side, _LEAST_BAR) + 0.1
    with picture(name, size, margins) as figure:
        axes = figure.subplots()
        # Cells and ten shades instead of an image: sharp at every size, and no embedded bitmap.
        image = axes.pcolormesh(
            np.arange(len(keep) + 1) - 0.5,
            np.arange(len(keep) + 1) - 0.5,
            np.abs(part),
            norm=BoundaryNorm(np.linspace(0.0, 1.0 + 1e-9, 11), 10),
            cmap=colormaps["Blues"].resampled(10),
        )
        axes.set_aspect("equal")
        axes.invert_yaxis()
        ticks = range(len(keep))
        axes.set_xticks(ticks, shown_names, rotation=90, fontsize=7)
        axes.set_yticks(ticks, shown_names, fontsize=7)
        for i, j in np.argwhere((np.abs(part) >= 0.1) & ~np.eye(len(part), dtype=bool)):
            value = float(part[i, j])
            sign = f"{value:+.1f}" if len(part) <= MOST_WRITTEN else ("+" if value > 0 else "−")
            look: dict[str, Any] = {
                "color": "white" if abs(value) > 0.5 else "black",
                "fontsize": 6,
            }
            axes.text(j, i, sign, ha="center", va="center", in_layout=False, **look)
        scale = figure.add_axes((1 - 0.8 / size[0], margins.bottom / size[1], 0.14 / size[0], 0.7))
        bar = figure.colorbar(image, cax=scale, format="%.1f")
        bar.set_label("size of the correlation (no unit)")
        return svg_text(figure, name, "Correlations of the estimated parameters")


def parameter_changes(changes: Sequence[Change], name: str) -> str:
    """Change of every estimated parameter from nominal with ± one standard deviation; mm and deg.

    Args:
        changes: at least one.
        name: id of the plot on its page.
    """
    panels = Counter(each.unit for each in changes)
    names = width_of((shortened(each.name, MOST_LETTERS) for each in changes), 7) + 0.15
    size = WIDTH, 0.8 + ROW_HEIGHT * max(panels.values())
    margins = Margins(left=names, top=0.28, between=names + 0.15)
    with picture(name, size, margins, len(panels)) as figure:
        draw_changes(figure, changes)
        return svg_text(figure, name, "Changes of the parameters from nominal")
