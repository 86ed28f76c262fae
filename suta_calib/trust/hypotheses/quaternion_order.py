"""Quaternions whose numbers stand in another order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, ClassVar, Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import quaternion_from_rotation, rotation_from_quaternion
from suta_calib.measurements import Samples
from suta_calib.terms import Term
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.trust.pair_readings import MisreadPairs, Pairs, Reading
from suta_calib.trust.sample_readings import Change, MisreadSamples

DESCRIPTION = "the quaternions' order is w x y z"
# Whose quaternions are in the other order: of the hand, of the eye.
ORDERS: Final = {
    f"if {whose} quaternions are in the order w x y z": sides
    for whose, sides in {
        "the hand's": (True, False),
        "the eye's": (False, True),
        "all": (True, True),
    }.items()
}


class QuaternionOrder(MisreadSamples):
    """Numbers that were read as x y z w are w x y z."""

    name: ClassVar[str] = "order of quaternions"
    about: ClassVar[str] = "The four numbers of quaternions stand in another order."
    precedence: ClassVar[int] = 33

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """One, where orientations were measured."""
        samples = [term.poses.samples for term in terms]
        if any(s.position is not None and s.rotation is not None for s in samples):
            yield DESCRIPTION, _w_first

    def fault(self, term: Term) -> tuple[str, Samples]:
        """Quaternions w x y z, read as x y z w."""
        samples = term.poses.samples
        assert samples.rotation is not None
        return DESCRIPTION, replace(samples, rotation=rolled(samples.rotation, 1))


class PairQuaternions(MisreadPairs):
    """Numbers that were read as x y z w are w x y z."""

    name: ClassVar[str] = "order of quaternions of pairs"
    about: ClassVar[str] = "The four numbers of the hand's or the eye's quaternions are exchanged."

    def readings(self, data: Any) -> Iterator[Reading]:
        """One for the hand, one for the eye, one for both."""
        for order, sides in ORDERS.items():
            yield order, reordered(data, *sides)

    def fault(self, pairs: Pairs) -> Pairs:
        """The eye's quaternions w x y z, read as x y z w."""
        return replace(pairs, seen=_rolled(pairs.seen, 1))


def reordered(pairs: Pairs, hand: bool, seen: bool) -> Pairs:
    """Pairs as they are if the quaternions of one side, or of both, are w x y z."""
    return replace(
        pairs,
        hand=_rolled(pairs.hand, -1) if hand else pairs.hand,
        seen=_rolled(pairs.seen, -1) if seen else pairs.seen,
    )


def _w_first(samples: Samples) -> Samples:
    """Numbers that stand as x y z w were w x y z."""
    if samples.rotation is None:
        return samples
    return replace(samples, rotation=rolled(samples.rotation, -1))


def _rolled(poses: Poses, by: int) -> Poses:
    return rolled(poses[0], by), poses[1]


def rolled(rotation: FloatArray, by: int) -> FloatArray:
    """Rotations whose quaternions have every number ``by`` places further on."""
    return rotation_from_quaternion(np.roll(quaternion_from_rotation(rotation), by, axis=1))
