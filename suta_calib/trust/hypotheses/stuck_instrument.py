"""Rows that repeat an earlier position to the last digit, although the arm moved."""

from collections.abc import Iterator, Sequence

import numpy as np

from suta_calib.measurements.samples import hashed
from suta_calib.terms import Term
from suta_calib.trust import Pattern, SpoiltData, Truth
from suta_calib.trust.simulated_faults import with_columns


class StuckInstrument(Pattern):
    """The measured position is equal to an earlier one, though the arm had moved."""

    name = "stuck instrument"
    about = "The instrument repeats its last value while the arm moves."
    precedence = 22

    def of_terms(self, terms: Sequence[Term]) -> Iterator[str]:
        """One for each term."""
        for term in terms:
            samples = term.poses.samples
            if samples.position is None:
                continue
            tip, position = term.poses.at({})[1], samples.position
            _, first, which = np.unique(hashed(position), return_index=True, return_inverse=True)
            before = first[which.reshape(-1)]
            # Way of the tip, m, after which no instrument shows the same to the last digit: none is
            # so coarse.
            moved = np.linalg.norm(tip - tip[before], axis=1) > 0.01
            again = np.flatnonzero(moved & np.all(position == position[before], axis=1))
            if len(again):
                yield (
                    f"{len(again)} rows of {term.called} "
                    f"({samples.origin[again[0]]} is the first) repeat to the last digit the "
                    "position of an earlier row, though the arm had moved. Did the instrument "
                    "repeat its last value, or were rows copied? Leave these rows out."
                )

    def spoil(self, data: Term, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """Three rows repeat the position of the one before."""
        samples = data.poses.samples
        assert samples.position is not None
        position = samples.position.copy()
        position[11:14] = position[10]
        return SpoiltData(with_columns(data, position=position), effect="repeat its last value")
