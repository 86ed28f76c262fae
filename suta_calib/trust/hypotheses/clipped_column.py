"""Readings of a joint that stop at a value while the joint moves on."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from suta_calib.terms import Term
from suta_calib.trust import Pattern, SpoiltData, Truth
from suta_calib.trust.patterns import ENOUGH_ROWS, STILL, readings_by_joint
from suta_calib.trust.simulated_faults import arm_of, middle_joint_changed
from suta_calib.units import text


class ClippedColumn(Pattern):
    """Many readings equal the largest or the smallest one: so does a joint that is sent there."""

    name = "clipped column"
    about = "A joint's readings stop at a value, though the joint moves on."
    precedence = 31
    role = "suspicion"

    def of_terms(self, terms: Sequence[Term]) -> Iterator[str]:
        """One for each end of each joint."""
        arm = arm_of(terms[0])
        for joint, readings in readings_by_joint(terms).items():
            if np.ptp(readings) <= 10 * STILL:
                continue
            for end, which in ((readings.max(), "above"), (readings.min(), "below")):
                times = int(np.sum(readings == end))
                # Share of the rows at a column's end, from which it is reported.
                if times >= max(ENOUGH_ROWS, 0.1 * len(readings)):
                    where = text(float(end), arm.units[joint], with_unit=True)
                    yield (
                        f"{times} of {len(readings)} readings of {joint} are {where} to the last "
                        f"digit, and none is {which}. Does the range of its encoder end there? "
                        "Check the encoder, or leave these rows out."
                    )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """The readings of the middle joint end at the largest but a fourth of them."""
        return middle_joint_changed(
            data, lambda q: np.minimum(q, np.quantile(q, 0.75)), "readings of {} are"
        )
