"""Finds parameters that the data determine, alone or in combinations, and all others.

A direction of the parameters is weak where its predicted standard deviation exceeds a tenth of
what is plausible (the parameter's bound), or where noise alone would excite it as much. The fewest
parameters are fixed at nominal so that no weak direction is left; each fixed one has a combination
that tells what moves with it. Rank is never asked for: with noise no direction is exactly singular.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.errors import ParameterError
from suta_calib.model.parameters import MASS, OFFSET, ROTATION, ParameterSet
from suta_calib.solver.information import Information

# Standard deviation over plausible range beyond which a number is not worth reporting: a value
# anywhere within ± the bound has one of 0.58 before any measurement.
WEAK: Final = 0.1
# Of a direction's information, what noise may make up: it biases an estimate by as much.
NOISE_INDUCED_SHARE: Final = 0.01
# Relative eigenvalue below which a direction is null to rounding.
ROUNDING: Final = 1e-13


@dataclass(frozen=True, eq=False)
class Combination(Displayable):
    """A direction of the parameters that changes no observation.

    Attributes:
        fixed: the parameter that stays at nominal because of it.
        direction: change of each parameter that takes part, in its own unit (m, rad), per unit
            of the fixed one.
    """

    fixed: str
    direction: dict[str, float]

    @property
    def alone(self) -> bool:
        """Whether the fixed parameter is undetermined by itself."""
        return len(self.direction) == 1


@dataclass(frozen=True, eq=False)
class _LeftOpen:
    """What the data leave open among (n,) parameters, in plausible units.

    ``chosen`` are fixed for the directions ``weak`` (n, chosen). The curvature is with priors;
    ``noise_induced`` is what noise makes up of it.
    """

    names: NDArray[np.str_]
    unit: FloatArray
    chosen: list[int]
    weak: FloatArray
    curvature: FloatArray
    noise_induced: FloatArray

    def combinations(self) -> Iterator[Combination]:
        """The directions by name, in physical units per unit of the fixed parameter."""
        if not self.chosen:
            return
        for column, index in zip(self._echelon().T, self.chosen, strict=True):
            physical = column * self.unit / self.unit[index]
            direction = {str(self.names[i]): float(physical[i]) for i in np.flatnonzero(physical)}
            yield Combination(str(self.names[index]), direction)

    def _echelon(self) -> FloatArray:
        """The weak directions with one fixed parameter each, and nothing that noise put there.

        Entries are dropped while the direction stays as weak as it was: an exact null direction
        keeps all of its true parts, one that is only weak keeps those that make it so.
        """
        curvature, noise_induced = self.curvature, self.noise_induced
        echelon = self.weak @ np.linalg.inv(self.weak[self.chosen])
        floor = 1e3 * ROUNDING * max(float(np.linalg.eigvalsh(curvature)[-1]), 1e-300)
        for column in echelon.T:
            along = curvature @ column
            information = left = float(column @ along)
            exact = information <= floor
            still_weak = max(4.0 * information, 1e-3 * floor if exact else 0.25 / WEAK**2)
            parts = np.argsort(np.abs(column))
            for i in parts[:-1]:
                # What is left without this part, and what noise made of it.
                part, column[i] = column[i], 0.0
                left += part * (part * curvature[i, i] - 2.0 * along[i])
                by_noise = (
                    0.0 if exact else float(column @ noise_induced @ column) / NOISE_INDUCED_SHARE
                )
                if left > max(still_weak, by_noise):
                    column[i] = part
                    break
                along -= part * curvature[:, i]
        return echelon


@dataclass(frozen=True, eq=False)
class Identification(Displayable):
    """Which parameters are identified, and which are fixed.

    What is fixed is all that a refit asks for, and half the work: the rest is done when asked for.

    Attributes:
        fixed: indices of the parameters that must stay at nominal.
        left_open: the directions for which they do: the arm's, then the terms' own.
        arm_information: (n, n) in plausible units on the arm's parameters; on the own ones where
            there is no arm.
    """

    fixed: IntArray
    left_open: tuple[_LeftOpen, ...]
    arm_information: FloatArray

    @cached_property
    def combinations(self) -> tuple[Combination, ...]:
        """One for each fixed parameter, in the same order."""
        return tuple(
            combination for group in self.left_open for combination in group.combinations()
        )

    @cached_property
    def singular_values(self) -> FloatArray:
        """Of the root of `arm_information`, descending."""
        return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(self.arm_information)[::-1], 0.0)))

    def given(self, name: str) -> tuple[str, ...]:
        """Fixed parameters whose nominal values this one's value depends on."""
        return tuple(c.fixed for c in self.combinations if name in c.direction and name != c.fixed)


def identify(
    parameters: ParameterSet, arm_count: int, information: Information, precision: FloatArray
) -> Identification:
    """Choose the parameters to fix.

    Args:
        parameters: the arm's first, then the terms' own.
        arm_count: how many are the arm's.
        information: of the data, without priors, (n, n).
        precision: (n,) 1/prior² of each parameter, zero without one.

    Returns:
        What to fix and why. The arm is judged with the terms' own unknowns free to follow;
        among the own ones only what stays weak for a known arm is fixed.
    """
    # What has a prior is known well enough by decree: it is never fixed.
    prior_std = np.where(precision > 0, 1.0 / np.sqrt(np.maximum(precision, 1e-300)), np.nan)
    unit = np.where(precision > 0, 2.0 * prior_std / WEAK, parameters.array("plausible"))
    names = np.array(parameters.names)
    free = np.array([p.free for p in parameters.values()], dtype=bool)
    matrices = (information.curvature, information.variance, information.noise_induced)
    scaled = [m * np.outer(unit, unit) for m in matrices]
    prior = precision * unit**2
    arm, own_columns = (
        np.flatnonzero(free[:arm_count]),
        np.flatnonzero(free[arm_count:]) + arm_count,
    )
    reduced = schur_complement(scaled, prior, arm, own_columns)
    fixed, left_open = list[int](), list[_LeftOpen]()
    rank = _preference(parameters)
    groups = [(arm, reduced)] if len(arm) else []
    if len(own_columns):
        groups.append((own_columns, [m[np.ix_(own_columns, own_columns)] for m in scaled]))
    for members, of_members in groups:
        chosen, directions = _choose_fixed(of_members, prior[members], rank[members])
        fixed += [int(members[i]) for i in chosen]
        of_group = of_members[0] + np.diag(prior[members])
        left_open.append(
            _LeftOpen(names[members], unit[members], chosen, directions, of_group, of_members[2])
        )
    of_arm = reduced[0] if len(arm) else scaled[0]
    return Identification(np.array(fixed, dtype=np.intp), tuple(left_open), of_arm)


def schur_complement(
    matrices: list[FloatArray], prior: FloatArray, arm: IntArray, own_columns: IntArray
) -> list[FloatArray]:
    """Information on some parameters alone, once the others have followed wherever they move them.

    The first of the matrices (n, n) is the curvature, which says how the others follow; then come
    perhaps its variance, and what noise makes up of it. The prior's precision (n,) of what is
    eliminated tells of what stays.
    """
    if not len(own_columns):
        return [m[np.ix_(arm, arm)] for m in matrices]
    curvature = matrices[0] + np.diag(prior)
    inverse = np.linalg.pinv(curvature[np.ix_(own_columns, own_columns)], 1e-11, True)
    follow = np.vstack([np.eye(len(arm)), -inverse @ curvature[np.ix_(own_columns, arm)]])
    both = np.concatenate([arm, own_columns])
    of_prior = np.diag(np.concatenate([np.zeros(len(arm)), prior[own_columns]]))
    return [
        follow.T @ (m[np.ix_(both, both)] + (of_prior if k < 2 else 0.0)) @ follow
        for k, m in enumerate(matrices)
    ]


def _choose_fixed(
    matrices: list[FloatArray], prior: FloatArray, rank: FloatArray
) -> tuple[list[int], FloatArray]:
    """Indices to fix, and the weak directions (n, fixed) they stand for."""
    weak = _weak_directions(matrices, prior)
    chosen = list[int]()
    remaining = weak.copy()
    while remaining.shape[1]:
        loading = np.einsum("ik,ik->i", remaining, remaining)
        candidates = np.flatnonzero(loading >= 0.8 * loading.max())
        pick = int(candidates[np.argmin(rank[candidates])])
        chosen.append(pick)
        # What is left of the weak directions once this parameter no longer moves: Householder's
        # reflection takes its row to the first axis.
        mirror = remaining[pick].copy()
        mirror[0] += np.copysign(np.linalg.norm(mirror), mirror[0])
        across = remaining @ mirror * (2.0 / (mirror @ mirror))
        remaining = (remaining - np.outer(across, mirror))[:, 1:]
    return chosen, weak


def _weak_directions(matrices: list[FloatArray], prior: FloatArray) -> FloatArray:
    """Orthonormal basis (n, k) of what the data leave open, in plausible units."""
    curvature, variance, noise_induced = matrices
    if not np.isfinite(curvature).all():
        raise ParameterError(
            "a Jacobian with values that are not finite",
            "finite readings and parameter values at the start",
        )
    values, vectors = np.linalg.eigh(curvature + np.diag(prior))
    floor = ROUNDING * max(float(values[-1]), 1e-300)
    along = [np.sum(vectors * (m @ vectors), axis=0) for m in (variance, noise_induced)]
    by_prior = np.einsum("ik,i->k", vectors**2, prior)
    spread = np.sqrt(np.maximum(np.maximum(along[0] + by_prior, values), 0.0)) / np.maximum(
        values, floor
    )
    # Whatever the data are worth, a prior alone leaves no more than itself.
    spread = np.minimum(spread, np.maximum(by_prior, 1e-300) ** -0.5)
    by_noise = along[1] * NOISE_INDUCED_SHARE**-1 > np.maximum(values - by_prior, floor)
    weak = (values < floor) | (spread > WEAK) | (by_noise & (by_prior <= 0))
    return np.asarray(vectors[:, weak])


def _preference(parameters: ParameterSet) -> FloatArray:
    """Among equals, fix masses and then what is no geometry first, then turns, lengths, offsets.

    Of those zeros before lengths, base first.
    """
    rank = []
    for k, p in enumerate(parameters.values()):
        group = 0 if p.key in ROTATION else 2 if p.key == OFFSET else 1
        if not p.geometric:
            group = -2 if p.key == MASS else -1
        rank.append(group + (0.5 if p.nominal else 0.0) + 1e-6 * k)
    return np.array(rank)
