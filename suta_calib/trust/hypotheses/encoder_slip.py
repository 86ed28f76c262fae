"""An encoder that slipped, or whose zero was set anew, between two rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import numpy as np

from suta_calib.solver.problem import Problem
from suta_calib.trust.hypothesis import SpoiltData
from suta_calib.trust.in_time import (
    TURN,
    ChangeInTime,
    InTime,
    TipShift,
    by_readings,
    flat,
    later_half,
)
from suta_calib.trust.spoiling import middle_joint_changed
from suta_calib.units import Unit


class EncoderSlip(InTime):
    """``q_j → q_j + s`` from a row on, or in a file."""

    name: ClassVar[str] = "encoder slip"
    about: ClassVar[str] = "From a row on, a joint's encoder reads too much by one angle."
    sort: ClassVar[str] = "slip"
    at_once: ClassVar[bool] = True
    unit: ClassVar[Unit] = "rad"

    def motions(self, problem: Problem) -> Iterator[TipShift]:
        """One for each joint."""
        arm, velocity = problem.arm, by_readings(problem)
        assert arm is not None
        for k, joint in enumerate(arm.joints):
            yield TipShift(joint, flat(velocity[:, :, [k]]), np.array([TURN]))

    def statement(self, change: ChangeInTime) -> str:
        """From where to where, by how much."""
        when = f"from {change.since} on than before"
        if change.until:
            when = f"from {change.since} to {change.until} than in other rows"
        return (
            f"{change.joint} reads {change.amount} more {when}: did its encoder slip, or was its "
            "zero set anew?"
        )

    def spoil(self, data: Any, values: Mapping[str, float], rng: np.random.Generator) -> SpoiltData:
        """The middle joint reads 4 mrad too much from the middle on."""
        del values, rng
        return middle_joint_changed(data, lambda q: q + 4e-3 * later_half(data), "slip {}", 4e-3)
