"""Visits that were written down again: they tell nothing new, and make every interval narrower."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from suta_calib.analysis.repeatability.scatter import deviations
from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.terms.poses import resolutions, together
from suta_calib.units import Unit

# Rows are copies that differ in no joint by more than this share of its standard deviation, which
# two visits hardly do in all joints at once. At least what no encoder tells, at most less than the
# most exact arm comes back by, where several postures make the deviations large; rad or m.
SHARE: Final = 0.05
LEAST, MOST = 5e-7, 3e-6
# Share of the rows that must be copies for more than the least to be what parts them: of many exact
# visits two may be as near.
MANY: Final = 0.05


def first_written(q: FloatArray, units: Sequence[Unit]) -> BoolArray:
    """(n,) rows of readings (n, joints) that are no copies of one before, jittered or not.

    Of an arm whose encoders are all so coarse that it may well read the same when it comes back,
    all of them.
    """
    if len(q) < 2:
        return np.ones(len(q), dtype=np.bool_)
    moving = np.flatnonzero(np.ptp(q, axis=0) > 0.0).tolist()
    first = np.zeros(len(q), dtype=np.bool_)
    first[0] = True
    if not moving:
        return first
    off = np.stack([deviations(q[:, k], units[k])[1] for k in moving], axis=1)
    for most in (MOST, LEAST):
        near = np.clip(SHARE * off.std(axis=0), LEAST, most)
        first[:] = False
        first[np.unique(together(off / near, 1.0), return_index=True)[1]] = True
        if np.mean(~first) >= MANY:
            break
    # Share of the rows that read in a joint as another one does, from which on its encoder is
    # coarse.
    shared = 0.5
    coarse = np.all(resolutions(q[:, moving]) > 0.0) or all(
        _shared(readings) > shared for readings in q[first][:, moving].T
    )
    return np.ones(len(q), dtype=np.bool_) if coarse and first.sum() > 1 else first


def _shared(readings: FloatArray) -> float:
    """Share of readings (n,) that occur more than once."""
    _, count = np.unique(readings, return_counts=True)
    return float(np.sum(count[count > 1])) / len(readings)
