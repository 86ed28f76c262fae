"""The uncertainty of a standard as its certificate states it: ``15 um + 6 um/m (k = 2)``."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final

from suta_calib.display import Displayable

# Lengths in m; parts per length.
LENGTHS: Final = {"nm": 1e-9, "um": 1e-6, "mm": 1e-3, "m": 1.0}
PER_LENGTH: Final = {"um/m": 1e-6, "mm/m": 1e-3, "ppm": 1e-6}
# Of standards that are no lengths: thermometers, weights, inclinometers. They are not compared.
OTHERS: Final = (
    *("K", "degC", "°C", "%", "deg", "°", "mrad", "urad", "rad", "arcsec", "g", "kg", "mg"),
    *("N", "Pa", "hPa", "s", "px"),
)
EXPECTED: Final = "an uncertainty such as 2 um (k = 2), or 15 um + 6 um/m (k = 2)"
NUMBER: Final = r"[0-9]+(?:\.[0-9]+)?(?:e[-+]?[0-9]+)?"
TERM: Final = re.compile(rf"({NUMBER})\s*(\S+)")
FACTOR: Final = re.compile(rf"(.*?)\s*\(\s*k\s*=\s*({NUMBER})\s*\)")


@dataclass(frozen=True)
class LengthUncertainty(Displayable):
    """Standard uncertainty of a length: a constant, and a share of the length, added.

    Attributes:
        constant: m.
        per_length: of the length.
    """

    constant: float = 0.0
    per_length: float = 0.0

    def lengths_within(self, other: LengthUncertainty) -> tuple[float, float]:
        """From which to which length, m, this is no more than another one; (nan, nan) for none."""
        spare = other.constant - self.constant
        slope = other.per_length - self.per_length
        if spare >= 0.0 and slope >= 0.0:
            return 0.0, math.inf
        if spare > 0.0:
            return 0.0, spare / -slope
        return (-spare / slope, math.inf) if slope > 0.0 else (math.nan, math.nan)


@dataclass(frozen=True)
class StandardsUncertainty(Displayable):
    """What a certificate of a standard states.

    Attributes:
        text: as it is written.
        std: of a length; None for a quantity that is no length.
    """

    text: str
    std: LengthUncertainty | None


def stated_uncertainty(text: str) -> StandardsUncertainty:
    """Read such a text; one without ``(k = …)`` counts as a standard uncertainty.

    Raises:
        ValueError: it is none; says what was found.
    """
    words = text.strip().replace("µ", "u").replace("μ", "u").removeprefix("±").strip()
    factor = 1.0
    if found := FACTOR.fullmatch(words):
        words, factor = found[1], float(found[2])
        if not 1.0 <= factor <= 20.0:
            raise ValueError(f"a coverage factor of {factor:g}")
    constant = per_length = 0.0
    units = set[str]()
    for part in words.split(" + ") if " + " in words else words.split("+"):
        term = TERM.fullmatch(part.strip())
        if term is None:
            raise ValueError(text)
        size, unit = float(term[1]), term[2]
        if unit not in {*LENGTHS, *PER_LENGTH, *OTHERS} or not 0.0 < size < math.inf:
            raise ValueError(text)
        units.add(unit if unit in OTHERS else "")
        constant += size * LENGTHS.get(unit, 0.0) / factor
        per_length += size * PER_LENGTH.get(unit, 0.0) / factor
    if len(units) > 1:
        raise ValueError(text)
    return StandardsUncertainty(
        text, LengthUncertainty(constant, per_length) if "" in units else None
    )
