"""Halton's sequence is SciPy's, number by number."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import qmc

from suta_calib.halton import halton


@pytest.mark.parametrize(("count", "size", "seed"), [(240, 5, 0), (240, 6, 7), (40, 3, 1)])
def test_points_are_those_of_scipy(count: int, size: int, seed: int) -> None:
    scipys = qmc.Halton(size, seed=np.random.default_rng(seed)).random(count)
    np.testing.assert_allclose(halton(count, size, seed), scipys, rtol=0, atol=1e-15)


def test_more_dimensions_than_bases_are_refused() -> None:
    with pytest.raises(ValueError, match="shorter"):
        halton(10, 7, 0)
