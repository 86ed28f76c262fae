"""Overlapping Allan deviation: how much two successive averages over a time τ differ.

Allan (1966), doi:10.1109/PROC.1966.4634; formulas as in Riley (2008), Handbook of Frequency
Stability Analysis, NIST SP 1065, with a joint's reading in place of the fractional frequency. White
noise falls with 1/√τ, a drift rises with τ; the minimum tells how long averaging helps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import chi2

from suta_calib.arrays import FloatArray

_PER_DECADE: Final = 8
# Of a record shorter than this many averages little is known.
_LEAST_AVERAGES: Final = 9


@dataclass(frozen=True, eq=False)
class AllanDeviation:
    """Overlapping Allan deviation of readings at a steady rate.

    Attributes:
        tau: (k,) averaging times, s, increasing.
        deviation: (k,) in the unit of the readings.
        low, high: (k,) 95 % interval, exact for white noise.
    """

    tau: FloatArray
    deviation: FloatArray
    low: FloatArray
    high: FloatArray

    @property
    def best(self) -> int:
        """Index of the smallest deviation: averaging longer helps no more."""
        return int(np.argmin(self.deviation))

    @property
    def bottomed(self) -> bool:
        """Whether it rises again beyond the smallest, so that the record shows the best time."""
        return bool((self.low[self.best :] > self.deviation[self.best]).any())


def allan_deviation(
    readings: FloatArray, period: float, confidence: float = 0.95
) -> AllanDeviation:
    """Of readings (n,) every ``period`` s, n at least 18, at some eight times in a decade."""
    n = len(readings)
    decades = np.log10(n // _LEAST_AVERAGES)
    sizes = np.unique(np.logspace(0, decades, int(_PER_DECADE * decades) + 1).astype(int))
    deviation = np.array([overlapping(readings, int(m)) for m in sizes])
    freedom = _freedom(n, sizes)
    tail = (1 - confidence) / 2
    return AllanDeviation(
        period * sizes,
        deviation,
        deviation * np.sqrt(freedom / chi2.isf(tail, freedom)),
        deviation * np.sqrt(freedom / chi2.ppf(tail, freedom)),
    )


def overlapping(readings: FloatArray, size: int) -> float:
    """Overlapping Allan deviation of readings (n,) for averages over ``size`` of them."""
    sums = np.concatenate([[0.0], np.cumsum(readings - readings.mean())])
    averages = (sums[size:] - sums[:-size]) / size
    steps = averages[size:] - averages[:-size]
    return float(np.sqrt(0.5 * np.mean(steps**2)))


def _freedom(n: int, m: FloatArray) -> FloatArray:
    """Degrees of freedom for white noise of the readings, NIST SP 1065, table 5."""
    return np.asarray(
        (3 * (n - 1) / (2 * m) - 2 * (n - 2) / n) * 4 * m**2 / (4 * m**2 + 5), dtype=float
    )
