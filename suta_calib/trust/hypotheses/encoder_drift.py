"""An encoder whose zero drifts while the rows of a term are measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import numpy as np

from suta_calib.solver.problem import Problem
from suta_calib.trust.hypothesis import SpoiltData
from suta_calib.trust.in_time import TURN, ChangeInTime, InTime, TipShift, by_readings, flat, so_far
from suta_calib.trust.spoiling import middle_joint_changed
from suta_calib.units import Unit


class EncoderDrift(InTime):
    """``q_j → q_j + s i / n`` in row i of the n rows of a term."""

    name: ClassVar[str] = "encoder drift"
    about: ClassVar[str] = "A joint's zero drifts while the rows are measured."
    sort: ClassVar[str] = "drift"
    at_once: ClassVar[bool] = False
    unit: ClassVar[Unit] = "rad"

    def motions(self, problem: Problem) -> Iterator[TipShift]:
        """One for each joint and term."""
        arm, velocity = problem.arm, by_readings(problem)
        assert arm is not None
        for k, joint in enumerate(arm.joints):
            for share in so_far(problem):
                yield TipShift(joint, flat(velocity[:, :, [k]], share), np.array([TURN]))

    def statement(self, change: ChangeInTime) -> str:
        """By how much until the last row."""
        return (
            f"The zero of {change.joint} drifted by {change.amount} while the rows were measured: "
            "let it warm up, and look whether its encoder sits fast."
        )

    def spoil(self, data: Any, values: Mapping[str, float], rng: np.random.Generator) -> SpoiltData:
        """The zero of the middle joint drifts by 8 mrad."""
        del values, rng
        return middle_joint_changed(
            data, lambda q: q + 8e-3 * np.arange(len(q)) / len(q), "drift {}", 8e-3
        )
