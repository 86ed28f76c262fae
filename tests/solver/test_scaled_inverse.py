"""The inverse of information whose diagonal spans many magnitudes."""

from __future__ import annotations

import numpy as np
import pytest

from suta_calib.arrays import FloatArray
from suta_calib.solver.information import scaled_inverse


def told(rows: int, seed: int) -> FloatArray:
    """Information of so many rows about eight parameters of very different sizes."""
    random = np.random.default_rng(seed)
    jacobian = random.normal(size=(rows, 8)) * 10.0 ** np.arange(-6, 10, 2)
    return np.asarray(jacobian.T @ jacobian)


@pytest.mark.parametrize("seed", range(3))
def test_where_all_is_told_it_is_the_inverse(seed: int) -> None:
    matrix = told(20, seed)
    found = scaled_inverse(matrix)
    size = np.sqrt(np.diag(matrix))
    np.testing.assert_allclose((found @ matrix) * size[:, None] / size, np.eye(8), atol=1e-9)
    np.testing.assert_allclose(found, found.T, rtol=1e-9)


@pytest.mark.parametrize("rows", [0, 3, 7])
def test_of_what_is_not_told_nothing_is_made_up(rows: int) -> None:
    matrix = told(rows, 0)
    found, size = scaled_inverse(matrix), np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    # Penrose's conditions, in units of the diagonal.
    unit, inverse = matrix / np.outer(size, size), found * np.outer(size, size)
    np.testing.assert_allclose(unit @ inverse @ unit, unit, atol=1e-9)
    np.testing.assert_allclose(inverse @ unit @ inverse, inverse, rtol=1e-7, atol=1e-9)
    assert np.linalg.matrix_rank(inverse, tol=1e-6) == rows
