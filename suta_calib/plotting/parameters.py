"""Parameters: how far each moved, and how well each will be known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes

from suta_calib.plotting.change import Change
from suta_calib.plotting.style import BLUE, GREY, ORANGE, plain_log, shortened
from suta_calib.units import Unit, shown, unit_name

MOST_LETTERS: Final = 26


def draw_changes(figure: Any, changes: Sequence[Change]) -> list[Axes]:
    """Every change ± one standard deviation, a panel for each unit.

    Args:
        figure: an empty `Figure` or `SubFigure`.
        changes: at least one.

    Returns:
        The panels: mm, degrees, …, in the order in which they first occur.
    """
    by_unit: dict[Unit, list[Change]] = {}
    for each in changes:
        by_unit.setdefault(each.unit, []).append(each)
    panels: list[Axes] = list(figure.subplots(1, len(by_unit), squeeze=False)[0])
    for axes, (unit, found) in zip(panels, by_unit.items(), strict=True):
        _changes(axes, found, unit)
    return panels


def _changes(axes: Axes, found: Sequence[Change], unit: Unit) -> None:
    change = shown(np.array([each.change for each in found]), unit)
    std = shown(np.array([each.std for each in found]), unit)
    by_prior = np.array([each.by_prior for each in found])
    k = np.arange(len(found))
    axes.axvline(0.0, color="black", linewidth=0.8)
    axes.errorbar(change, k, xerr=std, fmt="none", ecolor="black", elinewidth=1.0, capsize=2)
    for name, chosen, marker, colour in (
        ("identified", ~by_prior, "o", BLUE),
        ("prior", by_prior, "s", "white"),
    ):
        if chosen.any():
            look: dict[str, Any] = {"color": colour, "markeredgecolor": BLUE, "markersize": 4.5}
            axes.plot(change[chosen], k[chosen], marker, label=name, **look)
    _named_rows(axes, [each.name for each in found])
    axes.set_xlabel(f"change ± std, {unit_name(unit)}")
    axes.legend(ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1), frameon=False)


def draw_prospects(
    axes: Axes,
    names: Sequence[str],
    shares: Sequence[float | None],
    threshold: float,
) -> None:
    """How far each parameter will be off, as a share of how far it might be now.

    Args:
        axes: to draw on.
        names: of the parameters.
        shares: predicted standard deviation over what is plausible; None for what is held.
        threshold: share from which on data do not tell a parameter.
    """
    known = np.array([share is not None for share in shares], dtype=bool)
    share = np.array([1.0 if each is None else each for each in shares])
    k = np.arange(len(names))
    low = min(float(share.min(initial=threshold)), threshold) / 3
    for label, chosen, colour, hatch in (
        ("can be determined", known, BLUE, ""),
        ("cannot: held at nominal", ~known, ORANGE, "////"),
    ):
        axes.barh(
            *(k[chosen], share[chosen] - low),
            left=low,
            height=0.7,
            color="white" if hatch else colour,
            edgecolor=colour,
            hatch=hatch,
            label=f"{label} ({int(chosen.sum())})",
        )
    axes.axvline(threshold, color="black", linewidth=0.9, linestyle="--", label="threshold")
    axes.axvline(1.0, color=GREY, linewidth=0.9)
    plain_log(axes.xaxis, axes.set_xscale)
    axes.set_xlim(low, 1.6)
    _named_rows(axes, names)
    axes.set_xlabel("predicted ± std, as a share of how far it might be off now")
    axes.legend(ncols=3, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1), frameon=False)


def _named_rows(axes: Axes, names: Sequence[str]) -> None:
    """Rows from the top, a name each."""
    axes.set_yticks(range(len(names)), [shortened(n, MOST_LETTERS) for n in names], fontsize=7)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.grid(axis="x")
