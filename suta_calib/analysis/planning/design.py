"""Optimal design: the subset of candidates that leaves the least uncertainty.

Greedy choice, then Fedorov's exchange (1972, Theory of Optimal Experiments): one chosen candidate
is put back and the best one taken in its place, until no exchange helps. The criteria are of the
sandwich covariance, with what is plausible of each parameter as a prior, so that they are finite
for any data:

    d    ½ log det C / p   mean log uncertainty of a parameter (D-optimality, Wald 1943)
    tip  √ trace(W C)      root mean square uncertainty of the tip in a region (V-optimality)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.analysis.planning.information import SharedInformation, Space
from suta_calib.arrays import FloatArray

CRITERIA: Final = ("tip", "d")
# An exchange must gain this much to count, in units of the criterion's value.
_WORTH: Final = 1e-9
_MOST_PASSES: Final = 20
# Information, of what was plausible before any data, below which a direction is told by nothing.
_ESTIMATED: Final = 1e-7


@dataclass(frozen=True, eq=False)
class Design:
    """Candidates to choose from, and what a choice is worth.

    Matrices are kept in coordinates in which everything is uncorrelated and of variance one before
    any data, without the directions that nothing here tells anything about.

    Attributes:
        basis: (p, r) these coordinates in units of what is plausible.
        curvature, variance: (N, r, r) of each candidate.
        weight: (r, r) of the tip's variance, m².
        untold: variance of the tip that nothing here lessens, m².
        arm_count: how many parameters are the arm's.
        criterion: ``tip`` or ``d``.
    """

    basis: FloatArray
    curvature: FloatArray
    variance: FloatArray
    weight: FloatArray
    unestimated: float
    arm_count: int
    criterion: str

    @classmethod
    def over(
        cls,
        space: Space,
        information: Sequence[SharedInformation],
        weight: FloatArray,
        criterion: str,
        present: SharedInformation,
    ) -> Design:
        """Stack the candidates' matrices.

        Args:
            space: the unknowns.
            information: information of each candidate.
            weight: (p, p) W with tip variance = trace(W C), C in SI units.
            criterion: ``tip`` or ``d``.
            present: information at hand.
        """
        scale = 1.0 / np.sqrt(space.regulariser)
        total = present.curvature + sum(t.curvature for t in information)
        values, vectors = np.linalg.eigh(scale[:, None] * total * scale)
        basis = scale[:, None] * vectors[:, values > _ESTIMATED]
        tip = weight * np.outer(space.unit, space.unit)
        inner = basis.T @ tip @ basis
        unestimated = float(scale @ (np.diag(tip) * scale) - np.trace(inner))
        return cls(
            basis,
            np.array([basis.T @ t.curvature @ basis for t in information]),
            np.array([basis.T @ t.variance @ basis for t in information]),
            inner,
            max(unestimated, 0.0),
            space.arm_count,
            criterion,
        )

    def __len__(self) -> int:
        return len(self.curvature)

    def values(self, curvature: FloatArray, variance: FloatArray) -> FloatArray:
        """The criterion, smaller is better, (...) for matrices (..., r, r)."""
        spread = self._spread(curvature, variance)
        return self._estimated(spread) if self.criterion == "tip" else self._d(spread)

    def tip(self, start: SharedInformation, chosen: Sequence[int] = ()) -> float:
        """Root mean square uncertainty of the tip, m."""
        information = float(self._estimated(self._spread(*self.of(start, chosen))))
        return math.hypot(information, math.sqrt(self.unestimated))

    def d(self, start: SharedInformation, chosen: Sequence[int] = ()) -> float:
        """Log uncertainty of all parameters per one of the arm's, up to a constant."""
        return float(self._d(self._spread(*self.of(start, chosen))))

    def of(self, start: SharedInformation, chosen: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Curvature and variance (r, r) of the start and a choice together."""
        rows = list(chosen)
        return (
            self.basis.T @ start.curvature @ self.basis + self.curvature[rows].sum(axis=0),
            self.basis.T @ start.variance @ self.basis + self.variance[rows].sum(axis=0),
        )

    def value(self, start: SharedInformation, chosen: Sequence[int]) -> float:
        """The criterion of one choice."""
        return float(self.values(*self.of(start, chosen)))

    def best_next(self, start: SharedInformation, chosen: Sequence[int]) -> tuple[int, float]:
        """The candidate to add to a choice, and the criterion with it."""
        curvature, variance = self.of(start, chosen)
        values = self.values(curvature + self.curvature, variance + self.variance)
        values[list(chosen)] = np.inf
        best = int(np.argmin(values))
        return best, float(values[best])

    def _spread(self, curvature: FloatArray, variance: FloatArray) -> FloatArray:
        prior = np.eye(curvature.shape[-1])
        bread = np.linalg.inv(curvature + prior)
        return np.asarray(bread @ (variance + prior) @ bread)

    def _estimated(self, spread: FloatArray) -> FloatArray:
        """The tip's uncertainty without what nothing lessens: that would drown small gains."""
        information = np.einsum("ij,...ji->...", self.weight, spread)
        return np.asarray(np.sqrt(np.maximum(information, 0.0)))

    def _d(self, spread: FloatArray) -> FloatArray:
        _, logarithm = np.linalg.slogdet(spread)
        return np.asarray(0.5 * logarithm / self.arm_count)


def greedy(
    design: Design, start: SharedInformation, count: int, chosen: Sequence[int] = ()
) -> list[int]:
    """``count`` candidates, each the best after those before it; fewer where there are fewer."""
    found = list(chosen)
    while len(found) < min(count, len(design)):
        found.append(design.best_next(start, found)[0])
    return found


def exchange(design: Design, start: SharedInformation, chosen: Sequence[int]) -> list[int]:
    """Exchange single candidates until none is worth it; best first in the end."""
    found = list(chosen)
    value = design.value(start, found)
    for _ in range(_MOST_PASSES):
        before = value
        for place in range(len(found)):
            others = found[:place] + found[place + 1 :]
            other, better = design.best_next(start, others)
            if better < value - _WORTH * abs(value):
                found[place], value = other, better
        if value >= before:
            break
    return ordered(design, start, found)


def best_set(design: Design, start: SharedInformation, count: int) -> list[int]:
    """Greedy choice, improved by exchange; best first."""
    return exchange(design, start, greedy(design, start, count))


def ordered(design: Design, start: SharedInformation, chosen: Sequence[int]) -> list[int]:
    """The same candidates, each the best of those left after those before it."""
    left, found = list(chosen), list[int]()
    while left:
        values = [design.value(start, [*found, k]) for k in left]
        found.append(left.pop(int(np.argmin(values))))
    return found


def random_sets(design: Design, count: int, sets: int, seed: int) -> list[list[int]]:
    """Random choices of ``count`` different candidates."""
    rng = np.random.default_rng(seed)
    size = min(count, len(design))
    return [rng.choice(len(design), size, replace=False).tolist() for _ in range(sets)]
