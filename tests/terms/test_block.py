"""Rows of numbers that are the same, and which of them come first."""

from __future__ import annotations

import numpy as np
import pytest

from suta_calib.arrays import IntArray
from suta_calib.terms.block import first_of_each, grouped_rows


def rows_of(count: int, width: int, most: int) -> IntArray:
    """Rows of few different numbers, so that many of them are the same."""
    random = np.random.default_rng(width)
    return most * random.integers(0, 3, (count, width))


# No number is large enough for six columns of the largest.
@pytest.mark.parametrize("most", [1, 7, 10**9], ids=["small", "some", "beyond any number"])
@pytest.mark.parametrize("width", [0, 1, 2, 6])
@pytest.mark.parametrize("count", [0, 1, 200])
def test_rows_are_told_apart_however_large_their_numbers_are(count: int, width: int, most: int):
    rows = rows_of(count, width, most)
    as_tuples = [tuple(row) for row in rows.tolist()]
    first = sorted({row: as_tuples.index(row) for row in as_tuples}.values())
    assert sorted(first_of_each(rows).tolist()) == first

    as_sets = [tuple(sorted(row)) for row in as_tuples]
    ordered = sorted(set(as_sets))
    group, often = grouped_rows(rows)
    assert group.tolist() == [ordered.index(row) for row in as_sets]
    assert often.tolist() == [as_sets.count(row) for row in ordered]
