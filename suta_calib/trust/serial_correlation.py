"""Poses of a stream that repeat each other's errors count as fewer than they are."""

from __future__ import annotations

import numpy as np

from suta_calib.arrays import FloatArray, IntArray


def correlation_length(residuals: FloatArray) -> float:
    """Integrated autocorrelation 1 + 2 Σ ρ_k of rows (n, d) in their order; 1 where they are white.

    Summed up to the first lag that white noise could have (Geyer 1992, doi:10.1214/ss/1177011137,
    with a plainer rule for where to stop).
    """
    n = len(residuals)
    power = float(np.sum(residuals**2))
    # Correlations of white noise beyond which one is believed, in units of their standard
    # deviation.
    chance = 3.0 / np.sqrt(residuals.size)
    total = 1.0
    for lag in range(1, n // 4):
        rho = float(np.sum(residuals[lag:] * residuals[:-lag])) / power if power > 0 else 0.0
        if rho < chance:
            break
        total += 2.0 * rho
    return total


def blocks(residuals: FloatArray) -> IntArray:
    """(n,) number of the block of neighbours each row is in; its own where rows are white."""
    n = len(residuals)
    length = correlation_length(residuals)
    # Blocks as long as this many correlation lengths keep most of what neighbours share.
    lengths = 3.0
    size = 1 if length == 1.0 else int(np.ceil(lengths * length))
    # Smallest number of blocks from which a variance is estimated.
    return np.arange(n, dtype=np.intp) // max(1, min(size, n // 12))
