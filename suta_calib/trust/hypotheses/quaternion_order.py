"""Quaternions whose numbers are in another order."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import quaternion_from_rotation, rotation_from_quaternion
from suta_calib.measurements import Samples
from suta_calib.terms import Term
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.trust.misreadings import Change, Misreading, PairReading, Pairs

DESCRIPTION = "the quaternions' order is w x y z"
# Whose quaternions are in the other order: of the hand, of the eye.
ORDERS: Final = {
    f"if {whose} quaternions are in the order w x y z": sides
    for whose, sides in {
        "the hand's": (True, False),
        "the camera's": (False, True),
        "all": (True, True),
    }.items()
}


class QuaternionOrder(Misreading):
    """Numbers that were read as x y z w are w x y z."""

    name = "order of quaternions"
    about = "The four numbers of quaternions are in another order."
    precedence = 33

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """One, where orientations were measured."""
        samples = [term.poses.samples for term in terms]
        if any(s.position is not None and s.rotation is not None for s in samples):
            yield DESCRIPTION, _w_first

    def fault(self, term: Term) -> tuple[str, Samples]:
        """Quaternions w x y z, read as x y z w."""
        samples = term.poses.samples
        assert samples.rotation is not None
        return DESCRIPTION, replace(samples, rotation=_rolled(samples.rotation, 1))

    def of_pairs(self, pairs: Pairs) -> Iterator[PairReading]:
        """One for the hand, one for the eye, one for both."""
        for order, sides in ORDERS.items():
            yield order, reordered(pairs, *sides)

    def fault_of_pairs(self, pairs: Pairs) -> Pairs:
        """The eye's quaternions w x y z, read as x y z w."""
        return replace(pairs, seen=_rolled_poses(pairs.seen, 1))


def reordered(pairs: Pairs, hand: bool, seen: bool) -> Pairs:
    """Pairs as they are if the quaternions of one side, or of both, are w x y z."""
    return replace(
        pairs,
        hand=_rolled_poses(pairs.hand, -1) if hand else pairs.hand,
        seen=_rolled_poses(pairs.seen, -1) if seen else pairs.seen,
    )


def _w_first(samples: Samples) -> Samples:
    """Numbers that stand as x y z w were w x y z."""
    if samples.rotation is None:
        return samples
    return replace(samples, rotation=_rolled(samples.rotation, -1))


def _rolled_poses(poses: Poses, by: int) -> Poses:
    return _rolled(poses[0], by), poses[1]


def _rolled(rotation: FloatArray, by: int) -> FloatArray:
    """Rotations whose quaternions have every number ``by`` places further on."""
    return rotation_from_quaternion(np.roll(quaternion_from_rotation(rotation), by, axis=1))
