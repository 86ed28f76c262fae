"""Halton's sequence under random permutations of its digits: points that cover a cube evenly.

`scipy.stats` has the same, and takes half a second to import.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray

_PRIMES: Final = (2, 3, 5, 7, 11, 13)
# Bits of a float's fraction, and one more: digits beyond are rounding.
_BITS: Final = 54


def halton(count: int, size: int, seed: int) -> FloatArray:
    """The first points of the sequence, as `scipy.stats.qmc.Halton` scrambles it.

    Owen (2017), A randomized Halton algorithm in R, arXiv:1706.02808: the k-th digit of the
    numbers of a dimension, in its prime base, is permuted alike in all of them; of what follows
    a number's last digit, which are zeros, too.

    Args:
        count: of points.
        size: of the cube, at most six.
        seed: of the permutations.

    Returns:
        (count, size) numbers from 0 to 1.
    """
    # SciPy's engine draws from a child of the generator it is given.
    rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(1)[0])
    points = np.zeros((count, size))
    for column, base in zip(points.T, _PRIMES[:size], strict=True):
        left, weight = np.arange(count), 1.0
        for _ in range(math.ceil(_BITS / math.log2(base)) - 1):
            permuted = np.arange(base)
            rng.shuffle(permuted)
            weight /= base
            column += weight * permuted[left % base]
            left //= base
    return points
