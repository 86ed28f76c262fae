"""An encoder that loses or doubles counts, or a gear ratio that is wrong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import numpy as np

from suta_calib.solver.problem import Problem
from suta_calib.trust.hypothesis import SpoiltData
from suta_calib.trust.in_time import ChangeInTime, InTime, TipShift, by_readings, flat
from suta_calib.trust.spoiling import middle_joint_changed
from suta_calib.units import Unit


class EncoderTravel(InTime):
    """``q_j → q_j + s (q_j - mean)``."""

    name: ClassVar[str] = "encoder travel"
    about: ClassVar[str] = "A joint reads too much in proportion to its travel."
    sort: ClassVar[str] = "travel"
    at_once: ClassVar[bool] = False
    unit: ClassVar[Unit] = "1"

    def motions(self, problem: Problem) -> Iterator[TipShift]:
        """One for each joint."""
        arm, velocity = problem.arm, by_readings(problem)
        assert arm is not None
        for k, joint in enumerate(arm.joints):
            q = np.concatenate([term.poses.samples.q[:, k] for term in problem.terms])
            motion = flat(velocity[:, :, [k]], q - q.mean())
            # A larger share of a travel would be seen.
            yield TipShift(joint, motion, np.array([2e-3]))

    def statement(self, change: ChangeInTime) -> str:
        """By which part of its travel."""
        return (
            f"{change.joint} reads {100 * change.size:+.3f} ± {100 * change.std:.3f} % of its "
            "travel too much: does its encoder lose or double counts, or is a gear ratio wrong?"
        )

    def spoil(self, data: Any, values: Mapping[str, float], rng: np.random.Generator) -> SpoiltData:
        """The middle joint reads 0.3 % of its travel too much."""
        del values, rng
        # What is read too much is a part of the true travel.
        return middle_joint_changed(
            data, lambda q: q + 3e-3 * (q - q.mean()), "travel {}", 3e-3 / (1.0 + 3e-3)
        )
