"""Two joints that read the same as one another in every row."""

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from suta_calib.terms import Term
from suta_calib.trust import Pattern, SpoiltData, Truth
from suta_calib.trust.patterns import ENOUGH_ROWS, STILL, readings_of
from suta_calib.trust.simulated_faults import arm_of, with_columns


class CopiedColumn(Pattern):
    """``|q_a - q_b|`` is nearly zero in all rows, though both joints move."""

    name = "copied column"
    about = "One joint's column was copied over another's."
    precedence = 11
    role = "cause"

    def of_terms(self, terms: Sequence[Term]) -> Iterator[str]:
        """One for each pair."""
        own = dict.fromkeys(arm_of(term).own_joints for term in terms)
        for pair in dict.fromkeys(pair for joints in own for pair in combinations(joints, 2)):
            q = readings_of(terms, pair)
            moving = len(q) >= ENOUGH_ROWS and np.ptp(q, axis=0).min() > 10 * STILL
            if moving and np.abs(q[:, 0] - q[:, 1]).max() < STILL:
                yield (
                    f"{pair[0]} and {pair[1]} read the same as one another in every row. Was "
                    "one column copied over the other? Export the readings again."
                )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """The third column copied over the fourth."""
        q, arm = data.poses.samples.q.copy(), arm_of(data)
        pair = arm.own_joints[2:4]
        third, fourth = map(arm.joints.index, pair)
        q[:, fourth] = q[:, third]
        return SpoiltData(with_columns(data, q=q), effect=f"{' and '.join(pair)} read")
