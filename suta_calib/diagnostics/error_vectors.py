"""Errors of samples as vectors in the base: what an arrow in a picture of the arm shows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.distributions import chi2
from suta_calib.terms import Term

# Chance that the error of a sample with nothing wrong is called outlying.
_CHANCE: Final = 1e-4


@dataclass(frozen=True, eq=False)
class ErrorVectors:
    """Errors of the samples of one term, in the base.

    Attributes:
        at: (n, 3) where the arm's model has what was touched with, or what was seen, m.
        vector: (n, 3) from there to where it should have been by what was touched, or to where it
            was seen, m.
        size: components of an error that the term looks at: 1 for a distance, 3 for a point.
    """

    at: FloatArray
    vector: FloatArray
    size: int

    @property
    def norm(self) -> FloatArray:
        """(n,) m."""
        return np.asarray(np.linalg.norm(self.vector, axis=1))

    @property
    def outlying(self) -> BoolArray:
        """(n,) which errors are larger than chance makes them, by the median of all."""
        limit = math.sqrt(chi2.isf(_CHANCE, self.size) / chi2.median(self.size))
        return np.asarray(self.norm > limit * np.median(self.norm))


def error_vectors(term: Term, values: Mapping[str, float]) -> ErrorVectors:
    """Errors of every sample of a term.

    A touch's is from the tip to what it touched, in the directions that the touch tells of; what an
    instrument or a camera sees is where the model has it, and the error goes to where it was seen:
    of a board the mean over its corners, at the board's distance.

    Args:
        term: any kind.
        values: of the arm's parameters and the term's own unknowns, m or rad.
    """
    ideal, size = term.observed(values, term.poses), term.blocks[0].size
    if term.medium == "touch":
        _, tip = term.poses.at(values)
        return ErrorVectors(tip, ideal.position - tip, size)
    samples = term.poses.samples
    if ideal.pixels is not None and samples.pixels is not None:
        off = np.zeros_like(ideal.position)
        off[:, :2] = (term.blocks[0].pixel or 0.0) * _mean_shift(samples.pixels, ideal.pixels)
    else:
        assert samples.position is not None
        off = samples.position - ideal.position
    R, p = eye_poses(term, values)
    at = np.einsum("nij,nj->ni", R, ideal.position) + p
    return ErrorVectors(at, np.einsum("nij,nj->ni", R, off), size)


def eye_poses(term: Term, values: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
    """Where the instrument or camera of a term is at each sample, in the base.

    Args:
        term: one that does not touch: the first frame of `Term.outside` is of what sees.
        values: of the arm's parameters and the term's own unknowns, m or rad.

    Returns:
        Rotations (n, 3, 3) and positions (n, 3), m.
    """
    frame = term.outside[0]
    R, p = frame.pose(values)
    assert R is not None
    if frame.what == "base":  # It says where the base is in the instrument.
        R, p = R.T, -R.T @ p
    rotation, position = term.poses.at(values)
    if frame.within == "tip":
        return rotation @ R, position + rotation @ p
    n = len(position)
    return np.tile(R, (n, 1, 1)), np.tile(p, (n, 1))


def _mean_shift(found: FloatArray, ideal: FloatArray) -> FloatArray:
    """(n, 2) mean of found less ideal corners (n, points, 2), px; 0 for a picture without any."""
    off = found - ideal
    seen = np.all(np.isfinite(off), axis=2, keepdims=True)
    total = np.where(seen, off, 0.0).sum(axis=1)
    return np.asarray(total / np.maximum(seen.sum(axis=1), 1))
