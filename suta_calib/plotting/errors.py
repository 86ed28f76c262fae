"""Errors before and after a calibration: histograms and boxes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.plotting.chart import Axis, Boxes, Chart, Labelled, Lines, Mark, Points, Steps, ends
from suta_calib.plotting.limits import MOST_GROUPS
from suta_calib.plotting.look import BLUE, GREY, ORANGE, TINT, shortened
from suta_calib.units import Unit, shown, unit_name

# Half the height of a box, of which one stands every unit.
_BOX: Final = 0.31
# How far a whisker goes at most, in lengths of its box.
_WHISKER: Final = 1.5
# Two histograms whose medians differ by more than this are both visible only on a log axis.
FAR_APART: Final = 4.0


def error_histogram(before: FloatArray, after: FloatArray, unit: Unit, what: str) -> Chart:
    """Histogram of error norms before and after, with mean and RMS, in the reader's unit.

    Args:
        before: (n,) at least one, SI.
        after: the same.
        unit: of both.
        what: the errors are of, such as ``distance``.
    """
    sizes = {name: np.abs(shown(e, unit)) for name, e in (("before", before), ("after", after))}
    bins, logarithmic = _bins(*sizes.values())
    marks: dict[str, list[Labelled]] = {}
    most = 1.0
    for name, colour, hatched in (("before", ORANGE, True), ("after", BLUE, False)):
        values = sizes[name]
        count = np.histogram(np.clip(values, bins[0], bins[-1]), bins)[0].astype(float)
        most = max(most, float(count.max()))
        rms, mean = float(np.sqrt(np.mean(values**2))), float(values.mean())
        told = [
            f"{figure} {name} {size:.3g} {unit_name(unit)}"
            for figure, size in (("RMS", rms), ("mean", mean))
        ]
        marks[name] = [
            Steps(bins, count, "" if hatched else colour, colour, hatched, name),
            Lines(
                *(np.array([[rms, rms]]), np.array([[-np.inf, np.inf]])),
                width=1.2,
                dash="dotted" if hatched else "dashed",
                label=told[0],
            ),
            Points(np.array([mean]), np.zeros(1), 7.0, "triangle", colour, label=told[1]),
        ]
    lowest = f" (the first bar: {bins[1]:.2g} and less)" if logarithmic else ""
    low, high = ends(bins, log=logarithmic)
    (was, *was_told), (now, *now_told) = marks["before"], marks["after"]
    return Chart(
        # What was before stands in front, for one sees through it.
        [now, was, *was_told, *now_told],
        Axis(f"{what} error, {unit_name(unit)}{lowest}", low, high, log=logarithmic),
        Axis("number of errors", *ends(np.array([most]), least=0.0)),
        told=[was, *was_told, now, *now_told],
    )


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


def grouped_errors(groups: Mapping[str, FloatArray], grouping: str, unit: Unit = "m") -> Chart:
    """Box plot of errors, one box a group, worst median first.

    Args:
        groups: errors, in SI, by the group's name; those beyond `MOST_GROUPS` are left out.
        grouping: what the groups are, e.g. ``landmark``.
        unit: SI unit of the errors.
    """
    ranked = sorted(groups.items(), key=lambda item: -float(np.median(item[1])))[:MOST_GROUPS]
    errors = [shown(e, unit) for _, e in ranked]
    names = [(k, shortened(f"{name}  ({len(e)})")) for k, (name, e) in enumerate(ranked)]
    return Chart(
        _boxes(errors),
        Axis(
            f"error after calibration, {unit_name(unit)} (in brackets: number of errors)",
            *ends(np.concatenate(errors), least=0.0),
            grid=True,
        ),
        Axis(grouping, len(ranked) - 0.5, -0.5, names=names),
    )


def _boxes(groups: Sequence[FloatArray]) -> list[Mark]:
    """Lying boxes as Tukey drew them, a unit apart from 0 on.

    Whiskers end at the last errors within one and a half boxes; what is beyond is a point.
    """
    at = np.arange(float(len(groups)))
    q1, middle, q3 = np.array([np.percentile(each, (25, 50, 75)) for each in groups]).T
    reach = _WHISKER * (q3 - q1)
    fences = zip(groups, q1 - reach, q3 + reach, strict=True)
    within = [(each >= low) & (each <= high) for each, low, high in fences]
    inner = [each[inside] for each, inside in zip(groups, within, strict=True)]
    beyond = [each[~inside] for each, inside in zip(groups, within, strict=True)]
    low, high = (np.array([end(each) for each in inner]) for end in (np.min, np.max))
    thin = [
        (low, q1, at, at),
        (q3, high, at, at),
        *((end, end, at - _BOX / 2, at + _BOX / 2) for end in (low, high)),
    ]
    x, y = (
        np.concatenate([np.column_stack([line[k], line[k + 1]]) for line in thin]) for k in (0, 2)
    )
    return [
        Boxes(q1, q3, at - _BOX, at + _BOX, TINT, BLUE),
        Lines(x, y),
        Lines(np.column_stack([middle] * 2), np.column_stack([at - _BOX, at + _BOX]), 1.6),
        Points(
            np.concatenate(beyond), np.repeat(at, [len(each) for each in beyond]), 3.0, edge=GREY
        ),
    ]
