"""Poses of a hand or an eye that map in the other direction, or that are of the other setup."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, ClassVar

from suta_calib.terms.hand_eye_start import inverse_poses
from suta_calib.trust.hypotheses.pair_quaternions import ORDERS, reordered
from suta_calib.trust.pair_readings import MisreadPairs, Pairs, Reading


class InvertedPoses(MisreadPairs):
    """``T_hand_base`` in place of ``T_base_hand``: an eye in the hand is taken for one beside it.

    With both poses the other way round X and Z only change places. Quaternions may be in another
    order as well.
    """

    name: ClassVar[str] = "inverted poses"
    about: ClassVar[str] = "The poses of the hand or of the eye map in the other direction."

    def readings(self, data: Any) -> Iterator[Reading]:
        """One for each order of the quaternions."""
        turned = "if setup is {other}, or else if the hand's or the eye's poses are inverted"
        yield turned, inverted(data)
        for order, sides in ORDERS.items():
            yield (
                f"{order} and {turned}",
                inverted(reordered(data, *sides)),
            )

    def fault(self, pairs: Pairs) -> Pairs:
        """The target's poses inverted."""
        return replace(pairs, seen=inverse_poses(pairs.seen))


def inverted(pairs: Pairs) -> Pairs:
    """Pairs with the hand's poses inverted."""
    return replace(pairs, hand=inverse_poses(pairs.hand))
