"""Positions of a hand in another unit than those of its eye."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, ClassVar, Final

from suta_calib.terms.hand_eye_start import Poses
from suta_calib.trust.pair_readings import MisreadPairs, Pairs, Reading

# Units that positions may be in where m is asked for, m.
UNITS: Final = {"mm": 1e-3, "cm": 1e-2, "inches": 0.0254}


class PairUnits(MisreadPairs):
    """The positions of one side are in mm, cm or inches, those of the other in m.

    What is in the smaller unit is left as it is, so that loops are as large as before.
    """

    name: ClassVar[str] = "units of pairs"
    about: ClassVar[str] = "The hand's positions are in another unit than the eye's."

    def readings(self, data: Any) -> Iterator[Reading]:
        """Two for each unit."""
        for name, unit in UNITS.items():
            sentence = f"if {{}}'s positions are in {name}, {{}}'s in m"
            yield (
                sentence.format("the hand", "the eye"),
                replace(data, seen=_times(data.seen, 1.0 / unit), unit=unit),
            )
            yield (
                sentence.format("the eye", "the hand"),
                replace(data, hand=_times(data.hand, 1.0 / unit), unit=unit),
            )

    def fault(self, pairs: Pairs) -> Pairs:
        """The hand's positions in mm."""
        return replace(pairs, hand=_times(pairs.hand, 1e3))


def _times(poses: Poses, factor: float) -> Poses:
    return poses[0], poses[1] * factor
