"""A joint that reads the same in every row while others move."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from suta_calib.terms import Term
from suta_calib.trust import Pattern, SpoiltData, Truth
from suta_calib.trust.patterns import STILL, all_readings
from suta_calib.trust.simulated_faults import arm_of, middle_joint_changed


class DeadJoint(Pattern):
    """``max q_j - min q_j`` is nearly zero, and two joints move ten times more."""

    name = "dead joint"
    about = "A joint reads the same in every row."
    precedence = 10
    role = "cause"

    def of_terms(self, terms: Sequence[Term]) -> Iterator[str]:
        """One for all such joints together."""
        joints, travel = arm_of(terms[0]).joints, np.ptp(all_readings(terms), axis=0)
        dead = [joint for joint, moved in zip(joints, travel, strict=True) if moved < STILL]
        if dead and np.sort(travel)[-2:].min() > 10 * STILL:
            yield (
                f"{', '.join(dead)} reads the same in every row, to {np.degrees(STILL):.3f} deg. "
                "Is its encoder alive? If the joint was locked, do not estimate its parameters."
            )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """The middle joint reads its mean."""
        return middle_joint_changed(
            data, lambda q: np.full_like(q, q.mean()), "{} reads the same in every row"
        )
