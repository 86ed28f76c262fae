"""Plots of a calibration as SVG text. Readable in grey, by colour-blind people, and in print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cbook import boxplot_stats
from matplotlib.collections import PolyCollection
from matplotlib.colors import BoundaryNorm
from matplotlib.ticker import MaxNLocator

from suta_calib.arrays import FloatArray
from suta_calib.diagnostics.accuracy import Metrics
from suta_calib.report.errors import KindErrors
from suta_calib.report.svg import BLUE, GREY, ORANGE, WIDTH, picture, plain_log, svg_text
from suta_calib.solver.identifiability import WEAK
from suta_calib.solver.solution import Estimate
from suta_calib.units import Unit, shown, unit_name

# Half the height of a box, of which one stands every unit.
_BOX: Final = 0.31
MOST_GROUPS: Final = 30
MOST_CORRELATED: Final = 30
MOST_WRITTEN: Final = 14
# Two histograms whose medians differ by more than this are both visible only on a log axis.
FAR_APART: Final = 4.0


def error_histogram(errors: KindErrors, name: str) -> str:
    """Histogram of the error norms before and after, with mean and RMS; mm or deg.

    Args:
        errors: of one kind and quantity, at least one.
        name: id of the plot on its page.
    """
    before = np.abs(shown(errors.before, errors.unit))
    after = np.abs(shown(errors.after, errors.unit))
    unit = unit_name(errors.unit)
    with picture(name, (WIDTH, 3.0)) as figure:
        axes = figure.subplots()
        bins, logarithmic = _bins(before, after)
        for values, label, colour, hatch, line in (
            (before, "before", ORANGE, "////", ":"),
            (after, "after", BLUE, "", "--"),
        ):
            m, inside = Metrics.of(values), np.clip(values, bins[0], bins[-1])
            look: dict[str, Any] = {
                "facecolor": "none" if hatch else colour,
                "edgecolor": colour,
                "hatch": hatch,
                "linewidth": 1.0,
            }
            count = np.histogram(inside, bins)[0]
            axes.stairs(count, bins, fill=True, label=label, zorder=2 + bool(hatch), **look)
            rms, mean = (
                f"{name} {label} {v:.3g} {unit}" for name, v in (("RMS", m.rms), ("mean", m.mean))
            )
            axes.axvline(m.rms, color="black", linestyle=line, linewidth=1.2, label=rms)
            mark: dict[str, Any] = {"color": colour, "markeredgecolor": "black", "markersize": 7}
            axes.plot(m.mean, 0.0, "^", clip_on=False, label=mean, **mark)
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


def grouped_errors(groups: Mapping[str, FloatArray], grouping: str, name: str) -> str:
    """Box plot of the errors after calibration, one box a group, worst median first; mm.

    Args:
        groups: errors, m, by the group's name; not empty.
        grouping: what the groups are, e.g. ``landmark``.
        name: id of the plot on its page.
    """
    ranked = sorted(groups.items(), key=lambda item: -float(np.median(item[1])))[:MOST_GROUPS]
    errors = [shown(e, "m") for _, e in ranked]
    with picture(name, (WIDTH, 1.0 + 0.21 * len(ranked))) as figure:
        axes = figure.subplots()
        _boxes(axes, errors)
        labels = [_short(f"{n}  ({len(e)})") for n, e in ranked]
        axes.set_yticks(range(1, 1 + len(ranked)), labels=labels)
        axes.set_ylim(len(ranked) + 0.5, 0.5)
        axes.set_xlim(left=0)
        axes.grid(axis="x")
        axes.set_xlabel("error after calibration, mm (in brackets: number of errors)")
        axes.set_ylabel(grouping)
        return svg_text(figure, name, f"Errors after calibration by {grouping}")


def _boxes(axes: Axes, groups: Sequence[FloatArray]) -> None:
    """Lying boxes as Tukey drew them, at 1, 2, …: `Axes.boxplot` with few artists for all.

    Whiskers end at the last errors within one and a half boxes; what is beyond is a point.
    """
    found = boxplot_stats(groups)
    at = np.arange(1.0, len(found) + 1)
    low, q1, middle, q3, high = (
        np.array([float(box[key]) for box in found])
        for key in ("whislo", "q1", "med", "q3", "whishi")
    )
    corners = [(q1, -_BOX), (q3, -_BOX), (q3, _BOX), (q1, _BOX)]
    boxes = np.stack([np.column_stack([x, at + y]) for x, y in corners], axis=1)
    axes.add_collection(
        PolyCollection([*boxes], facecolors="#cfe3f1", edgecolors=BLUE, linewidths=1)
    )
    for x, end in ((low, q1), (high, q3)):
        axes.hlines(at, x, end, color="black", linewidth=1)
        axes.vlines(x, at - _BOX / 2, at + _BOX / 2, color="black", linewidth=1)
    axes.vlines(middle, at - _BOX, at + _BOX, color="black", linewidth=1.6)
    beyond = [np.asarray(box["fliers"]) for box in found]
    axes.plot(
        np.concatenate(beyond),
        np.repeat(at, [len(each) for each in beyond]),
        "o",
        markerfacecolor="none",
        markersize=3,
        markeredgecolor=GREY,
    )


def singular_values(values: FloatArray, weak: Sequence[str], name: str) -> str:
    """Singular values on a log axis, and the threshold below which the data alone do not tell.

    Args:
        values: (n,) descending, dimensionless.
        weak: the directions that were held, by name.
        name: id of the plot on its page.
    """
    floor = max(float(values.max(initial=0.0)), 1.0) * 1e-9
    height, threshold = np.maximum(values, floor), 1.0 / WEAK
    estimated = height >= threshold
    with picture(name, (WIDTH, 2.8)) as figure:
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
        axes.set_ylabel("singular value (dimensionless)")
        axes.legend(ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1))
        if weak:
            note = "held: " + ", ".join(weak[:4]) + (" …" if len(weak) > 4 else "")
            figure.supxlabel(_short(note, 110), fontsize=8, x=0.01, ha="left")
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
    side = 1.9 + 0.24 * len(keep)
    with picture(name, (side + 0.9, side)) as figure:
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
        bar = figure.colorbar(image, ax=axes, shrink=0.7, format="%.1f")
        bar.set_label("size of the correlation (dimensionless)")
        return svg_text(figure, name, "Correlations of the estimated parameters")


def parameter_changes(estimates: Sequence[Estimate], name: str) -> str:
    """Change of every estimated parameter from nominal with ± one standard deviation; mm and deg.

    Args:
        estimates: those with a standard deviation; not empty.
        name: id of the plot on its page.
    """
    by_unit: dict[Unit, list[Estimate]] = {}
    for e in estimates:
        by_unit.setdefault(e.unit, []).append(e)
    rows = max(len(found) for found in by_unit.values())
    with picture(name, (WIDTH, 1.0 + 0.19 * rows)) as figure:
        panels = figure.subplots(1, len(by_unit), squeeze=False)[0]
        for axes, (unit, found) in zip(panels, by_unit.items(), strict=True):
            _changes(axes, found, unit)
        return svg_text(figure, name, "Changes of the parameters from nominal")


def _changes(axes: Axes, found: Sequence[Estimate], unit: Unit) -> None:
    change = shown(np.array([e.value - e.nominal for e in found]), unit)
    std = shown(np.array([e.std or 0.0 for e in found]), unit)
    k = np.arange(len(found))
    axes.axvline(0.0, color="black", linewidth=0.8)
    axes.errorbar(change, k, xerr=std, fmt="none", ecolor="black", elinewidth=1.0, capsize=2)
    for state, marker, colour in (("identified", "o", BLUE), ("prior", "s", "white")):
        chosen = [i for i, e in enumerate(found) if e.state == state]
        if chosen:
            axes.plot(
                *(change[chosen], k[chosen], marker),
                color=colour,
                markeredgecolor=BLUE,
                markersize=4.5,
                label=state,
            )
    axes.set_yticks(k, [_short(e.name, 26) for e in found], fontsize=7)
    axes.set_ylim(len(found) - 0.4, -0.6)
    axes.grid(axis="x")
    axes.set_xlabel(f"change ± std, {unit_name(unit)}")
    axes.legend(ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1))


def _short(text: str, most: int = 40) -> str:
    return text if len(text) <= most else f"{text[: most - 1]}…"
