"""Rotation matrices that were written column by column."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from suta_calib.terms.hand_eye import HandEye
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.trust.misreadings import Misreading, PairReading, Pairs


class TransposedRotations(Misreading):
    """Rotations of the hand, or of the eye, are inverted and positions are not."""

    name = "transposed rotations"
    applies_to = (HandEye,)
    needs_arm = False
    about = "The rotation matrices of the hand or of the camera are transposed."

    def of_pairs(self, pairs: Pairs) -> Iterator[PairReading]:
        """One for the hand, one for the eye."""
        sentence = "if {}'s rotations are transposed, its positions not"
        yield sentence.format("the hand"), replace(pairs, hand=_transposed(pairs.hand))
        yield sentence.format("the camera"), replace(pairs, seen=_transposed(pairs.seen))

    def fault_of_pairs(self, pairs: Pairs) -> Pairs:
        """The eye's rotations transposed."""
        return replace(pairs, seen=_transposed(pairs.seen))


def _transposed(poses: Poses) -> Poses:
    return np.swapaxes(poses[0], 1, 2), poses[1]
