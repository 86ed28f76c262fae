"""A base, an instrument or an artefact that was moved between two rows."""

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
    flat,
    later_half,
    moved,
    of_base,
)
from suta_calib.trust.spoiling import displaced


class BaseMoved(InTime):
    """Every tip is displaced and turned alike, along the axes of the base, from a row on."""

    name: ClassVar[str] = "base moved"
    about: ClassVar[str] = "The base, the instrument or the artefact was moved at a row."
    sort: ClassVar[str] = "base"
    at_once: ClassVar[bool] = True

    def motions(self, problem: Problem) -> Iterator[TipShift]:
        """One."""
        yield TipShift("", flat(of_base(problem)), TWIST)

    def statement(self, change: ChangeInTime) -> str:
        """From where to where, by how much."""
        return moved("base, or what it met,", change)

    def spoil(self, data: Any, values: Mapping[str, float], rng: np.random.Generator) -> SpoiltData:
        """Two millimetres from the middle on."""
        del rng
        by = 2e-3 * np.array([0.6, 0.0, 0.8])
        twist = np.zeros((len(data.poses), 6))
        twist[:, :3] = by * later_half(data)[:, None]
        return SpoiltData(displaced(data, values, twist), np.array([*by, 0.0, 0.0, 0.0]))
