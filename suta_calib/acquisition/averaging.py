"""One reading out of many, on the circle or of plain numbers, and how far the many scatter.

A word that was corrupted and still passes its checks is rare but grossly wrong: the centre is a
median first, and what lies far from it is left out of the mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import wrap

# Median absolute deviation to standard deviation of a normal distribution.
NORMAL: Final = 1.4826


class MeanNumber(NamedTuple):
    """Many readings of a plain number as one.

    Attributes:
        mean: of the readings that are numbers near the others; NaN where none is.
        std: standard deviation of one of them.
        share: how many of all readings these are.
        step: smallest step between them, where the number is coarse; otherwise 0.
    """

    mean: float
    std: float
    share: float
    step: float


@dataclass(frozen=True, eq=False)
class Average(Displayable):
    """Many readings of an arm at rest as one.

    Attributes:
        angles: (n,) mean of each joint on the circle, rad in (-π, π].
        std: (n,) standard deviation of one reading, rad.
        count: how many readings there were.
        left_out: (n,) how many of them were grossly wrong and left out.
        seconds: how long they were recorded.
        way: (k, n) where the arm was in the seconds before it rested, rad, oldest first; None where
            that was not seen.
        extra: of what the device sent beside the joints, by column.
    """

    angles: FloatArray
    std: FloatArray
    count: int
    left_out: FloatArray
    seconds: float
    way: FloatArray | None = None
    extra: Mapping[str, MeanNumber] = field(default_factory=dict)

    @property
    def cells(self) -> dict[str, str]:
        """The means of `extra` as they are written."""
        return {name: str(number.mean) for name, number in self.extra.items()}


def unwrapped_about_median(angles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Median (n,) of angles (k, n) on the circle, and deviations (k, n) from it, in (-π, π] rad.

    All but gross errors in a column must lie within half a turn.
    """
    # The reference only has to lie among the bulk: the direction of the mean vector does.
    reference = np.arctan2(np.sin(angles).mean(axis=0), np.cos(angles).mean(axis=0))
    centre = reference + np.median(wrap(angles - reference), axis=0)
    return wrap(centre), wrap(angles - centre)


def spread(deviations: FloatArray) -> FloatArray:
    """Standard deviation of each column by the median of the absolute deviations, (k, n) → (n,)."""
    return np.asarray(NORMAL * np.median(np.abs(deviations), axis=0), dtype=float)


def row_noise(rows: FloatArray, axis: int | None = None) -> FloatArray:
    """Standard deviation of what changes from row to row without direction; 0 of few rows."""
    second = np.abs(np.diff(rows, 2, axis=0))
    return np.asarray(NORMAL * np.median(second, axis=axis) / np.sqrt(6.0) if second.size else 0.0)


def steps(deviations: FloatArray) -> FloatArray:
    """Smallest step each column shows, (n,) rad; zero where noise hides it.

    A coarse encoder at rest reports two or three neighbouring values. Its scatter then says nothing
    below the step between them.
    """
    smallest = np.zeros(deviations.shape[1])
    for k, column in enumerate(deviations.T.round(12)):
        values, counts = np.unique(column, return_counts=True)
        # A value that hardly ever occurs is an error, not a neighbouring step; more than a few
        # distinct ones are noise.
        values = values[counts >= max(2, 0.05 * len(column))]
        if 2 <= len(values) <= 5:
            smallest[k] = np.diff(values).min()
    return smallest


def average(angles: ArrayLike, seconds: float = 0.0) -> Average:
    """Mean on the circle and standard deviation of readings of an arm at rest.

    Args:
        angles: (k, n) rad, k at least one.
        seconds: how long they were recorded, for the record.

    Raises:
        SamplesError: no readings.
    """
    angles = np.atleast_2d(np.asarray(angles, dtype=float))
    if not angles.size:
        raise SamplesError("no readings", "at least one to average")
    centre, deviation = unwrapped_about_median(angles)
    mean, std, left = _mean_of_most(deviation)
    return Average(wrap(centre + mean), std, len(angles), len(angles) - left, seconds)


def mean_number(values: FloatArray) -> MeanNumber:
    """Mean and standard deviation of readings (k,) of a plain number at rest; NaN is no reading."""
    numbers = values[np.isfinite(values)]
    if not len(numbers):
        return MeanNumber(np.nan, np.nan, 0.0, 0.0)
    centre = float(np.median(numbers))
    deviation = (numbers - centre)[:, None]
    (mean,), (std,), (left,) = (column.tolist() for column in _mean_of_most(deviation))
    return MeanNumber(centre + mean, std, left / len(values), float(steps(deviation)[0]))


def _mean_of_most(deviation: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of deviations (k, n) from medians: mean and standard deviation (n,), and of how many (n,)."""
    # Farther from the median than six standard deviations no honest reading lies.
    limit = np.maximum(6.0 * spread(deviation), 2 * steps(deviation) + 1e-9)
    inliers = np.abs(deviation) <= limit
    mean = np.mean(deviation, axis=0, where=inliers)
    left = inliers.sum(axis=0)
    squares = np.sum((deviation - mean) ** 2, axis=0, where=inliers)
    return mean, np.sqrt(squares / np.maximum(left - 1, 1)), left
