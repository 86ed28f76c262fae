"""Measured positions in a left-handed frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import ClassVar

import numpy as np

from suta_calib.terms import Term
from suta_calib.trust.sample_readings import Change, MisreadSamples, scaled


class LeftHanded(MisreadSamples):
    """One coordinate of all measured positions with the other sign.

    Positions alone say no more than that one of the axes is mirrored; turns say which.
    """

    name: ClassVar[str] = "left-handed instrument"
    about: ClassVar[str] = "Measured positions are in a left-handed frame."
    precedence: ClassVar[int] = 31

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
