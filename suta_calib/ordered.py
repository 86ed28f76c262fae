"""Medians and different numbers of arrays.

Of NumPy's own, the median looks for NaN among its answers and `numpy.unique` for masks among its
numbers: to do so they import masked arrays, which takes as long as a short command's arithmetic.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray, IntArray

Number = TypeVar("Number", np.float64, np.intp)


def median(numbers: FloatArray, axis: int | None = None, *, keepdims: bool = False) -> FloatArray:
    """The median of numbers without NaN, as `numpy.median` has it; of all of them by default."""
    along = numbers.reshape(-1) if axis is None else np.moveaxis(numbers, axis, -1)
    upper = along.shape[-1] // 2
    lower = (along.shape[-1] - 1) // 2
    parted = np.partition(along, (lower, upper), axis=-1)
    middle = np.asarray(0.5 * (parted[..., lower] + parted[..., upper]))
    return np.expand_dims(middle, axis) if keepdims and axis is not None else middle


def different(numbers: NDArray[Number]) -> NDArray[Number]:
    """The different ones of numbers (n,), ascending."""
    ascending = np.sort(numbers)
    first = np.ones(len(ascending), dtype=np.bool_)
    first[1:] = ascending[1:] != ascending[:-1]
    return ascending[first]


def evenly(first: int, last: int, count: int) -> IntArray:
    """Up to ``count`` different whole numbers, evenly from the first to the last."""
    return different(np.linspace(first, last, count).astype(np.intp))
