"""Chi-squared, F, Student's t and the normal distribution under SciPy's names.

`scipy.stats` takes a third of a second to import. `scipy.special` has the same functions in half of
that, which is still half of what a short command takes: it is asked for arrays, and a single number
is found without it (`incomplete`). Arguments and answers are those of `scipy.stats`: ``cdf``, its
complement ``sf``, and their inverses ``ppf`` and ``isf``; numbers or arrays, NaN where there are no
degrees of freedom.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, Final

import numpy as np

from suta_calib.incomplete import MOST, MOST_BESIDE_ONE, beta_tail, gamma_tails, where


def _special() -> Any:
    """The functions of which the distributions are made."""
    import scipy.special

    return scipy.special


def _single(at: Any, *freedom: Any, most: float = MOST) -> bool:
    """Whether this is one number, with degrees of freedom that `incomplete` can do."""
    few = all(_is_number(df) and 0.0 < df < most for df in freedom)
    return few and _is_number(at) and math.isfinite(at)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float, np.number))


class _ChiSquared:
    """Chi-squared with ``df`` degrees of freedom."""

    @staticmethod
    def cdf(x: Any, df: Any) -> Any:
        if _single(x, df):
            return gamma_tails(0.5 * df, 0.5 * x)[0]
        return _special().chdtr(df, x)

    @staticmethod
    def sf(x: Any, df: Any) -> Any:
        if _single(x, df):
            return gamma_tails(0.5 * df, 0.5 * x)[1]
        return _special().chdtrc(df, x)

    @staticmethod
    def ppf(q: Any, df: Any) -> Any:
        if _single(q, df) and 0.0 < q < 1.0:
            return _chi_squared_below(float(q), float(df))
        return 2.0 * _special().gammaincinv(np.divide(df, 2.0), q)

    @staticmethod
    def isf(q: Any, df: Any) -> Any:
        if _single(q, df) and 0.0 < q < 1.0:
            return _chi_squared_above(float(q), float(df))
        return 2.0 * _special().gammainccinv(np.divide(df, 2.0), q)

    def median(self, df: Any) -> Any:
        return self.ppf(0.5, df)


class _F:
    """F with ``dfn`` degrees of freedom above and ``dfd`` below."""

    @staticmethod
    def sf(x: Any, dfn: Any, dfd: Any) -> Any:
        if _single(x, dfn, dfd):
            whole = dfd + dfn * max(x, 0.0)
            return beta_tail(0.5 * dfd, 0.5 * dfn, dfd / whole, dfn * max(x, 0.0) / whole)
        return _special().fdtrc(dfn, dfd, x)

    @staticmethod
    def isf(q: Any, dfn: Any, dfd: Any) -> Any:
        # By the beta distribution's lower end: 1 - q has no digits of a small q.
        y = _special().betaincinv(np.divide(dfd, 2.0), np.divide(dfn, 2.0), q)
        return np.divide(dfd, dfn) * (1.0 - y) / y


class _StudentsT:
    """Student's t with ``df`` degrees of freedom."""

    @staticmethod
    def cdf(x: Any, df: Any) -> Any:
        if _single(x, df, most=MOST_BESIDE_ONE):
            tail = _t_tail(abs(x), df)
            return tail if x < 0.0 else 1.0 - tail
        return _special().stdtr(df, x)

    @staticmethod
    def ppf(q: Any, df: Any) -> Any:
        if _single(q, df, most=MOST_BESIDE_ONE) and 0.0 < q < 1.0:
            return (
                -_t_above(float(q), float(df)) if q < 0.5 else _t_above(1.0 - float(q), float(df))
            )
        return _special().stdtrit(df, q)

    def isf(self, q: Any, df: Any) -> Any:
        return -self.ppf(q, df)


class _Normal:
    """The normal distribution, mean 0 and standard deviation 1."""

    @staticmethod
    def ppf(q: Any) -> Any:
        from statistics import NormalDist

        if _single(q) and 0.0 < q < 1.0:
            return NormalDist().inv_cdf(float(q))
        return _special().ndtri(q)

    def isf(self, q: Any) -> Any:
        return -self.ppf(q)


# Whoever studies many calibrations asks for the same few quantiles again and again.


@lru_cache(maxsize=256)
def _chi_squared_below(q: float, df: float) -> float:
    """Below which chi-squared stays with a chance."""
    return where(lambda x: gamma_tails(0.5 * df, 0.5 * x)[0], q)


@lru_cache(maxsize=256)
def _chi_squared_above(q: float, df: float) -> float:
    """Above which chi-squared is with a chance."""
    return where(lambda x: gamma_tails(0.5 * df, 0.5 * x)[1], q)


@lru_cache(maxsize=256)
def _t_above(q: float, df: float) -> float:
    """Above which Student's t is with a chance of a half or less."""
    return where(lambda x: _t_tail(x, df), q)


def _t_tail(x: float, df: float) -> float:
    """Chance of more than ``x``, which is not negative."""
    whole = df + x * x
    return 0.5 * beta_tail(0.5 * df, 0.5, df / whole, x * x / whole)


chi2: Final = _ChiSquared()
f: Final = _F()
t: Final = _StudentsT()
norm: Final = _Normal()
