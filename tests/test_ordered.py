"""What NumPy does, without what it would import to do it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from suta_calib.ordered import different, evenly, median


@pytest.mark.parametrize("shape", [(1,), (2,), (7,), (8,), (3, 4, 5), (2, 1, 6)])
def test_a_median_is_that_of_numpy(shape: tuple[int, ...]) -> None:
    numbers = np.random.default_rng(0).normal(size=shape)
    assert_array_equal(median(numbers), np.median(numbers))
    for axis in range(-len(shape), len(shape)):
        assert_array_equal(median(numbers, axis), np.median(numbers, axis))
        kept = np.median(numbers, axis, keepdims=True)
        assert_array_equal(median(numbers, axis, keepdims=True), kept)


def test_different_numbers_are_those_of_numpy() -> None:
    random = np.random.default_rng(0)
    for size in (0, 1, 2, 30):
        numbers = random.integers(-4, 4, size)
        assert_array_equal(different(numbers), np.unique(numbers))
        assert_array_equal(different(numbers / 3.0), np.unique(numbers / 3.0))


def test_numbers_lie_evenly_and_are_different() -> None:
    assert_array_equal(evenly(2, 5, 40), [2, 3, 4, 5])
    assert_array_equal(evenly(0, 99, 4), [0, 33, 66, 99])
    assert_array_equal(evenly(3, 3, 2), [3])
