"""Directional force: what the readings do when the seated tip is pushed this way and that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from suta_calib.analysis.repeatability.backlash_search import PERMUTATIONS, PlaySearch, search_play
from suta_calib.analysis.repeatability.direction_groups import DirectionGroups
from suta_calib.analysis.repeatability.scatter import PositionScatter
from suta_calib.arrays import FloatArray
from suta_calib.units import Unit


@dataclass(frozen=True)
class JointPush:
    """What the direction of the push does to one joint, rad (m for a prismatic joint).

    Attributes:
        joint: its name.
        unit: rad or m.
        means: mean deviation of the reading by direction.
        peak_to_peak: between the two means farthest apart, whatever the other joints do.
        play: the same given the other joints: what this one does out of step with them.
        chance: play that noise alone exceeds once in twenty.
        tip: what the play moves the tip, m, by the joint's column of the Jacobian.
        p_value: chance of so much out of step with any joint, if directions did nothing more than
            what the joints that give explain.
        gives: whether noise is no explanation.
        as_well: joints that would have explained it nearly as well: it may be one of them.
    """

    joint: str
    unit: Unit
    means: Mapping[str, float]
    peak_to_peak: float
    play: float
    chance: float
    tip: float
    p_value: float
    gives: bool
    as_well: tuple[str, ...] = ()


@dataclass(frozen=True)
class DirectionalForce:
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
    def giving(self) -> JointPush | None:
        """Of the joints that noise does not explain, the one that moves the tip most, or None."""
        return max((j for j in self.joints if j.gives), key=lambda each: each.tip, default=None)


def directional_force(
    joints: Sequence[tuple[str, Unit, float]],
    away: FloatArray,
    position: FloatArray,
    direction: NDArray[np.str_],
    protocol: NDArray[np.str_] | None = None,
    seed: int = 0,
) -> DirectionalForce:
    """Compare visits that were pushed in different directions.

    Args:
        joints: name, unit and lever (m the tip moves per unit) of each.
        away: (n, joints) deviations of the readings from their mean, rad or m.
        position: (n, 3) of the tip, m.
        direction: (n,) labels, two or more different ones, each at least three times.
        protocol: (n,) labels; what differs between protocols is no effect of a direction.
        seed: of the permutations.
    """
    groups = DirectionGroups.of(direction, protocol)
    values = groups.centred(np.hstack([away, position]))
    random = np.random.default_rng(seed)
    search = search_play(groups, values[:, : len(joints)], random)
    means = groups.means(values)
    tip = means[:, len(joints) :]
    rows = (position[direction == name] for name in groups.names)
    return DirectionalForce(
        {name: PositionScatter.of(each) for name, each in zip(groups.names, rows, strict=True)},
        float(np.linalg.norm(tip[:, None] - tip[None], axis=-1).max()),
        _tip_p_value(groups, values[:, len(joints) :], random),
        tuple(_push(groups, joints, means[:, k], search, k) for k in range(len(joints))),
        values - groups.member @ means,
    )


def _push(
    groups: DirectionGroups,
    joints: Sequence[tuple[str, Unit, float]],
    means: FloatArray,
    search: PlaySearch,
    k: int,
) -> JointPush:
    name, unit, lever = joints[k]
    play = float(np.ptp(search.plays[:, k]))
    return JointPush(
        name,
        unit,
        dict(zip(groups.names, means.tolist(), strict=True)),
        float(np.ptp(means)),
        play,
        float(search.chance[k]),
        lever * play,
        float(search.p_values[k]),
        k in search.giving,
        tuple(joints[other][0] for other in search.as_well.get(k, ())),
    )


def _tip_p_value(
    groups: DirectionGroups, position: FloatArray, random: np.random.Generator
) -> float:
    """Chance of barycentres so far apart under permuted labels."""
    orders = (groups.shuffled(random) for _ in range(PERMUTATIONS))
    drawn = [groups.between(position, order) for order in orders]
    above = np.sum(np.array(drawn) >= groups.between(position) * (1 - 1e-9))
    return float(1 + above) / (PERMUTATIONS + 1)
