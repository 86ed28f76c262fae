"""Rotation matrices that were written column by column."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from suta_calib.terms.hand_eye_start import Poses
from suta_calib.trust.pair_readings import MisreadPairs, Pairs, Reading


class TransposedRotations(MisreadPairs):
    """Rotations of the hand, or of the eye, are inverted and positions are not."""

    name: ClassVar[str] = "transposed rotations"
    about: ClassVar[str] = "The rotations of the hand or of the eye are transposed."

    def readings(self, data: Any) -> Iterator[Reading]:
        """One for the hand, one for the eye."""
        sentence = "if {}'s rotations are transposed, its positions not"
        yield sentence.format("the hand"), replace(data, hand=_transposed(data.hand))
        yield sentence.format("the eye"), replace(data, seen=_transposed(data.seen))

    def fault(self, pairs: Pairs) -> Pairs:
        """The eye's rotations transposed."""
        return replace(pairs, seen=_transposed(pairs.seen))


def _transposed(poses: Poses) -> Poses:
    return np.swapaxes(poses[0], 1, 2), poses[1]
