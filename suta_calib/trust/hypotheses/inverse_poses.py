"""Measured poses that map the other way."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from suta_calib.measurements import Samples
from suta_calib.terms import Term
from suta_calib.trust.sample_readings import Change, MisreadSamples

DESCRIPTION = "the measured poses are inverted"


class InversePoses(MisreadSamples):
    """``(R, p) → (Rᵀ, -Rᵀ p)``: the instrument in the target's frame, in place of the target."""

    name: ClassVar[str] = "inverse poses"
    about: ClassVar[str] = "Measured poses map the other way."
    precedence: ClassVar[int] = 32

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """One, where poses were measured."""
        samples = [term.poses.samples for term in terms]
        if any(s.position is not None and s.rotation is not None for s in samples):
            yield DESCRIPTION, inverted


def inverted(samples: Samples) -> Samples:
    """Every measured pose as its inverse."""
    if samples.position is None or samples.rotation is None:
        return samples
    inverse = np.swapaxes(samples.rotation, 1, 2)
    position = -np.einsum("nij,nj->ni", inverse, samples.position)
    return replace(samples, rotation=inverse, position=position)
