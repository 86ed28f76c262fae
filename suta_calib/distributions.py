"""Chi-squared, F, Student's t and the normal distribution under SciPy's names.

`scipy.stats` takes a third of a second to import, `scipy.special` has the same functions. Arguments
and answers are those of `scipy.stats`: ``cdf``, its complement ``sf``, and their inverses ``ppf``
and ``isf``; numbers or arrays, NaN where there are no degrees of freedom.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from scipy.special import (
    betaincinv,
    chdtr,
    chdtrc,
    fdtrc,
    gammainccinv,
    gammaincinv,
    ndtri,
    stdtrit,
)


class _ChiSquared:
    """Chi-squared with ``df`` degrees of freedom."""

    @staticmethod
    def cdf(x: Any, df: Any) -> Any:
        return chdtr(df, x)

    @staticmethod
    def sf(x: Any, df: Any) -> Any:
        return chdtrc(df, x)

    @staticmethod
    def ppf(q: Any, df: Any) -> Any:
        return 2.0 * gammaincinv(np.divide(df, 2.0), q)

    @staticmethod
    def isf(q: Any, df: Any) -> Any:
        return 2.0 * gammainccinv(np.divide(df, 2.0), q)

    def median(self, df: Any) -> Any:
        return self.ppf(0.5, df)


class _F:
    """F with ``dfn`` degrees of freedom above and ``dfd`` below."""

    @staticmethod
    def sf(x: Any, dfn: Any, dfd: Any) -> Any:
        return fdtrc(dfn, dfd, x)

    @staticmethod
    def isf(q: Any, dfn: Any, dfd: Any) -> Any:
        # By the beta distribution's lower end: 1 - q has no digits of a small q.
        y = betaincinv(np.divide(dfd, 2.0), np.divide(dfn, 2.0), q)
        return np.divide(dfd, dfn) * (1.0 - y) / y


class _StudentsT:
    """Student's t with ``df`` degrees of freedom."""

    @staticmethod
    def ppf(q: Any, df: Any) -> Any:
        return stdtrit(df, q)

    @staticmethod
    def isf(q: Any, df: Any) -> Any:
        return -stdtrit(df, q)


class _Normal:
    """The normal distribution, mean 0 and standard deviation 1."""

    @staticmethod
    def ppf(q: Any) -> Any:
        return ndtri(q)

    @staticmethod
    def isf(q: Any) -> Any:
        return -ndtri(q)


chi2: Final = _ChiSquared()
f: Final = _F()
t: Final = _StudentsT()
norm: Final = _Normal()
