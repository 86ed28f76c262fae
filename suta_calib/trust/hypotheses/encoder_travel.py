"""An encoder that loses or doubles counts, or a gear ratio that is wrong."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.solver.problem import Problem
from suta_calib.trust import SpoiltData, Truth
from suta_calib.trust.in_time import ChangeInTime, EncoderInTime
from suta_calib.trust.patterns import readings_of
from suta_calib.trust.simulated_faults import arm_of, middle_joint_changed


class EncoderTravel(EncoderInTime):
    """``q_j → q_j + s (q_j - mean)``."""

    name = "encoder travel"
    about = "A joint reads too much in proportion to its travel."
    sort = "travel"
    unit = "1"
    # A larger share of a travel would be seen.
    plausible = 2e-3

    def shares(self, problem: Problem, joint: int) -> Iterable[FloatArray]:
        """Travels about their mean."""
        name, shares = arm_of(problem.terms[0]).joints[joint], list[FloatArray]()
        mean = readings_of(problem.terms, [name]).mean()
        for term in problem.terms:
            shares.append(term.poses.samples.q[:, joint] - mean)
        return (np.concatenate(shares),)

    def statement(self, change: ChangeInTime) -> str:
        """The error as a part of the travel."""
        return (
            f"{change.joint} reads {100 * change.size:+.3f} ± {100 * change.std:.3f} % of its "
            "travel too much. Does its encoder lose or double counts, or is a gear ratio wrong?"
        )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """The middle joint reads 0.3 % of its travel too much."""
        # What is read too much is a part of the true travel.
        return middle_joint_changed(
            data, lambda q: q + 3e-3 * (q - q.mean()), "travel {}", 3e-3 / (1.0 + 3e-3)
        )
