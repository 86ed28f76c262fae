"""Measured positions in another unit."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from suta_calib.measurements import Samples
from suta_calib.terms import Term
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.trust.misreadings import Change, Misreading, PairReading, Pairs, scaled
from suta_calib.units import from_mm, mm

IN_MM = "the measured positions are in mm, not m"


class PositionUnit(Misreading):
    """All measured positions times 1000, or divided by it.

    Of pairs, those of one side are in mm, cm or inches, those of the other in m. What is in the
    smaller unit is left as it is, so that loops are as large as before.
    """

    name = "unit of positions"
    about = "Measured positions are in another unit than expected."
    precedence = 30

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

    def of_pairs(self, pairs: Pairs) -> Iterator[PairReading]:
        """Two for each unit."""
        # Units that positions may be in where m is asked for, m.
        for name, unit in {"mm": 1e-3, "cm": 1e-2, "inches": 0.0254}.items():
            sentence = f"if {{}}'s positions are in {name}, {{}}'s in m"
            yield (
                sentence.format("the hand", "the camera"),
                replace(pairs, seen=_times(pairs.seen, 1.0 / unit), unit=unit),
            )
            yield (
                sentence.format("the camera", "the hand"),
                replace(pairs, hand=_times(pairs.hand, 1.0 / unit), unit=unit),
            )

    def fault_of_pairs(self, pairs: Pairs) -> Pairs:
        """The hand's positions in mm."""
        return replace(pairs, hand=_times(pairs.hand, 1e3))


def _times(poses: Poses, factor: float) -> Poses:
    return poses[0], poses[1] * factor
