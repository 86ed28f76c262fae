"""Measured positions in a left-handed frame."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from suta_calib.terms import Term
from suta_calib.trust.misreadings import Change, Misreading, PairReading, Pairs, scaled
from suta_calib.words import listed


class LeftHanded(Misreading):
    """One coordinate of all measured positions with the other sign.

    Positions alone say no more than that one of the axes is mirrored; turns say which.
    """

    name = "left-handed instrument"
    about = "Measured positions are in a left-handed frame."
    precedence = 31

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """One, or three where orientations were measured too."""
        samples = [term.poses.samples for term in terms]
        if not any(s.position is not None for s in samples):
            return
        frame = "the instrument's frame is left-handed"
        yield frame, partial(scaled, np.array([1.0, -1.0, 1.0]))
        if any(s.rotation is not None for s in samples):
            for axis, factors in (("x", [-1.0, 1.0, 1.0]), ("z", [1.0, 1.0, -1.0])):
                yield f"{frame}: {axis} has the wrong sign", partial(scaled, np.array(factors))

    def of_pairs(self, pairs: Pairs) -> Iterator[PairReading]:
        """One for each choice of axes, and one for a frame that is left-handed."""
        for signs in product((1.0, -1.0), repeat=3):
            axes = [axis for axis, sign in zip("xyz", signs, strict=True) if sign < 0.0]
            # All three are what a left-handed frame makes of them, turned.
            if 0 < len(axes) < 3:
                have = "have" if axes[1:] else "has"
                sentence = f"if {listed(axes)} of the camera's positions {have} the wrong sign"
                yield f"{sentence}, its rotations not", _signed(pairs, signs)
        # That of the hand is the same, with X and Z mirrored.
        (rotation, position), mirror = pairs.seen, np.array([-1.0, 1.0, 1.0])
        mirrored = rotation * np.outer(mirror, mirror), position * mirror
        yield "if the hand's or the camera's frame is left-handed", replace(pairs, seen=mirrored)

    def fault_of_pairs(self, pairs: Pairs) -> Pairs:
        """The eye's x has the wrong sign."""
        return _signed(pairs, (-1.0, 1.0, 1.0))


def _signed(pairs: Pairs, signs: Sequence[float]) -> Pairs:
    rotation, position = pairs.seen
    return replace(pairs, seen=(rotation, position * np.array(signs)))
