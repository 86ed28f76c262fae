"""Rows that show to the last digit what others show from elsewhere."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from suta_calib.measurements.samples import hashed
from suta_calib.terms import Term
from suta_calib.trust.hypothesis import Pattern, SpoiltData


class StuckInstrument(Pattern):
    """The measured position is equal to an earlier one, though the arm had moved."""

    name: ClassVar[str] = "stuck instrument"
    about: ClassVar[str] = "The instrument repeats its last value while the arm moves."
    precedence: ClassVar[int] = 22

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
                    f"{len(again)} rows of {term.kind.replace('_', ' ')}, "
                    f"{samples.origin[again[0]]} the first, show to the last digit where "
                    "something stood in a row before, though the arm had moved: did the "
                    "instrument repeat its last value, or were rows copied? Leave them out."
                )

    def spoil(self, data: Any, values: Mapping[str, float], rng: np.random.Generator) -> SpoiltData:
        """Three rows repeat the position of the one before."""
        del values, rng
        term: Term = data
        samples = term.poses.samples
        assert samples.position is not None
        position = samples.position.copy()
        position[11:14] = position[10]
        stuck = term.poses.with_samples(replace(samples, position=position))
        return SpoiltData(term.over_poses(stuck), np.zeros(0), "repeat its last value")
