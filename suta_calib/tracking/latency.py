"""How long something takes, over any number of times, in constant memory."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.units import ms

# s; shorter and longer ones share the outermost bins.
SHORTEST: Final = 1e-6
LONGEST: Final = 100.0
# Ratio of a bin's edges: percentiles are right to half of this.
RATIO: Final = 1.02
_PER_BIN: Final = 1.0 / math.log(RATIO)
_BINS: Final = math.ceil(math.log(LONGEST / SHORTEST) * _PER_BIN) + 1


class LatencyStatistics:
    """Percentiles within 1 %, exact mean, standard deviation and maximum."""

    def __init__(self) -> None:
        self.count = 0
        self.maximum = 0.0
        self._sum = self._sum_of_squares = 0.0
        # A list: counting in one costs a quarter of what it costs in an array.
        self._bins = [0] * _BINS

    def add(self, seconds: float) -> None:
        """Count one."""
        self.count += 1
        self._sum += seconds
        self._sum_of_squares += seconds * seconds
        if seconds > self.maximum:
            self.maximum = seconds
        index = int(math.log(seconds / SHORTEST) * _PER_BIN) if seconds > SHORTEST else 0
        self._bins[min(index, _BINS - 1)] += 1

    @property
    def mean(self) -> float:
        """Mean, s; NaN before the first."""
        return self._sum / self.count if self.count else math.nan

    @property
    def jitter(self) -> float:
        """Standard deviation, s; NaN before the first."""
        if not self.count:
            return math.nan
        return math.sqrt(max(self._sum_of_squares / self.count - self.mean**2, 0.0))

    def percentile(self, percent: float) -> float:
        """The time that ``percent`` % do not exceed, s; NaN before the first."""
        if not self.count:
            return math.nan
        cumulative = np.cumsum(self._bins)
        index = int(np.searchsorted(cumulative, percent / 100.0 * self.count))
        middle = SHORTEST * RATIO ** (index + 0.5)
        return float(min(middle, self.maximum))

    def histogram(self) -> tuple[FloatArray, FloatArray]:
        """Edges (bins + 1,) s and counts (bins,), from the first to the last that is not empty."""
        counts = np.array(self._bins, dtype=float)
        filled = np.flatnonzero(counts)
        if not filled.size:
            return np.array([SHORTEST, SHORTEST * RATIO]), np.zeros(1)
        first, last = int(filled[0]), int(filled[-1]) + 1
        edges = np.exp(math.log(SHORTEST) + math.log(RATIO) * np.arange(first, last + 1))
        return edges, counts[first:last]

    def summary(self) -> dict[str, float | int]:
        """Count, and ``mean_ms``, ``jitter_ms`` and percentiles for JSON."""
        figures: dict[str, float | int] = {"count": self.count}
        figures |= {f"p{p:g}_ms": ms(self.percentile(p)) for p in (50, 95, 99)}
        figures |= {"max_ms": ms(self.maximum) if self.count else math.nan}
        return figures | {"mean_ms": ms(self.mean), "jitter_ms": ms(self.jitter)}
