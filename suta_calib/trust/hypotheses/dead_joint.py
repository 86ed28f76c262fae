"""A joint that reads the same in every row while others move."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from suta_calib.terms import Term
from suta_calib.trust import Pattern, SpoiltData, Truth
from suta_calib.trust.patterns import STILL, readings_by_joint
from suta_calib.trust.simulated_faults import middle_joint_changed


class DeadJoint(Pattern):
    """``max q_j - min q_j`` is nearly zero, and two joints move ten times more."""

    name = "dead joint"
    about = "A joint reads the same in every row."
    precedence = 10
    role = "cause"

    def of_terms(self, terms: Sequence[Term]) -> Iterator[str]:
        """One for all such joints together."""
        travel = {joint: float(np.ptp(q)) for joint, q in readings_by_joint(terms).items()}
        dead = [joint for joint, moved in travel.items() if moved < STILL]
        if dead and min(sorted(travel.values())[-2:]) > 10 * STILL:
            yield (
                f"{', '.join(dead)} reads the same in every row, to {np.degrees(STILL):.3f} deg. "
                "Is its encoder alive? If the joint was locked, do not estimate its parameters."
            )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """The middle joint reads its mean."""
        return middle_joint_changed(
            data, lambda q: np.full_like(q, q.mean()), "{} reads the same in every row"
        )
