"""Tails and quantiles are SciPy's."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy import special, stats

from suta_calib import distributions
from suta_calib.arrays import FloatArray
from suta_calib.incomplete import beta_tail, gamma_tails

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
        ("norm", "ppf", CHANCES, ()),
        ("norm", "isf", CHANCES, ()),
    ],
)
def test_the_numbers_are_those_of_scipy_stats(
    name: str, function: str, at: FloatArray, freedom: tuple[FloatArray, ...]
) -> None:
    ours, theirs = (getattr(getattr(m, name), function) for m in (distributions, stats))
    expected = theirs(at, *freedom)
    np.testing.assert_allclose(ours(at, *freedom), expected, rtol=1e-9, atol=1e-300)
    # One number goes another way.
    single = np.vectorize(lambda *each: ours(*map(float, each)))(at, *freedom)
    np.testing.assert_allclose(single, expected, rtol=1e-9, atol=1e-300)


def test_a_quantile_of_t_has_the_chance_that_was_asked_for() -> None:
    """Those of SciPy 1.11, which many at once are, to 1e-8 only."""
    t, asked = distributions.t, np.broadcast_to(CHANCES, (len(CHANCES), len(FREEDOM)))
    for quantile, sign in ((t.ppf, 1.0), (t.isf, -1.0)):
        single = np.vectorize(lambda *each, of=quantile: of(*map(float, each)))(CHANCES, FREEDOM)
        np.testing.assert_allclose(special.stdtr(FREEDOM, sign * single), asked, rtol=1e-12)
        together = quantile(CHANCES, FREEDOM)
        np.testing.assert_allclose(special.stdtr(FREEDOM, sign * together), asked, rtol=2e-8)


def test_students_t_of_much_data_is_that_of_scipy() -> None:
    for freedom in (1999.0, 2001.0, 6e3, 3e5):
        for x in (-30.0, -6.0, -0.5, 0.3, 1.9):
            expected = special.stdtr(freedom, x)
            assert distributions.t.cdf(x, freedom) == pytest.approx(expected, rel=1e-9)
        for chance in (1e-4, 0.025, 0.999):
            expected = -special.stdtrit(freedom, chance)
            assert distributions.t.isf(chance, freedom) == pytest.approx(expected, rel=1e-9)


def test_without_degrees_of_freedom_there_is_no_number() -> None:
    assert np.isnan(distributions.chi2.isf(0.01, 0))
    assert np.isnan(distributions.t.isf(0.01, 0))
    assert distributions.chi2.median(2) == pytest.approx(2 * np.log(2))


def test_a_quantile_of_f_has_the_chance_that_was_asked_for() -> None:
    f = distributions.f
    asked = np.broadcast_to(CHANCES, (len(CHANCES), len(FREEDOM)))
    np.testing.assert_allclose(f.sf(f.isf(CHANCES, FREEDOM, 4.5), FREEDOM, 4.5), asked, rtol=1e-9)


def test_a_single_number_does_not_wait_for_scipy() -> None:
    code = (
        "import sys\n"
        "from suta_calib.distributions import chi2, f, norm, t\n"
        "chi2.ppf(0.5, 3), chi2.isf(1e-4, 6), f.sf(2.0, 3.0, 55.0), t.isf(1e-3, 4), norm.ppf(0.2)\n"
        "t.isf(5e-4, 60000.0)\n"
        "assert 'scipy' not in sys.modules\n"
        "chi2.sf(1e5, 1e5)\n"
        "assert 'scipy.special' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(("a", "b"), [(0.5, 0.5), (3.0, 0.5), (281.0, 1.5), (2000.0, 900.0)])
@pytest.mark.parametrize("x", [1e-9, 0.01, 0.5, 0.69, 0.97, 1.0 - 1e-9])
def test_both_ends_of_a_beta_distribution_are_one(a: float, b: float, x: float) -> None:
    lower, upper = beta_tail(a, b, x, 1.0 - x), beta_tail(b, a, 1.0 - x, x)
    assert lower + upper == pytest.approx(1.0, abs=1e-12)
    assert lower == pytest.approx(float(special.betainc(a, b, x)), rel=1e-9, abs=1e-300)


@pytest.mark.parametrize("a", [0.5, 1.0, 2.5, 40.0, 2500.0])
def test_tails_of_a_gamma_distribution_keep_their_digits(a: float) -> None:
    for x in a * np.array([0.01, 0.5, 0.99, 1.0, 1.01, 2.0, 20.0]):
        expected = special.gammainc(a, x), special.gammaincc(a, x)
        assert gamma_tails(a, float(x)) == pytest.approx(expected, rel=1e-9, abs=1e-16)
