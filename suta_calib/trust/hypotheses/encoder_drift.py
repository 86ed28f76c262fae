"""An encoder whose zero drifts while the rows of a term are measured."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.solver.problem import Problem
from suta_calib.trust import SpoiltData, Truth
from suta_calib.trust.in_time import ChangeInTime, EncoderInTime, so_far
from suta_calib.trust.simulated_faults import middle_joint_changed


class EncoderDrift(EncoderInTime):
    """``q_j → q_j + s i / n`` in row i of the n rows of a term."""

    name = "encoder drift"
    about = "A joint's zero drifts while the rows are measured."
    sort = "drift"

    def shares(self, problem: Problem, joint: int) -> Iterable[FloatArray]:
        """One for each term."""
        return so_far(problem)

    def statement(self, change: ChangeInTime) -> str:
        """The drift up to the last row."""
        return (
            f"The zero of {change.joint} drifted by {change.amount} while the rows were measured. "
            "Let the arm warm up and measure again, and check whether the encoder is loose."
        )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """The zero of the middle joint drifts by 8 mrad."""
        return middle_joint_changed(
            data, lambda q: q + 8e-3 * np.arange(len(q)) / len(q), "drift {}", 8e-3
        )
