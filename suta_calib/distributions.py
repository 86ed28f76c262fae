"""Chi-squared, F, Student's t and the normal distribution under SciPy's names.

`scipy.stats` takes a third of a second to import, `scipy.special` has the same functions and is
imported when the first is asked for. Arguments and answers are those of `scipy.stats`: ``cdf``, its
complement ``sf``, and their inverses ``ppf`` and ``isf``; numbers or arrays, NaN where there are no
degrees of freedom.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np


def _special() -> Any:
    """The functions of which the distributions are made."""
    import scipy.special

    return scipy.special


class _ChiSquared:
    """Chi-squared with ``df`` degrees of freedom."""

    @staticmethod
    def cdf(x: Any, df: Any) -> Any:
        return _special().chdtr(df, x)

    @staticmethod
    def sf(x: Any, df: Any) -> Any:
        return _special().chdtrc(df, x)

    @staticmethod
    def ppf(q: Any, df: Any) -> Any:
        return 2.0 * _special().gammaincinv(np.divide(df, 2.0), q)

    @staticmethod
    def isf(q: Any, df: Any) -> Any:
        return 2.0 * _special().gammainccinv(np.divide(df, 2.0), q)

    def median(self, df: Any) -> Any:
        return self.ppf(0.5, df)


class _F:
    """F with ``dfn`` degrees of freedom above and ``dfd`` below."""

    @staticmethod
    def sf(x: Any, dfn: Any, dfd: Any) -> Any:
        return _special().fdtrc(dfn, dfd, x)

    @staticmethod
    def ppf(q: Any, dfn: Any, dfd: Any) -> Any:
        return _special().fdtri(dfn, dfd, q)

    @staticmethod
    def isf(q: Any, dfn: Any, dfd: Any) -> Any:
        # By the beta distribution's lower end: 1 - q has no digits of a small q.
        y = _special().betaincinv(np.divide(dfd, 2.0), np.divide(dfn, 2.0), q)
        return np.divide(dfd, dfn) * (1.0 - y) / y


class _StudentsT:
    """Student's t with ``df`` degrees of freedom."""

    @staticmethod
    def cdf(x: Any, df: Any) -> Any:
        return _special().stdtr(df, x)

    @staticmethod
    def ppf(q: Any, df: Any) -> Any:
        return _special().stdtrit(df, q)

    @staticmethod
    def isf(q: Any, df: Any) -> Any:
        return -_special().stdtrit(df, q)


class _Normal:
    """The normal distribution, mean 0 and standard deviation 1."""

    @staticmethod
    def ppf(q: Any) -> Any:
        return _special().ndtri(q)

    @staticmethod
    def isf(q: Any) -> Any:
        return -_special().ndtri(q)


chi2: Final = _ChiSquared()
f: Final = _F()
t: Final = _StudentsT()
norm: Final = _Normal()
