"""Parameters: how far each moved, and how well each will be known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray
from suta_calib.plotting.change import Change
from suta_calib.plotting.chart import (
    Axis,
    Boxes,
    Chart,
    Lines,
    Mark,
    Points,
    Shape,
    ends,
    named_rows,
)
from suta_calib.plotting.look import BLUE, GREY, ORANGE, WHITE, shortened
from suta_calib.units import Unit, shown, unit_name

_MOST_LETTERS: Final = 26
# Of a name in a list, points; and half the height of a row's error bar and of its bar.
_LETTERS: Final = 7.0
_CAP: Final = 0.12
_BAR: Final = 0.35
# Every value of an axis.
_ALL: Final = np.array([[-np.inf, np.inf]])


def parameter_changes(changes: Sequence[Change]) -> list[Chart]:
    """Every change ± one standard deviation, a panel for each unit, mm and degrees.

    Args:
        changes: at least one; the panels are in the order in which their units first occur.
    """
    by_unit: dict[Unit, list[Change]] = {}
    for each in changes:
        by_unit.setdefault(each.unit, []).append(each)
    # Two columns of a legend are wider than a panel of three.
    columns = 2 if len(by_unit) < 3 else 1
    return [_changes(found, unit, columns) for unit, found in by_unit.items()]


def _changes(found: Sequence[Change], unit: Unit, columns: int) -> Chart:
    change = shown(np.array([each.change for each in found]), unit)
    std = shown(np.array([each.std for each in found]), unit)
    by_prior = np.array([each.by_prior for each in found])
    k = np.arange(float(len(found)))
    low, high = change - std, change + std
    bars, caps = [(low, high), (low, low), (high, high)], [(k - _CAP, k + _CAP)] * 2
    marks: list[Mark] = [
        Lines(np.zeros((1, 2)), _ALL, 0.8),
        Lines(
            np.concatenate([np.column_stack(each) for each in bars]),
            np.concatenate([np.column_stack(each) for each in ((k, k), *caps)]),
        ),
    ]
    looks: tuple[tuple[str, BoolArray, Shape, str], ...] = (
        ("identified", ~by_prior, "circle", BLUE),
        ("prior", by_prior, "square", WHITE),
    )
    for name, chosen, shape, colour in looks:
        if chosen.any():
            marks.append(Points(change[chosen], k[chosen], 4.5, shape, colour, BLUE, name))
    span = np.concatenate([low, high, [0.0]])
    label = ", ".join(filter(None, ["change ± std", unit_name(unit)]))
    x = Axis(label, *ends(span), grid=True)
    return Chart(marks, x, _rows([each.name for each in found]), columns)


def parameter_prospects(
    names: Sequence[str], shares: Sequence[float | None], threshold: float
) -> Chart:
    """How far each parameter will be off, as a share of how far it might be now.

    Args:
        names: of the parameters.
        shares: predicted standard deviation over what is plausible; None for what is held.
        threshold: share from which on data do not tell a parameter.
    """
    known = np.array([share is not None for share in shares], dtype=bool)
    share = np.array([1.0 if each is None else each for each in shares])
    k = np.arange(float(len(names)))
    low = min(float(share.min(initial=threshold)), threshold) / 3
    marks: list[Mark] = []
    for label, chosen, colour, hatched in (
        ("can be determined", known, BLUE, False),
        ("cannot: held at nominal", ~known, ORANGE, True),
    ):
        at = k[chosen]
        marks.append(
            Boxes(
                *(np.full(len(at), low), share[chosen], at - _BAR, at + _BAR),
                fill="" if hatched else colour,
                edge=colour,
                hatched=hatched,
                label=f"{label} ({int(chosen.sum())})",
            )
        )
    marks += [
        Lines(np.full((1, 2), threshold), _ALL, 0.9, dash="dashed", label="threshold"),
        Lines(np.ones((1, 2)), _ALL, 0.9, GREY),
    ]
    x = Axis(
        "predicted ± std, as a share of how far it might be off now", low, 1.6, log=True, grid=True
    )
    return Chart(marks, x, _rows(names), columns=3)


def _rows(names: Sequence[str]) -> Axis:
    return named_rows([shortened(name, _MOST_LETTERS) for name in names], _LETTERS)
