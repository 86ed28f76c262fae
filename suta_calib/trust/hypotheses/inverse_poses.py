"""Measured poses that map the other way."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, ClassVar

from suta_calib.measurements import Samples
from suta_calib.terms import Term
from suta_calib.terms.hand_eye_start import inverse_poses
from suta_calib.trust.hypotheses.quaternion_order import ORDERS, reordered
from suta_calib.trust.pair_readings import MisreadPairs, Pairs, Reading
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


class InvertedPoses(MisreadPairs):
    """``T_hand_base`` in place of ``T_base_hand``: an eye in the hand is taken for one beside it.

    With both poses the other way round X and Z only change places. Quaternions may be in another
    order as well.
    """

    name: ClassVar[str] = "inverse poses of pairs"
    about: ClassVar[str] = "The poses of the hand or of the eye map in the other direction."

    def readings(self, data: Any) -> Iterator[Reading]:
        """One for each order of the quaternions."""
        turned = "if setup is {other}, or else if the hand's or the eye's poses are inverted"
        yield turned, _hand_inverted(data)
        for order, sides in ORDERS.items():
            yield (
                f"{order} and {turned}",
                _hand_inverted(reordered(data, *sides)),
            )

    def fault(self, pairs: Pairs) -> Pairs:
        """The target's poses inverted."""
        return replace(pairs, seen=inverse_poses(pairs.seen))


def inverted(samples: Samples) -> Samples:
    """Every measured pose as its inverse."""
    if samples.position is None or samples.rotation is None:
        return samples
    rotation, position = inverse_poses((samples.rotation, samples.position))
    return replace(samples, rotation=rotation, position=position)


def _hand_inverted(pairs: Pairs) -> Pairs:
    return replace(pairs, hand=inverse_poses(pairs.hand))
