"""Which joints' readings go with the direction of the push, out of step with the others.

The seat holds the tip, so the true angles stay what they were but for the seat's own clearance; a
joint with play, or one that yields before its encoder sees it, reads something else for every
direction. The clearance moves all joints together, by far more than the play; the play moves one
reading out of step with the others. So each joint is looked at given the others: with the
covariance C of the readings within the directions and the mean m_d of direction d, the best
explanation by one joint is g_jd = (C^-1 m_d)_j / (C^-1)_jj, and it takes W_j = sum n_d g_jd²
(C^-1)_jj out of the misfit (generalised least squares). The largest W of any joint under permuted
labels (Westfall, Young 1993, ISBN 978-0-471-55761-6) says what noise alone gives to the worst of
them. Joints are taken one after the other until noise explains the rest. Where the clearance lets
two joints do the same to the tip, the readings cannot tell which of them gives: that is said.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.analysis.repeatability.direction_groups import DirectionGroups
from suta_calib.arrays import FloatArray

# Noise names a joint in this share of arms without any play.
FALSE_ALARM: Final = 0.01
PERMUTATIONS: Final = 1999
# Twice the logarithm of a hundred: odds that are no longer worth mentioning.
_AS_WELL: Final = 9.2
_FEW: Final = 500
# What noise exceeds in the other share of permutations.
_CHANCE: Final = 0.95
# Share of its variance that a joint has to itself at least: rounding, and joints that never move.
_OWN: Final = 1e-7


@dataclass(frozen=True, eq=False)
class PlaySearch:
    """What was found.

    Attributes:
        giving: indices of the joints that give, in the order they were found.
        as_well: for each of these, the joints that would have explained it nearly as well.
        plays: (k, joints) what each joint does out of step, by direction, rad or m.
        p_values: (joints,) chance of so much out of step with any joint.
        chance: (joints,) peak to peak of the play that noise exceeds once in twenty.
    """

    giving: tuple[int, ...]
    as_well: Mapping[int, tuple[int, ...]]
    plays: FloatArray
    p_values: FloatArray
    chance: FloatArray


def search_play(
    groups: DirectionGroups, values: FloatArray, random: np.random.Generator
) -> PlaySearch:
    """Take joints one after the other until noise explains what is left.

    Args:
        groups: the directions.
        values: (n, joints) deviations of the readings, protocols' means taken out, rad or m.
        random: of the permutations.
    """
    found: list[int] = []
    as_well: dict[int, tuple[int, ...]] = {}
    p_values = np.ones(values.shape[1])
    while True:
        shifts = _shifts(groups, values, found)
        step = _step(groups, values - groups.member @ shifts, found, random)
        others = [k for k in range(values.shape[1]) if k not in found]
        p_values[others] = step.p_values[others]
        best = max(others, key=lambda k: float(step.taken[k]), default=None)
        if best is None or step.p_values[best] > FALSE_ALARM:
            plays = np.where(np.isin(range(values.shape[1]), found), shifts, step.plays)
            return PlaySearch(tuple(found), as_well, plays, p_values, step.chance)
        close = (k for k in others if k != best and step.taken[best] - step.taken[k] < _AS_WELL)
        as_well[best] = tuple(close)
        found.append(best)


@dataclass(frozen=True, eq=False)
class _Step:
    """What each joint that is not yet found would explain: W (joints,), plays (k, joints)."""

    taken: FloatArray
    plays: FloatArray
    p_values: FloatArray
    chance: FloatArray


def _step(
    groups: DirectionGroups, values: FloatArray, found: Sequence[int], random: np.random.Generator
) -> _Step:
    """Look at every joint given the others, those found free to do what they like."""
    orders = (groups.shuffled(random) for _ in range(PERMUTATIONS))
    drawn = np.array([groups.means(values, order) for order in orders])
    true = groups.means(values)[None]
    taken, plays = (each[0] for each in _explained(groups, values, true, found))
    by_chance, wide = _explained(groups, values, drawn, found)
    # The joints already found have a chance too: that of being looked at alone.
    _, alone = _explained(groups, values, drawn[:_FEW], ())
    chance, first = (np.quantile(np.ptp(each, axis=1), _CHANCE, axis=0) for each in (wide, alone))
    # An effect that is equal but for rounding is no smaller one.
    above = by_chance.max(axis=1)[:, None] >= taken * (1 - 1e-9)
    return _Step(
        taken,
        plays,
        (1 + above.sum(axis=0)) / (PERMUTATIONS + 1),
        np.where(np.isin(range(len(taken)), found), first, chance),
    )


def _explained(
    groups: DirectionGroups, values: FloatArray, means: FloatArray, found: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """W (b, joints) and play (b, k, joints) of each joint by itself, for b sets of means."""
    between = np.einsum("bki,k,bkj->bij", means, groups.counts, means)
    precision = _inverse((values.T @ values - between) / len(values))
    if found:
        rows = precision[:, list(found)]
        inner = rows[:, :, list(found)]
        precision = precision - np.swapaxes(rows, 1, 2) @ np.linalg.solve(inner, rows)
    own = np.diagonal(precision, axis1=1, axis2=2).copy()
    own[:, list(found)] = np.inf
    plays = means @ precision / own[:, None]
    taken = np.einsum("k,bkj->bj", groups.counts, plays**2) * np.where(np.isinf(own), 0.0, own)
    return taken, plays


def _shifts(groups: DirectionGroups, values: FloatArray, found: Sequence[int]) -> FloatArray:
    """(k, joints) by direction: what the joints found did, all at once; zero for the others."""
    means = groups.means(values)
    shifts = np.zeros_like(means)
    if found:
        within = values - groups.member @ means
        precision = _inverse(within.T @ within / len(within))
        inner = precision[np.ix_(found, found)]
        shifts[:, found] = np.linalg.solve(inner, (means @ precision)[:, found].T).T
    return shifts


def _inverse(covariance: FloatArray) -> FloatArray:
    """Inverse of covariances (..., joints, joints), defined whatever they are."""
    variance = np.diagonal(covariance, axis1=-2, axis2=-1)
    size = np.sqrt(np.where(variance > 0, variance, 1.0))
    product = size[..., :, None] * size[..., None, :]
    joints = covariance.shape[-1]
    return np.asarray(np.linalg.inv(covariance / product + _OWN * np.eye(joints)) / product)
