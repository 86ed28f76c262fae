"""Visits that are not like the others, and visits that are too much like their neighbours."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import numpy as np

from suta_calib.analysis.repeatability.scatter import median_angle
from suta_calib.arrays import FloatArray
from suta_calib.units import Unit

# A joint this far from its median (rad) and this many times as far as most: another posture.
_POSTURE: Final = math.radians(5.0)
_UNUSUAL: Final = 10.0
# Farther from the median than this many times the median distance: another point, or a slip.
_ELSEWHERE: Final = 6.0


def elsewhere(away: FloatArray) -> tuple[int, ...]:
    """Rows of positions (n, 3) far from where most of them are."""
    size = np.linalg.norm(away - np.median(away, axis=0), axis=1)
    return tuple(int(row) for row in np.flatnonzero(size > _ELSEWHERE * np.median(size)))


def other_posture(columns: Iterable[tuple[str, Unit, FloatArray, float]]) -> tuple[int, ...]:
    """Rows in which some revolute joint is where it is not in most others.

    Args:
        columns: name, unit, readings (n,) and lever of every joint.
    """
    odd: set[int] = set()
    for _, unit, readings, _ in columns:
        if unit == "rad":
            away = np.angle(np.exp(1j * (readings - median_angle(readings))))
            size = np.abs(away - np.median(away))
            limit = max(_POSTURE, _UNUSUAL * float(np.median(size)))
            odd |= {int(row) for row in np.flatnonzero(size > limit)}
    return tuple(sorted(odd))


def white(away: FloatArray) -> FloatArray:
    """Deviations (n, 3) along their principal axes, all of one size."""
    vectors, sizes, _ = np.linalg.svd(away - away.mean(axis=0), full_matrices=False)
    return np.array(vectors[:, sizes > 1e-9 * max(float(sizes[0]), 1e-300)], dtype=float)
