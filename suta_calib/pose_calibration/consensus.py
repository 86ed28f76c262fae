"""A robust start: the model on which most rows agree.

Least median of squares over seeded minimal samples (Rousseeuw 1984, doi:10.2307/2288718), the best
of them concentrated on their better half (Rousseeuw and Van Driessen 1999, doi:10.2307/1270566).
No scale of the noise is needed, nor a unit of length: several kinds of residuals are weighed by
their own spread. Nearly half of the rows may be anything.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, Self

import numpy as np
from scipy.special import chdtri

from suta_calib.arrays import BoolArray, FloatArray, IntArray

TRIES: Final = 300
# Rows on which all models are tried before the best 40 of them are tried on all; the same authors
# begin with parts of as many.
SCREENING: Final = 300
# Rows that tell models apart as well as more do; so many Rousseeuw and Van Driessen take of more.
MOST_ROWS: Final = 1_500
# Probability that a set without outliers loses a row.
FALSE_ALARM: Final = 0.01
# A residual is three components, each normal.
DIMENSION: Final = 3


@dataclass(frozen=True, eq=False)
class Consensus:
    """Rows that agree, ``inliers`` (n,), and ``sigmas`` (kinds,): scatter of one component each."""

    inliers: BoolArray
    sigmas: FloatArray

    @classmethod
    def of_all(cls, count: int, *sigmas: float) -> Self:
        """All of ``count`` rows, whose residuals scatter like this."""
        return cls(np.ones(count, dtype=np.bool_), np.array(sigmas))


def find_consensus(
    count: int,
    samples: IntArray,
    propose: Callable[[IntArray], Any],
    residuals: Callable[[Any, IntArray], FloatArray],
    needed: int,
) -> Consensus:
    """The rows that agree, from minimal samples.

    Of many rows a random part of `MOST_ROWS`, the same for every seed, tells the models apart; the
    best model then judges them all.

    Args:
        count: of the rows.
        samples: (m, k) rows of each minimal sample, from `minimal_samples`.
        propose: closed-form models of rows (m, k), with a leading dimension m.
        residuals: norms (m, r, kinds) of the residuals of rows (r,) under m models.
        needed: rows that determine a solution.
    """
    rows = some_rows(count)
    # As many rows as a solution must fit for the highest breakdown.
    half = min(len(rows), (len(rows) + needed + 1) // 2)
    if len(rows) > SCREENING:
        screened = rows[np.linspace(0, len(rows) - 1, SCREENING).astype(np.intp)]
        part = min(len(screened), (len(screened) + needed + 1) // 2)
        samples = samples[_best(_score(residuals(propose(samples), screened), part), 40)]
    every = residuals(propose(samples), rows)
    best = _best(_score(every, half), 8)
    basis, norms = [*samples[best]], every[best]
    kinds, going = norms.shape[-1], np.arange(len(norms))
    for _ in range(20):
        scale = _scale(norms, half)[going]
        distance = np.sum((norms[going] / scale[:, None, :]) ** 2, axis=-1)
        order = np.argsort(distance, axis=-1, kind="stable")[:, :half]
        closest = rows[np.sort(order, axis=-1)]
        again = residuals(propose(closest), rows)
        better = _score(again, half) < np.log(scale).sum(axis=-1)
        norms[going[better]] = again[better]
        for k, chosen in zip(going[better], closest[better], strict=True):
            basis[k] = chosen
        # From the same rows as before one that was not better comes to the same again.
        going = going[better]
        if not len(going):
            break
    winner = int(np.argmin(_score(norms, half)))
    # The scatter that the better half shows; a minimal fit to few rows is too close to them
    # (Rousseeuw and Leroy 1987, p. 202).
    sigmas = _scale(norms[[winner]], half)[0]
    sigmas /= np.sqrt(chdtri(DIMENSION, 1.0 - half / (len(rows) + 1)))
    sigmas *= 1.0 + 5.0 / max(len(rows) - half, 1)
    norms_of_all = norms[winner]
    if len(rows) < count:
        norms_of_all = residuals(propose(basis[winner][None]), np.arange(count, dtype=np.intp))[0]
    inliers = np.sum((norms_of_all / sigmas) ** 2, axis=-1) <= outlier_limit(count, kinds)
    return Consensus(inliers, sigmas)


def _best(scores: FloatArray, count: int) -> IntArray:
    return np.argsort(scores, kind="stable")[:count]


def some_rows(count: int) -> IntArray:
    """All rows of few, (r,); of more a random part, drawn with a seed of its own, in order."""
    if count <= MOST_ROWS:
        return np.arange(count, dtype=np.intp)
    drawn = np.random.default_rng(0).choice(count, MOST_ROWS, replace=False)
    return np.sort(drawn).astype(np.intp)


def minimal_samples(group: IntArray, size: int, seed: int) -> IntArray:
    """``size`` distinct rows of one group each, (TRIES, size), sorted; the same for a seed."""
    group = np.ascontiguousarray(group, dtype=np.intp)
    return _drawn(group.tobytes(), size, seed)


# Every frame of a body, and every fit of one data set in another way, draws the same again.
@lru_cache(maxsize=64)
def _drawn(groups: bytes, size: int, seed: int) -> IntArray:
    group = np.frombuffer(groups, dtype=np.intp)
    random = np.random.default_rng(seed)
    members = [np.flatnonzero(group == g) for g in np.unique(group)]
    members = [m for m in members if len(m) >= size]
    weight = np.array([len(m) for m in members]) / sum(len(m) for m in members)
    chosen = random.choice(len(members), TRIES, p=weight)
    drawn = [random.choice(members[g], size, replace=False) for g in chosen]
    samples = np.sort(np.array(drawn, dtype=np.intp), axis=1)
    samples.flags.writeable = False
    return samples


def outlier_limit(count: int, kinds: int) -> float:
    """Squared distance, in units of the scatter, that a set of ``count`` inliers hardly exceeds."""
    return float(chdtri(DIMENSION * kinds, FALSE_ALARM / count))


def _scale(norms: FloatArray, half: int) -> FloatArray:
    """The half-th smallest residual of each kind, (m, kinds); never zero."""
    ordered = np.partition(norms, half - 1, axis=-2)[..., half - 1, :]
    floor = 1e-12 * np.max(norms, axis=(-3, -2))
    return np.asarray(np.maximum(ordered, np.maximum(floor, 1e-300)))


def _score(norms: FloatArray, half: int) -> FloatArray:
    """Sum of logarithms: no kind of residual has a unit that counts."""
    return np.asarray(np.log(_scale(norms, half)).sum(axis=-1))
