"""Pictures of a plan: where things go on the bench, and what each more of them brings."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from suta_calib.analysis.planning import Candidate, Placement, Plan, TouchPoint
from suta_calib.plotting.look import BEHIND, BLUE, GREY, ORANGE, TINT
from suta_calib.plotting.planar import draw_arm, outline
from suta_calib.plotting.style import plain_log
from suta_calib.units import mm, shown

AXES: Final = "xyz"


def draw_bench(figure: Any, plan: Plan) -> list[Axes]:
    """The arm, what was measured, and what to measure next; mm in the base.

    Args:
        figure: an empty `Figure` or `SubFigure`.
        plan: the plan.

    Returns:
        The panels: from above, from the side.
    """
    panels = list(figure.subplots(1, 2, width_ratios=(1, 1)))
    views = {"seen from above": (0, 1), "seen from the side": (0, 2)}
    for axes, (title, plane) in zip(panels, views.items(), strict=True):
        _view(axes, plan, plane)
        axes.set_title(title)
    look: dict[str, Any] = {"ncols": 2, "columnspacing": 12.0, "fontsize": 8, "frameon": False}
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", **look)
    return panels


def draw_gain(axes: Axes, plan: Plan) -> None:
    """Predicted uncertainty of the tip by the number of further candidates, mm."""
    stop = plan.stop
    tips = mm(np.array(stop.tips))
    axes.plot(range(len(tips)), tips, "o-", color=BLUE, ms=5, label="best choice")
    spread = mm(np.percentile(plan.random, [5, 50, 95]))
    axes.errorbar(
        *(len(plan.chosen), spread[1]),
        yerr=[[spread[1] - spread[0]], [spread[2] - spread[1]]],
        fmt="s",
        color=ORANGE,
        ms=5,
        capsize=5,
        label=f"{len(plan.random)} random choices (5, 50, 95 %)",
    )
    if stop.target is not None:
        label = f"target {mm(stop.target):.3g} mm"
        axes.axhline(mm(stop.target), color="black", lw=1.0, ls="--", label=label)
    if stop.worthwhile is not None:
        label = f"then less than {shown(stop.least_gain, '%'):.0f} % each"
        axes.axvline(stop.worthwhile, color=GREY, lw=1.2, ls=":", label=label)
    if tips.max() < 8 * tips.min():
        axes.set_ylim(bottom=0)
    else:
        plain_log(axes.yaxis, axes.set_yscale)
        low, high = 0.6 * tips.min(), 1.5 * tips.max()
        ticks = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)
        axes.set_yticks([tick for tick in ticks if low <= tick <= high])
    axes.set_xticks(range(len(tips)))
    axes.set_xlabel("further placements, points or poses")
    axes.set_ylabel("tip uncertainty, mm (3-D RMS)")
    axes.grid(axis="y")
    axes.legend(fontsize=8, loc="upper right", bbox_to_anchor=(0.94, 1), frameon=False)


def _view(axes: Axes, plan: Plan, plane: tuple[int, int]) -> None:
    i, j = plane
    box = [plan.region.lower, plan.region.upper]
    low, high = (mm(np.array([corner[i], corner[j]])) for corner in box)
    frame = np.array([low, [high[0], low[1]], high, [low[0], high[1]], low])
    axes.plot(*frame.T, color=GREY, lw=1.0, ls="--", label="region of the tip")
    for k, place in enumerate(plan.situation.placements):
        _artefact(axes, plan, place, plane, GREY, "" if k else "measured")
    for k, choice in enumerate(plan.chosen):
        _candidate(axes, plan, choice.candidate, plane, k)
    # The arm where it begins the plan, or as it was in the first sample.
    first = plan.chosen[0].candidate.q[0] if plan.chosen else plan.situation.readings[0]
    draw_arm(axes, mm(plan.situation.arm.skeleton(first).points[:, [i, j]]))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"{AXES[i]}, mm")
    axes.set_ylabel(f"{AXES[j]}, mm")
    axes.grid()


def _candidate(
    axes: Axes, plan: Plan, candidate: Candidate, plane: tuple[int, int], number: int
) -> None:
    place = candidate.place
    first = not any(type(c.candidate.place) is type(place) for c in plan.chosen[:number])
    if isinstance(place, Placement):
        _artefact(axes, plan, place, plane, BLUE, "planned artefact" if first else "")
        where = place.position
    elif isinstance(place, TouchPoint):
        where = place.position
        # Where the tool comes from, as short lines.
        rotation, position = plan.situation.arm.forward(candidate.q, plan.situation.values)
        for R, p in list(zip(rotation, position, strict=True))[:: 1 + len(rotation) // 20]:
            line = mm(np.array([p, p - 0.07 * R[:, 2]])[:, list(plane)])
            axes.plot(*line.T, color=ORANGE, lw=0.9, zorder=4)
        at = mm(where[list(plane)])
        label = "planned point, tool from all sides" if first else ""
        axes.plot(*at, "*", color=ORANGE, mec="black", ms=13, zorder=8, label=label)
    else:
        _, where = plan.situation.arm.forward(candidate.q[0], plan.situation.values)
        at = mm(where[list(plane)])
        axes.plot(*at, "D", color=BLUE, ms=5, zorder=7, label="" if number else "planned pose")
    beside: dict[str, Any] = {"xytext": (6, 6), "textcoords": "offset points", "zorder": 9}
    x, y = mm(where[list(plane)])
    axes.annotate(candidate.name, (x, y), fontsize=9, fontweight="bold", bbox=BEHIND, **beside)


def _artefact(
    axes: Axes, plan: Plan, place: Placement, plane: tuple[int, int], colour: str, label: str
) -> None:
    """Outline of the landmarks and their feet, and the artefact's x axis."""
    assert plan.situation.artefact is not None
    marks = np.array([m.position for m in plan.situation.artefact.landmarks.values()])
    body = np.vstack([marks, marks * [1.0, 1.0, 0.0]]) @ place.rotation.T + place.position
    look: dict[str, Any] = {"facecolor": "none", "lw": 0.9, "hatch": "////", "zorder": 2}
    if colour == BLUE:
        look = {"facecolor": TINT, "alpha": 0.8, "lw": 1.6, "zorder": 3}
    hull = outline(mm(body[:, list(plane)]))
    axes.add_patch(Polygon(hull, edgecolor=colour, label=label or None, **look))
    tip = tuple(mm((place.position + 0.05 * place.rotation[:, 0])[list(plane)]))
    at = tuple(mm(place.position[list(plane)]))
    arrow = {"arrowstyle": "->", "color": colour, "lw": 1.4}
    axes.annotate("", tip, at, arrowprops=arrow, zorder=7)
