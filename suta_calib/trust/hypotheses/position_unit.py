"""Measured positions in another unit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import ClassVar

import numpy as np

from suta_calib.measurements import Samples
from suta_calib.terms import Term
from suta_calib.trust.sample_readings import Change, MisreadSamples, scaled
from suta_calib.units import from_mm, mm

IN_MM = "the measured positions are in mm, not m"


class PositionUnit(MisreadSamples):
    """All measured positions times 1000, or divided by it."""

    name: ClassVar[str] = "unit of positions"
    about: ClassVar[str] = "Measured positions are in another unit."
    precedence: ClassVar[int] = 30

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """Two, where positions were measured."""
        if any(term.poses.samples.position is not None for term in terms):
            yield IN_MM, partial(scaled, np.full(3, from_mm(1.0)))
            divided = "the measured positions are in m, but were divided by 1000"
            yield divided, partial(scaled, np.full(3, mm(1.0)))

    def fault(self, term: Term) -> tuple[str, Samples]:
        """Positions in mm."""
        samples = term.poses.samples
        return IN_MM, scaled(np.full(3, mm(1.0)), samples)
