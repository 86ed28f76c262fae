"""Pictures of visits to one point, and of joints at rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes

from suta_calib.analysis.repeatability import (
    DIRECTION,
    PROTOCOL,
    DirectionalForce,
    Repeatability,
    RepeatedTouches,
    Stationary,
)
from suta_calib.analysis.repeatability.scatter import JointSpread, distances
from suta_calib.plotting.look import BLUE, GREY, LARGE, ORANGE
from suta_calib.plotting.style import plain_log
from suta_calib.report.svg import picture, svg_text
from suta_calib.terms.block import grouped
from suta_calib.units import mm, text, thousandths, unit_name

_LOOKS: Final = tuple(zip((BLUE, ORANGE, "black") * 2, "osD^vP", strict=True))
_LINES: Final = ("-", "--", ":", "-.")
_COLOURS: Final = (BLUE, ORANGE, "black", GREY)
_HATCHES: Final = ("", "////", "", "....")


def visits_plot(repeatability: Repeatability) -> str:
    """An SVG: the visits from two sides, and what the joints do."""
    name = "repeatability_visits"
    pushed = repeatability.directions is not None
    with picture(name, (LARGE, 8.8 if pushed else 6.0)) as figure:
        top = ["xy", "xz", "order"]
        layout: Any = [top, *[[row] * 3 for row in (["joints"] if pushed else []) + ["bars"]]]
        panels = figure.subplot_mosaic(layout)
        _cloud(panels["xy"], repeatability, 0, 1)
        _cloud(panels["xz"], repeatability, 0, 2)
        figure.legend(
            *panels["xy"].get_legend_handles_labels(),
            loc="outside upper left",
            ncols=8,
            fontsize=8,
            handletextpad=0.2,
        )
        _in_order(panels["order"], repeatability)
        if repeatability.directions is not None:
            _pushes(panels["joints"], repeatability.directions)
        _joints(
            panels["bars"], repeatability.protocol_joints or {"all visits": repeatability.joints}
        )
        return svg_text(figure, name, "Visits relative to their barycentre, mm, and in order")


def _cloud(axes: Axes, repeatability: Repeatability, across: int, up: int) -> None:
    away = mm(repeatability.position_of - repeatability.position_of.mean(axis=0))
    names, index = ["visits"], np.zeros(len(away), dtype=np.intp)
    for key in (PROTOCOL, DIRECTION):
        if len(set(repeatability.samples.labels.get(key, ()))) > 1:
            names, index = grouped(repeatability.samples.labels[key])
    for k, label in enumerate(names):
        colour, marker = _LOOKS[k % len(_LOOKS)]
        rows = away[index == k]
        axes.plot(rows[:, across], rows[:, up], marker, color=colour, ms=4, mfc="none", label=label)
    angle = np.linspace(0, 2 * np.pi, 121)
    radius = mm(repeatability.position.rp.value)
    axes.plot(radius * np.cos(angle), radius * np.sin(angle), "--", color=GREY, lw=1.2, label="RP")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title(f"{'xyz'[across]} and {'xyz'[up]} of the base")
    axes.set_xlabel(f"{'xyz'[across]}, mm")
    axes.set_ylabel(f"{'xyz'[up]}, mm")
    axes.grid()


def _in_order(axes: Axes, repeatability: Repeatability) -> None:
    size = mm(distances(repeatability.position_of))
    axes.plot(np.arange(1, len(size) + 1), size, ".-", color=BLUE, lw=0.6, ms=4)
    for value, line, label in (
        (repeatability.position.rp.value, "--", "RP"),
        (repeatability.position.mean, ":", "mean"),
    ):
        axes.axhline(mm(value), color=GREY, ls=line, lw=1.2)
        axes.annotate(
            label,
            (1, mm(value)),
            xycoords=("axes fraction", "data"),
            xytext=(3, 0),
            textcoords="offset points",
            fontsize=7,
            va="center",
        )
    axes.set_ylim(bottom=0)
    axes.set_title("Distance to the barycentre")
    axes.set_xlabel("visit, in order")
    axes.set_ylabel("mm")
    axes.grid(axis="y")


def touches_plot(touches: RepeatedTouches) -> str:
    """An SVG: what the joints do among repeats of a touch."""
    name = "repeatability_touches"
    with picture(name, (LARGE, 3.2)) as figure:
        _joints(figure.subplots(), {"repeats of a touch": touches.joints})
        return svg_text(figure, name, "Scatter of each joint among repeats of a touch")


def _joints(axes: Axes, named: Mapping[str, Sequence[JointSpread]]) -> None:
    """Each joint's scatter, by what it is of, as what it moves the tip by."""
    chain = next(iter(named.values()))
    places, width = np.arange(len(chain)), 0.8 / len(named)
    for k, (name, joints) in enumerate(named.items()):
        at = places + (k - (len(named) - 1) / 2) * width
        tips = mm(np.array([joint.tip for joint in joints]))
        axes.bar(at, tips, 0.95 * width, color=_COLOURS[k % 4], hatch=_HATCHES[k % 4], label=name)
        for x, tip, joint in zip(at, tips, joints, strict=True):
            axes.annotate(
                text(joint.std.value, joint.unit), (x, tip), ha="center", va="bottom", fontsize=6
            )
    units = " or ".join(sorted({unit_name(joint.unit) for joint in chain}))
    axes.margins(y=0.15)
    axes.set_xticks(places, [joint.joint for joint in chain])
    axes.set_title(
        f"Scatter of each joint: bars: motion of the tip by this joint alone; numbers: {units}"
    )
    axes.set_ylabel("at the tip, mm")
    axes.grid(axis="y")
    axes.legend(fontsize=8)


def _pushes(axes: Axes, force: DirectionalForce) -> None:
    """Each joint's play beside what chance gives, at the tip."""
    places = np.arange(len(force.joints))
    play = np.array([joint.tip for joint in force.joints])
    chance = [joint.tip * joint.by_chance / max(joint.backlash, 1e-300) for joint in force.joints]
    axes.bar(places - 0.2, mm(play), 0.38, color=BLUE, label="play between directions")
    axes.bar(
        places + 0.2, mm(np.array(chance)), 0.38,
        color="white", edgecolor="black", hatch="////", label="by chance in one of twenty cases",
    )  # fmt: skip
    for place, joint in zip(places, force.joints, strict=True):
        if joint.has_backlash:
            axes.annotate(
                "gives", (place - 0.2, mm(joint.tip)), ha="center", va="bottom", fontsize=8
            )
    axes.margins(y=0.15)
    axes.set_xticks(places, [joint.joint for joint in force.joints])
    axes.set_title("Play of each joint beside its own motion")
    axes.set_ylabel("at the tip, mm")
    axes.grid(axis="y")
    axes.legend(fontsize=8)


def stationary_plot(rest: Stationary) -> str:
    """An SVG: readings over time, and Allan deviation of every joint."""
    name = "repeatability_stationary"
    with picture(name, (LARGE, 3.9)) as figure:
        over_time, allan = figure.subplots(1, 2)
        _over_time(over_time, rest)
        _allan(allan, rest)
        return svg_text(figure, name, "Joints at rest: readings over time, and Allan deviation")


def _over_time(axes: Axes, rest: Stationary) -> None:
    """Means of short stretches, one joint above the other."""
    parts = np.array_split(np.arange(len(rest.stream.time)), min(200, len(rest.stream.time)))
    time = [rest.stream.time[rows].mean() - rest.stream.time[0] for rows in parts]
    columns = []
    for joint, readings in zip(rest.joints, rest.stream.readings.T, strict=True):
        away = readings - joint.mean
        away = np.angle(np.exp(1j * away)) if joint.unit == "rad" else away
        means = np.array([np.median(away[rows]) for rows in parts])
        columns.append(thousandths(means, joint.unit))
    distance = 1.5 * max(float(np.ptp(column)) for column in columns) or 1.0
    for k, (joint, column) in enumerate(zip(rest.joints, columns, strict=True)):
        axes.plot(time, column - column.mean() - k * distance, color=BLUE, lw=0.8)
        axes.annotate(joint.joint, (time[0], (0.2 - k) * distance), fontsize=7, va="bottom")
    axes.set_ylim(top=0.8 * distance)
    axes.set_title("Readings, averaged over short stretches")
    axes.set_xlabel("time, s")
    axes.set_ylabel(f"{_unit(rest)}, one joint below the other")
    axes.grid(axis="y")


def _allan(axes: Axes, rest: Stationary) -> None:
    for k, joint in enumerate(rest.joints):
        positive = joint.allan.deviation > 0
        if not positive.any():
            continue
        colour, line = _COLOURS[k % 4], _LINES[(k + k // 4) % 4]
        tau, deviation = (
            joint.allan.tau[positive],
            thousandths(joint.allan.deviation[positive], joint.unit),
        )
        axes.plot(tau, deviation, color=colour, ls=line, lw=1.3, label=joint.joint)
        low, high = (
            thousandths(ends[positive], joint.unit) for ends in (joint.allan.low, joint.allan.high)
        )
        axes.fill_between(tau, low, high, color=colour, alpha=0.1, lw=0)
    plain_log(axes.xaxis, axes.set_xscale)
    plain_log(axes.yaxis, axes.set_yscale)
    axes.set_title("Allan deviation (bands: 95 %)")
    axes.set_xlabel("averaging time, s")
    axes.set_ylabel(_unit(rest))
    axes.grid()
    if axes.lines:
        axes.legend(fontsize=7, ncols=2)


def _unit(rest: Stationary) -> str:
    units = {f"0.001 {unit_name(joint.unit)}" for joint in rest.joints}
    return " or ".join(sorted(units))
