"""A joint that reads the same in every row while others move."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.terms import Term
from suta_calib.trust import Pattern, SpoiltData, Truth
from suta_calib.trust.patterns import STILL
from suta_calib.trust.simulated_faults import arm_of, middle_joint_changed


class DeadJoint(Pattern):
    """``max q_j - min q_j`` is nearly zero, and two joints move ten times more."""

    name = "dead joint"
    about = "A joint reads the same in every row."
    precedence = 10
    role = "cause"

    def of_terms(self, terms: Sequence[Term]) -> Iterator[str]:
        """One for all such joints together."""
        read = dict[str, list[FloatArray]]()
        for term in terms:
            # Readings of other chains' joints are no readings.
            for joint in (arm := arm_of(term)).own_joints:
                q = term.poses.samples.q[:, arm.joints.index(joint)]
                read.setdefault(joint, []).append(q)
        travel = {joint: float(np.ptp(np.concatenate(parts))) for joint, parts in read.items()}
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
