"""Directional force: changes of the readings when the seated tip is pushed in directions.

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
from numpy.typing import NDArray

from suta_calib.analysis.repeatability.scatter import PositionScatter
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.terms.block import grouped
from suta_calib.units import Unit

PERMUTATIONS: Final = 1999


@dataclass(frozen=True, eq=False)
class DirectionGroups:
    """Visits by direction."""

    names: Sequence[str]  # of the k directions, in order of first appearance
    member: FloatArray  # (n, k) one where a visit has the direction, else zero
    strata: Sequence[IntArray]  # rows of each protocol: labels change places within one only

    @classmethod
    def of(
        cls, direction: NDArray[np.str_], protocol: NDArray[np.str_] | None = None
    ) -> DirectionGroups:
        """From labels (n,) of direction and protocol."""
        names, index = grouped(direction)
        strata = [np.arange(len(direction))]
        if protocol is not None:
            strata = [np.flatnonzero(protocol == label) for label in np.unique(protocol)]
        return cls(names, np.eye(len(names))[index], strata)

    @property
    def counts(self) -> FloatArray:
        """(k,) visits of each direction."""
        return np.asarray(self.member.sum(axis=0))

    def means(self, values: FloatArray, order: IntArray | None = None) -> FloatArray:
        """(k, c) means of values (n, c), with the labels in another order if one is given."""
        member = self.member if order is None else self.member[order]
        return np.asarray(member.T @ values / self.counts[:, None])

    def shuffled_means(self, values: FloatArray, random: np.random.Generator) -> FloatArray:
        """(b, k, c) means with the labels of each protocol dealt anew, b times."""
        drawn, order = [], np.arange(len(self.member))
        for _ in range(PERMUTATIONS):
            for rows in self.strata:
                order[rows] = random.permutation(rows)
            drawn.append(self.means(values, order))
        return np.array(drawn)


@dataclass(frozen=True, eq=False)
class BacklashSearch:
    """What was found."""

    joints: tuple[int, ...]  # indices of the joints that have it, in the order they were found
    # For each of these, the joints that would have explained it nearly as well.
    as_well: Mapping[int, tuple[int, ...]]
    backlash: FloatArray  # (k, joints) what each joint does out of step, by direction, rad or m
    p_values: FloatArray  # (joints,) chance of so much out of step with any joint
    # (joints,) peak to peak of the backlash that noise exceeds once in twenty.
    by_chance: FloatArray


def search_backlash(
    groups: DirectionGroups, values: FloatArray, random: np.random.Generator
) -> BacklashSearch:
    """Take joints one after the other until noise explains what is left of values (n, joints)."""
    loose: list[int] = []
    as_well: dict[int, tuple[int, ...]] = {}
    p_values = np.ones(values.shape[1])
    while True:
        shifts = _shifts(groups, values, loose)
        rest = values - groups.member @ shifts
        taken, alone, chance, by_chance = _step(groups, rest, loose, random)
        further = [k for k in range(values.shape[1]) if k not in loose]
        p_values[further] = chance[further]
        best = max(further, key=lambda k: float(taken[k]), default=None)
        # Noise names a joint in one of a hundred arms without any play.
        if best is None or chance[best] > 0.01:
            backlash = np.where(np.isin(range(values.shape[1]), loose), shifts, alone)
            return BacklashSearch(tuple(loose), as_well, backlash, p_values, by_chance)
        # Twice the logarithm of a hundred: odds that are no longer worth mentioning.
        close = taken[best] - taken < 9.2
        as_well[best] = tuple(k for k in further if k != best and close[k])
        loose.append(best)


def _step(
    groups: DirectionGroups, values: FloatArray, loose: Sequence[int], random: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """What each joint would explain, given the others, those found free to do what they like.

    Returns:
        W (joints,), backlash (k, joints), chance (joints,), and peak to peak by chance (joints,).
    """
    drawn = groups.shuffled_means(values, random)
    true = groups.means(values)[None]
    taken, backlash = (
        values_of_set[0] for values_of_set in _explained(groups, values, true, loose)
    )
    by_chance, wide = _explained(groups, values, drawn, loose)
    # The joints already found have a chance too: that of being looked at alone.
    _, alone = _explained(groups, values, drawn[:500], ())
    # What noise exceeds in the other share of permutations.
    chance, first = (np.quantile(np.ptp(draws, axis=1), 0.95, axis=0) for draws in (wide, alone))
    # An effect that differs by rounding alone counts as equal.
    above = by_chance.max(axis=1)[:, None] >= taken * (1 - 1e-9)
    return (
        taken,
        backlash,
        (1 + above.sum(axis=0)) / (PERMUTATIONS + 1),
        np.where(np.isin(range(len(taken)), loose), first, chance),
    )


def _explained(
    groups: DirectionGroups, values: FloatArray, means: FloatArray, loose: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """W (b, joints) and backlash (b, k, joints) of each joint by itself, for b sets of means."""
    between = np.einsum("bki,k,bkj->bij", means, groups.counts, means)
    precision = _inverse((values.T @ values - between) / len(values))
    if loose:
        rows = precision[:, list(loose)]
        inner = rows[:, :, list(loose)]
        precision = precision - np.swapaxes(rows, 1, 2) @ np.linalg.solve(inner, rows)
    own_precision = np.diagonal(precision, axis1=1, axis2=2).copy()
    own_precision[:, list(loose)] = np.inf
    backlash = means @ precision / own_precision[:, None]
    taken = np.einsum("k,bkj->bj", groups.counts, backlash**2) * np.where(
        np.isinf(own_precision), 0.0, own_precision
    )
    return taken, backlash


def _shifts(groups: DirectionGroups, values: FloatArray, loose: Sequence[int]) -> FloatArray:
    """(k, joints) by direction: what the joints found did, all at once; zero for the others."""
    means = groups.means(values)
    shifts = np.zeros_like(means)
    if loose:
        within = values - groups.member @ means
        precision = _inverse(within.T @ within / len(within))
        inner = precision[np.ix_(loose, loose)]
        shifts[:, loose] = np.linalg.solve(inner, (means @ precision)[:, loose].T).T
    return shifts


def _inverse(covariance: FloatArray) -> FloatArray:
    """Inverse of covariances (..., joints, joints), defined whatever they are."""
    variance = np.diagonal(covariance, axis1=-2, axis2=-1)
    size = np.sqrt(np.where(variance > 0, variance, 1.0))
    product = size[..., :, None] * size[..., None, :]
    joints = covariance.shape[-1]
    # Share of its variance that a joint has to itself at least: rounding, and joints that never
    # move.
    return np.asarray(np.linalg.inv(covariance / product + 1e-7 * np.eye(joints)) / product)


@dataclass(frozen=True)
class JointPush(Displayable):
    """Effect of the direction of the push on one joint, rad (m for a prismatic joint).

    Attributes:
        joint: its name.
        unit: rad or m.
        means: mean deviation of the reading by direction.
        peak_to_peak: between the two means farthest apart, whatever the other joints do.
        backlash: the same given the other joints: what this one does out of step with them.
        by_chance: backlash that noise alone exceeds once in twenty.
        tip: what the backlash moves the tip, m, by the joint's column of the Jacobian.
        p_value: chance of so much out of step with any joint, if directions did nothing more than
            what the joints that have backlash explain.
        has_backlash: whether noise is no explanation.
        as_well: joints that would have explained it nearly as well: it may be one of them.
    """

    joint: str
    unit: Unit
    means: Mapping[str, float]
    peak_to_peak: float
    backlash: float
    by_chance: float
    tip: float
    p_value: float
    has_backlash: bool
    as_well: tuple[str, ...] = ()

    @property
    def extremes(self) -> tuple[str, str]:
        """The two directions between whose means the reading changes most: low, then high."""
        ranked = sorted(self.means, key=self.means.__getitem__)
        return ranked[0], ranked[-1]


@dataclass(frozen=True)
class DirectionalForce(Displayable):
    """The directions compared.

    Attributes:
        scatter: of the visits of each direction about their own barycentre.
        tip_shift: distance between the two barycentres farthest apart, m: ISO 9283:1998, 7.2.3,
            the multi-directional pose accuracy variation.
        tip_p_value: chance of barycentres so far apart, if directions did nothing.
        joints: in the order of the chain.
        within: (n, joints + 3) readings and positions, what directions and protocols explain
            taken out.
    """

    scatter: Mapping[str, PositionScatter]
    tip_shift: float
    tip_p_value: float
    joints: tuple[JointPush, ...]
    within: FloatArray

    @property
    def loosest(self) -> JointPush | None:
        """Of the joints that noise does not explain, the one that moves the tip most, or None."""
        return max(
            (j for j in self.joints if j.has_backlash), key=lambda joint: joint.tip, default=None
        )


def directional_force(
    joints: Sequence[tuple[str, Unit, float]],
    away: FloatArray,
    position: FloatArray,
    direction: NDArray[np.str_],
    protocol: NDArray[np.str_] | None = None,
    seed: int = 0,
) -> DirectionalForce:
    """Compare visits pushed in two or more directions (n,), three or more times in each.

    ``joints`` are names, units and levers (m the tip moves per unit), ``away`` (n, joints) the
    deviations of the readings from their mean, rad or m, ``position`` (n, 3) is of the tip, m. What
    differs between protocols (n,) is no effect of a direction. ``seed`` is of the permutations.
    """
    groups = DirectionGroups.of(direction, protocol)
    values = np.hstack([away, position])
    for rows in groups.strata:
        values[rows] -= values[rows].mean(axis=0)
    random = np.random.default_rng(seed)
    search = search_backlash(groups, values[:, : len(joints)], random)
    means = groups.means(values)
    tip = means[:, len(joints) :]
    # Whether permuted labels explain as much of the sum of squares of the places.
    drawn = groups.shuffled_means(values[:, len(joints) :], random)
    between = [np.einsum("k,...kc->...", groups.counts, means**2) for means in (tip, drawn)]
    above = int(np.sum(between[1] >= between[0] * (1 - 1e-9)))
    pushes = []
    for k, (name, unit, lever) in enumerate(joints):
        backlash = float(np.ptp(search.backlash[:, k]))
        pushes.append(
            JointPush(
                name,
                unit,
                dict(zip(groups.names, means[:, k].tolist(), strict=True)),
                float(np.ptp(means[:, k])),
                backlash,
                float(search.by_chance[k]),
                lever * backlash,
                float(search.p_values[k]),
                k in search.joints,
                tuple(joints[other][0] for other in search.as_well.get(k, ())),
            )
        )
    return DirectionalForce(
        {name: PositionScatter.of(position[direction == name]) for name in groups.names},
        float(np.linalg.norm(tip[:, None] - tip[None], axis=-1).max()),
        (1 + above) / (PERMUTATIONS + 1),
        tuple(pushes),
        values - groups.member @ means,
    )
