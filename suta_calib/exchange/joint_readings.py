"""Joint readings in other units than rad: degrees, and ticks of an encoder or a servo."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.exchange.option import Given, Option
from suta_calib.units import from_deg

COUNTS: Final = Option("counts_per_turn", "Ticks of an encoder per turn.", "N")
ZERO: Final = Option(
    "zero",
    "Reading of a joint at its zero position; a number alone is that of all other joints.",
    "joint_1=2048,…|2048",
    several=True,
)
SIGN: Final = Option("sign", "-1 for a joint that counts backwards.", "joint_1=-1,…", several=True)
RATIO: Final = Option(
    "ratio", "Turns of the encoder per turn of a joint.", "joint_1=3,…", several=True
)
READING_OPTIONS: Final = (COUNTS, ZERO, SIGN, RATIO)


@dataclass(frozen=True)
class Readings:
    """How numbers of a joint become angles: ``sign · (number − zero) · unit / ratio``.

    Attributes:
        unit: ``rad``, ``deg`` or ``ticks`` of the numbers.
        counts: ticks of one turn; of no meaning for the other units.
        zero: by joint, in the numbers' unit; 0 where not given. That of "" is of all others.
        sign: likewise, 1 or -1; 1 where not given.
        ratio: likewise, turns of the encoder per turn of the joint; 1 where not given.
    """

    unit: str
    counts: float
    zero: Mapping[str, float]
    sign: Mapping[str, float]
    ratio: Mapping[str, float]

    @classmethod
    def of(cls, given: Given, unit: str) -> Readings:
        """As the options say."""
        counts, expected = 0.0, "a whole number, such as 4096"
        if unit == "ticks":
            if COUNTS not in given:
                raise given.refuse(COUNTS, "ticks, but not the number of ticks per turn", expected)
            counts = given.whole(COUNTS, "", 1, 10**12, expected)
        sign, ratio = given.numbers(SIGN), given.numbers(RATIO)
        for name, value in sign.items():
            if value not in (-1.0, 1.0):
                raise given.refuse(SIGN, f"{name}={value:g}", "1 or -1")
        for name, value in ratio.items():
            if value == 0.0:
                raise given.refuse(RATIO, f"{name}=0", "turns of the encoder per turn of the joint")
        return cls(unit, counts, given.numbers(ZERO), sign, ratio)

    @property
    def names(self) -> set[str]:
        """Joints of which something was said."""
        return {*self.zero, *self.sign, *self.ratio} - {""}

    def angles(self, joint: str, numbers: FloatArray) -> FloatArray:
        """Angles (n,), rad, of a joint's numbers (n,)."""
        if self.unit == "ticks":
            scale = math.tau / self.counts
        else:
            scale = from_deg(1.0) if self.unit == "deg" else 1.0
        zero, sign, ratio = (
            of.get(joint, of.get("", default))
            for of, default in ((self.zero, 0.0), (self.sign, 1.0), (self.ratio, 1.0))
        )
        return np.asarray((numbers - zero) * sign * scale / ratio)
