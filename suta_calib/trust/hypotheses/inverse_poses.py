"""Measured poses that are inverted."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from suta_calib.measurements import Samples
from suta_calib.terms import Term
from suta_calib.terms.hand_eye_start import inverse_poses
from suta_calib.trust.hypotheses.quaternion_order import ORDERS, reordered
from suta_calib.trust.misreadings import Change, Misreading, PairReading, Pairs


class InversePoses(Misreading):
    """``(R, p) → (Rᵀ, -Rᵀ p)``: the instrument in the target's frame, in place of the target.

    Of pairs an eye in the hand is taken for one beside it; with both poses the other way round X
    and Z only change places. Quaternions may be in another order as well.
    """

    name = "inverse poses"
    about = "Measured poses are inverted: they map from B to A instead of from A to B."
    precedence = 32

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """One, where poses were measured."""
        samples = [term.poses.samples for term in terms]
        if any(s.position is not None and s.rotation is not None for s in samples):
            yield "the measured poses are inverted", inverted

    def of_pairs(self, pairs: Pairs) -> Iterator[PairReading]:
        """One for each order of the quaternions."""
        turned = "if setup is {other}, or if the poses of the hand or of the camera are inverted"
        yield turned, replace(pairs, hand=inverse_poses(pairs.hand))
        for order, sides in ORDERS.items():
            read = reordered(pairs, *sides)
            yield f"{order} and {turned}", replace(read, hand=inverse_poses(read.hand))

    def fault_of_pairs(self, pairs: Pairs) -> Pairs:
        """The target's poses inverted."""
        return replace(pairs, seen=inverse_poses(pairs.seen))


def inverted(samples: Samples) -> Samples:
    """Every measured pose as its inverse."""
    if samples.position is None or samples.rotation is None:
        return samples
    rotation, position = inverse_poses((samples.rotation, samples.position))
    return replace(samples, rotation=rotation, position=position)
