"""A base, an instrument or an artefact that creeps while rows are measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import numpy as np

from suta_calib.solver.problem import Problem
from suta_calib.trust.hypothesis import SpoiltData
from suta_calib.trust.in_time import (
    TWIST,
    ChangeInTime,
    InTime,
    TipShift,
    crept,
    flat,
    of_base,
    so_far,
)
from suta_calib.trust.spoiling import displaced


class BaseCreep(InTime):
    """Every tip is displaced and turned ever more, along the axes of the base, row by row."""

    name: ClassVar[str] = "base creep"
    about: ClassVar[str] = "The base, the instrument or the artefact creeps row by row."
    sort: ClassVar[str] = "base creep"
    at_once: ClassVar[bool] = False

    def motions(self, problem: Problem) -> Iterator[TipShift]:
        """One for each term."""
        velocity = of_base(problem)
        for share in so_far(problem):
            yield TipShift("", flat(velocity, share), TWIST)

    def statement(self, change: ChangeInTime) -> str:
        """By how much until the last row."""
        return crept("base, or what it met,", change)

    def spoil(self, data: Any, values: Mapping[str, float], rng: np.random.Generator) -> SpoiltData:
        """Two millimetres until the last row."""
        del rng
        by = 2e-3 * np.array([0.6, 0.0, 0.8])
        twist = np.zeros((len(data.poses), 6))
        share = np.arange(len(twist)) / len(twist)
        twist[:, :3] = by * share[:, None]
        return SpoiltData(displaced(data, values, twist), np.array([*by, 0.0, 0.0, 0.0]))
