"""Confidence intervals of a spread from a few tens of visits.

A spread is positive and its estimate is skewed, so everything happens in logarithms: the jackknife
(Efron, Stein 1981, doi:10.1214/aos/1176345462) gives the logarithm's bias and standard error, and
Student's t with as many degrees of freedom as the error itself is worth (Satterthwaite 1946,
doi:10.2307/3002019) gives the factor. It needs no random numbers and no normal distribution.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import t

from suta_calib.arrays import FloatArray

CONFIDENCE: Final = 0.95
# More rows than this are left out in blocks of neighbours: the error is known well enough.
_MOST_PARTS: Final = 400
_LEAST_FREEDOM: Final = 2.0


@dataclass(frozen=True)
class Interval:
    """A confidence interval, in the unit of what it is about."""

    low: float
    high: float

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True)
class ScatterEstimate:
    """A positive number that describes a scatter, and how well it is known.

    Attributes:
        value: as the definition gives it, m or rad.
        log_centre: logarithm of the value with the jackknife's bias taken out; -inf for zero.
        log_std: its standard error.
        freedom: degrees of freedom of that standard error.
    """

    value: float
    log_centre: float
    log_std: float
    freedom: float

    def interval(self, confidence: float = CONFIDENCE) -> Interval:
        """What the true value lies in, of visits without end under the same conditions."""
        if not math.isfinite(self.log_centre):
            return Interval(self.value, self.value)
        half = _factor(confidence, self.freedom) * self.log_std
        return Interval(math.exp(self.log_centre - half), math.exp(self.log_centre + half))


def spread(statistic: Callable[[FloatArray], float], rows: FloatArray) -> ScatterEstimate:
    """A statistic of rows (n, …), n at least three, with its uncertainty by the jackknife."""
    value = statistic(rows)
    parts = np.array_split(np.arange(len(rows)), min(len(rows), _MOST_PARTS))
    left = np.array([statistic(np.delete(rows, part, axis=0)) for part in parts])
    if value <= 0 or (left <= 0).any():
        return ScatterEstimate(value, -math.inf, 0.0, _LEAST_FREEDOM)
    n, logs = len(parts), np.log(left)
    influence = logs - logs.mean()
    power = float(np.sum(influence**2))
    return ScatterEstimate(
        value,
        n * math.log(value) - (n - 1) * float(logs.mean()),
        math.sqrt((n - 1) / n * power),
        _freedom(influence, power),
    )


def _freedom(influence: FloatArray, power: float) -> float:
    """How much a sum of squares is worth: few large influences make it worth little."""
    n = len(influence)
    if power == 0:
        return float(n - 1)
    excess = n * float(np.sum(influence**4)) / power**2 - 1.0
    return min(n - 1.0, max(_LEAST_FREEDOM, 2.0 * n / max(excess, 1e-12)))


def ratio(
    first: ScatterEstimate, second: ScatterEstimate, confidence: float = CONFIDENCE
) -> Interval:
    """Interval of ``second / first`` for independent visits: Welch's t on the logarithms."""
    if not (math.isfinite(first.log_centre) and math.isfinite(second.log_centre)):
        return Interval(math.nan, math.nan)
    a, b = first.log_std**2, second.log_std**2
    weight = a**2 / first.freedom + b**2 / second.freedom
    freedom = (a + b) ** 2 / weight if weight > 0 else math.inf
    half = _factor(confidence, freedom) * math.sqrt(a + b)
    centre = second.log_centre - first.log_centre
    return Interval(math.exp(centre - half), math.exp(centre + half))


def difference(
    first: ScatterEstimate, second: ScatterEstimate, confidence: float = CONFIDENCE
) -> Interval:
    """Interval of ``second - first`` from both their intervals.

    Zou, Donner (2008), doi:10.1002/sim.3095: each end is as far off as the ends that cause it.
    """
    one, two = first.interval(confidence), second.interval(confidence)
    middle = _centre(second) - _centre(first)
    below = math.hypot(_centre(second) - two.low, one.high - _centre(first))
    above = math.hypot(two.high - _centre(second), _centre(first) - one.low)
    return Interval(middle - below, middle + above)


def _centre(each: ScatterEstimate) -> float:
    return math.exp(each.log_centre) if math.isfinite(each.log_centre) else each.value


def _factor(confidence: float, freedom: float) -> float:
    return float(t.ppf(0.5 + confidence / 2, freedom))
