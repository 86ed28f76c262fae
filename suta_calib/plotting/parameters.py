"""Parameters: how far each moved, and how well each will be known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from suta_calib.plotting.look import BLUE, GREY, ORANGE, Change, shortened
from suta_calib.plotting.style import legend_above, plain_log
from suta_calib.units import Unit, shown, unit_name


def draw_changes(figure: Any, changes: Sequence[Change]) -> list[Any]:
    """Draw every change ± one standard deviation, a panel for each unit; returns the panels."""
    by_unit: dict[Unit, list[Change]] = {}
    for parameter in changes:
        by_unit.setdefault(parameter.unit, []).append(parameter)
    panels: list[Any] = list(figure.subplots(1, len(by_unit), squeeze=False)[0])
    for axes, (unit, of_unit) in zip(panels, by_unit.items(), strict=True):
        change, std = (
            shown(np.array([getattr(parameter, name) for parameter in of_unit]), unit)
            for name in ("change", "std")
        )
        rows, by_prior = (
            np.arange(len(of_unit)),
            np.array([parameter.by_prior for parameter in of_unit]),
        )
        axes.axvline(0.0, c="black", lw=0.8)
        axes.errorbar(change, rows, xerr=std, fmt="none", ecolor="black", elinewidth=1, capsize=2)
        for name, chosen, marker, fill in (
            ("identified", ~by_prior, "o", BLUE),
            ("prior", by_prior, "s", "white"),
        ):
            if chosen.any():
                marks: dict[str, Any] = {"mfc": fill, "mec": BLUE, "ms": 4.5, "label": name}
                axes.plot(change[chosen], rows[chosen], marker, **marks)
        _name_rows(axes, [parameter.name for parameter in of_unit])
        axes.set_xlabel(", ".join(filter(None, ["change ± std", unit_name(unit)])))
        # Two columns of a legend are wider than a panel of three.
        legend_above(axes, columns=2 if len(by_unit) < 3 else 1)
    return panels


def draw_prospects(
    axes: Any, names: Sequence[str], shares: Sequence[float | None], threshold: float
) -> None:
    """Draw how far each parameter will be off, as a share of how far it might be now.

    Args:
        axes: empty `Axes`.
        names: of the parameters.
        shares: predicted standard deviation over what is plausible; None for what is held.
        threshold: share from which on data do not tell a parameter.
    """
    determined = np.array([share is not None for share in shares], dtype=bool)
    share = np.array([1.0 if share is None else share for share in shares])
    rows = np.arange(len(names))
    low = min(float(share.min(initial=threshold)), threshold) / 3
    plain_log(axes.xaxis, axes.set_xscale)
    for name, chosen, colour, hatch in (
        ("can be determined", determined, BLUE, ""),
        ("cannot: held at nominal", ~determined, ORANGE, "////"),
    ):
        bars: dict[str, Any] = {"facecolor": "none" if hatch else colour, "hatch": hatch}
        bars |= {"edgecolor": colour, "label": f"{name} ({int(chosen.sum())})"}
        axes.barh(rows[chosen], share[chosen] - low, 0.7, low, **bars)
    axes.axvline(threshold, c="black", lw=0.9, ls="--", label="threshold")
    axes.axvline(1.0, c=GREY, lw=0.9)
    _name_rows(axes, names)
    axes.set_xlim(low, 1.6)
    axes.set_xlabel("predicted ± std, as a share of how far it might be off now")
    legend_above(axes, columns=3)


def _name_rows(axes: Any, names: Sequence[str]) -> None:
    """Write names beside rows 0, 1, … from the top, with a line from each."""
    axes.set_yticks(range(len(names)), [shortened(name, 26) for name in names], fontsize=7)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.grid(axis="x")
