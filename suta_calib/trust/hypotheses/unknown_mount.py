"""A target that is on the tip's link, but not at the tip."""

from collections.abc import Iterator

import numpy as np

from suta_calib.solver.problem import Problem
from suta_calib.terms import Term
from suta_calib.trust import Reinterpretation, SpoiltData, Truth
from suta_calib.trust.simulated_faults import displaced, random_shift


class UnknownMount(Reinterpretation):
    """Where the target sits on the tip's link is estimated (`Term.on_unknown_mount`)."""

    name = "unknown mount"
    about = "The target is fixed to the tip's link, but not at the tip."
    precedence = 83
    tried = "fitted"

    def readings(self, data: Problem) -> Iterator[tuple[str, tuple[Term, ...]]]:
        """One, where a kind knows such a mount."""
        mounted = [term.on_unknown_mount for term in data.terms]
        descriptions = [other[0] for other in mounted if other is not None]
        if descriptions:
            pairs = zip(mounted, data.terms, strict=True)
            terms = tuple(term if other is None else other[1] for other, term in pairs)
            yield descriptions[0], terms

    def spoil(self, data: Term, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """The target 3 cm away from the tip."""
        twist = np.zeros((len(data.poses), 6))
        twist[:, :3] = data.poses.at(values)[0] @ random_shift(rng, 0.03)
        reading = data.on_unknown_mount
        description = "" if reading is None else reading[0]
        return SpoiltData(displaced(data, values, twist), effect=description)
