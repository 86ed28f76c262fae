"""Quaternions of pairs of poses whose numbers stand in another order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, ClassVar, Final

import numpy as np

from suta_calib.geometry.numbers import quaternion_from_rotation, rotation_from_quaternion
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.trust.pair_readings import MisreadPairs, Pairs, Reading

# Whose quaternions are in the other order: of the hand, of the eye.
ORDERS: Final = {
    f"if {whose} quaternions are in the order w x y z": sides
    for whose, sides in {
        "the hand's": (True, False),
        "the eye's": (False, True),
        "all": (True, True),
    }.items()
}


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


def _rolled(poses: Poses, by: int) -> Poses:
    quaternion = quaternion_from_rotation(poses[0])
    return rotation_from_quaternion(np.roll(quaternion, by, axis=1)), poses[1]
