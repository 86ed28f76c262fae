"""Regularised incomplete gamma and beta functions of one number, and what inverts them.

`scipy.special` has the same, and takes as long to import as all else that a short command does:
`distributions` asks it for arrays, and for more degrees of freedom than `MOST`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

# Arguments up to which the factor before a fraction keeps eleven digits: its logarithm is a
# difference of logarithms of gamma functions as large as they are.
MOST: Final = 5000.0
# The same where the other argument is one at most: there the fraction loses digits, not the factor.
MOST_BESIDE_ONE: Final = 5e5
# First argument of the beta function from which on, beside one of up to one, its logarithm is found
# without a difference of large numbers.
LARGE: Final = 1000.0
_SMALL: Final = 1e-300
_ROUNDING: Final = 1e-15
_LAST_DIGITS: Final = 4e-15


def gamma_tails(a: float, x: float) -> tuple[float, float]:
    """P(a, x) and Q(a, x) = 1 - P(a, x), the smaller of which has all its digits.

    The series DLMF 8.11.4 below the mode, the continued fraction DLMF 8.9.2 above it.

    Args:
        a: above zero, up to `MOST`.
        x: zero or above.
    """
    if x <= 0.0:
        return 0.0, 1.0
    factor = math.exp(a * math.log(x) - x - math.lgamma(a))
    if x < a + 1.0:
        power, total, k = 1.0 / a, 0.0, a
        while power > total * _ROUNDING:
            total += power
            k += 1.0
            power *= x / k
        below = factor * total
        return below, 1.0 - below
    first = x + 1.0 - a
    above = factor / _fraction(first, lambda k: (k * (a - k), first + 2.0 * k))
    return 1.0 - above, above


def beta_tail(a: float, b: float, x: float, y: float) -> float:
    """I_x(a, b), by the continued fraction DLMF 8.17.22.

    Args:
        a: above zero.
        b: likewise, together up to `MOST`; to `MOST_BESIDE_ONE` where one of them is one at most.
        x: from zero to one.
        y: 1 - x, which may have digits that a difference would not have.
    """
    if x <= 0.0 or y <= 0.0:
        return float(x > 0.0)
    if x > (a + 1.0) / (a + b + 2.0):
        return 1.0 - beta_tail(b, a, y, x)
    logarithms = [math.log(x) if x < 0.5 else math.log1p(-y), math.log(y)]
    if y >= 0.5:
        logarithms[1] = math.log1p(-x)
    factor = math.exp(a * logarithms[0] + b * logarithms[1] - _log_beta(a, b)) / a

    def term(k: int) -> tuple[float, float]:
        m, odd = divmod(k, 2)
        if odd:
            return -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1)), 1.0
        return m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)), 1.0

    return factor / _fraction(1.0, term)


def _log_beta(a: float, b: float) -> float:
    """Log B(a, b), by DLMF 5.11.8 where one argument is large and the other is not."""
    small, large = sorted((a, b))
    if large < LARGE or small > 1.0:
        return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)
    # Bernoulli's polynomials of the second, third and fourth degree, less what they are at zero.
    second = small * (small - 1.0)
    third, fourth = second * (small - 0.5), second**2
    rest = second / (2.0 * large) - third / (6.0 * large**2) + fourth / (12.0 * large**3)
    return math.lgamma(small) - small * math.log(large) - rest


def where(share: Callable[[float], float], chance: float) -> float:
    """The least x, zero or above, at which a share comes to a chance, but for rounding.

    By false position on the share's logarithm, as the Illinois algorithm has it (Dowell and Jarratt
    1971, doi:10.1007/BF01934364), between powers of two: that of a tail is nearly a parabola there.

    Args:
        share: that rises or falls from x to x, all the way. Infinity is the answer where it comes
            to the chance at no number.
        chance: above zero.
    """
    at_zero = share(0.0)
    if at_zero == chance:
        return 0.0
    sign = 1.0 if at_zero < chance else -1.0

    def off(x: float) -> float:
        """Below zero before the answer, and above it beyond."""
        found = share(x)
        return sign * (math.log(found / chance) if found > 0.0 else -math.inf)

    low, high, before, beyond = 0.0, 1.0, -math.inf, off(1.0)
    while beyond < 0.0:
        low, high, before = high, 2.0 * high, beyond
        if high == math.inf:
            return high
        beyond = off(high)
    while low == 0.0 < high:
        if (found := off(0.5 * high)) < 0.0:
            low, before = 0.5 * high, found
        else:
            high, beyond = 0.5 * high, found
    last = 0.0
    while True:
        part = beyond / (beyond - before) if math.isfinite(beyond - before) else 0.5
        x = high - part * (high - low)
        if not low < x < high or abs(found := off(x)) <= _LAST_DIGITS:
            return x
        # An end that stays a second time counts half, so that the other comes nearer.
        if found < 0.0:
            low, before, beyond = x, found, beyond * (0.5 if last < 0.0 else 1.0)
        else:
            high, beyond, before = x, found, before * (0.5 if last > 0.0 else 1.0)
        last = found


def _fraction(first: float, term: Callable[[int], tuple[float, float]]) -> float:
    """A continued fraction, ``first + p₁ / (q₁ + p₂ / (q₂ + …))``, by Lentz's method.

    Lentz (1976), doi:10.1364/AO.15.000668, as Thompson and Barnett (1986) changed it,
    doi:10.1016/0021-9991(86)90046-X, section 2.

    Args:
        first: before the first term.
        term: the k-th (p, q), from one.
    """
    value = above = first or _SMALL
    below, k, ratio = 0.0, 0, 0.0
    while abs(ratio - 1.0) > _ROUNDING:
        k += 1
        p, q = term(k)
        below = 1.0 / (q + p * below or _SMALL)
        above = q + p / above or _SMALL
        ratio = above * below
        value *= ratio
    return value
