"""Tails and quantiles are SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from suta_calib import distributions
from suta_calib.arrays import FloatArray

CHANCES = np.array([1e-12, 1e-6, 0.01, 0.025, 0.3, 0.5, 0.9, 0.999])[:, None]
FREEDOM = np.array([1.0, 2.0, 2.7, 3.0, 8.5, 30.0, 4000.0])
POINTS = np.array([0.0, 1e-3, 0.2, 1.0, 3.3, 60.0])[:, None]


@pytest.mark.parametrize(
    ("name", "function", "at", "freedom"),
    [
        ("chi2", "cdf", POINTS, (FREEDOM,)),
        ("chi2", "sf", POINTS, (FREEDOM,)),
        ("chi2", "ppf", CHANCES, (FREEDOM,)),
        ("chi2", "isf", CHANCES, (FREEDOM,)),
        ("f", "sf", POINTS, (FREEDOM, 4.5)),
        # SciPy's own has lost the digits of the smallest.
        ("f", "isf", CHANCES[1:], (FREEDOM, 4.5)),
        ("t", "ppf", CHANCES, (FREEDOM,)),
        ("t", "isf", CHANCES, (FREEDOM,)),
        ("norm", "ppf", CHANCES, ()),
        ("norm", "isf", CHANCES, ()),
    ],
)
def test_the_numbers_are_those_of_scipy_stats(
    name: str, function: str, at: FloatArray, freedom: tuple[FloatArray, ...]
) -> None:
    ours, theirs = (getattr(getattr(m, name), function) for m in (distributions, stats))
    np.testing.assert_allclose(ours(at, *freedom), theirs(at, *freedom), rtol=1e-9, atol=1e-300)


def test_without_degrees_of_freedom_there_is_no_number() -> None:
    assert np.isnan(distributions.chi2.isf(0.01, 0))
    assert np.isnan(distributions.t.isf(0.01, 0))
    assert distributions.chi2.median(2) == pytest.approx(2 * np.log(2))


def test_a_quantile_of_f_has_the_chance_that_was_asked_for() -> None:
    f = distributions.f
    asked = np.broadcast_to(CHANCES, (len(CHANCES), len(FREEDOM)))
    np.testing.assert_allclose(f.sf(f.isf(CHANCES, FREEDOM, 4.5), FREEDOM, 4.5), asked, rtol=1e-9)
