"""What repeats of the same touch say: how far they scatter, and which of them are grossly wrong.

Repeats see the same posture, so what is wrong with the model is wrong in all of them alike. Only
what differs among them is scatter, and only what stands apart from them a gross error. Residuals
much larger than repeats explain are the model's own (the lack-of-fit comparison of regression;
Draper and Smith, Applied Regression Analysis, chapter 2): values and standard deviations then hold
only within that model.

What the model gets wrong is the same in repeats of one touch, and nearly the same in two rows whose
joints read nearly alike. The difference of their residuals is therefore mostly noise, and half of
its variance is that of one row (von Neumann 1941, doi:10.1214/aoms/1177731677; for regression:
Rice 1984, doi:10.1214/aos/1176346788). Neighbours that are far apart share less of the model's
error, so their estimate is too large rather than too small.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from scipy.spatial import cKDTree

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.solver.solution import Solution
from suta_calib.terms.block import Block
from suta_calib.terms.poses import ArmPoses
from suta_calib.terms.term import Term
from suta_calib.trust.held_out import robust_level
from suta_calib.units import Unit

# Residuals over the scatter of repeats from which a model is said to lack something.
LACKING: Final = 1.5
# Of a normal distribution: median absolute value over standard deviation.
NORMAL_MEDIAN: Final = 0.6745
# Groups of repeats below which their scatter says too little.
ENOUGH_GROUPS: Final = 10


def repeat_groups(block: Block, touch: IntArray) -> tuple[IntArray, IntArray]:
    """Number of the group (n,) of rows that repeat each other, and the groups' sizes.

    ``touch`` (samples,) is the number of the touch that each sample repeats, here and below.
    """
    # A residual of two samples may be seen from either end; distances do not care.
    members = np.sort(touch[block.samples], axis=1)
    _, group, count = np.unique(members, axis=0, return_inverse=True, return_counts=True)
    return group.reshape(-1).astype(np.intp), count.astype(np.intp)


def one_of_each_rest(term: Term, block: Block) -> IntArray:
    """Rows (k,) of a block of a term, one for each rest: reading again there repeats no touch."""
    rests = np.sort(term.poses.rests[block.samples], axis=1)
    return np.sort(np.unique(rests, axis=0, return_index=True)[1])


def repeat_variance(
    block: Block, residual: FloatArray, touch: IntArray, sound: BoolArray
) -> float | None:
    """Variance of the norm of sound residuals (n, d) among repeats, or None without enough."""
    residual = residual[sound]
    group, _ = repeat_groups(block, touch)
    _, group, count = np.unique(group[sound], return_inverse=True, return_counts=True)
    if np.sum(count > 1) < ENOUGH_GROUPS:
        return None
    inside = about_mean(residual, group, count)
    return float(np.sum(inside**2) / np.sum(count - 1))


def about_mean(residual: FloatArray, group: IntArray, count: IntArray) -> FloatArray:
    """(n, d) departures from the mean of each row's group."""
    total = np.zeros((len(count), residual.shape[1]))
    np.add.at(total, group, residual)
    return np.asarray(residual - (total / count[:, None])[group])


def gross_rows(block: Block, residual: FloatArray, touch: IntArray) -> BoolArray:
    """Which residuals (n, d) are grossly wrong, with all rows of touches that have many such.

    A row is grossly wrong if it is beyond the Huber threshold from its repeats; with fewer than
    three of them, if it is so from zero as well: what repeats agree on is the model's. Where most
    rows would be wrong, none is.
    """
    limit = block.noise.huber
    group, count = repeat_groups(block, touch)
    enough = (count > 2)[group]
    size = np.linalg.norm(residual, axis=1)
    beyond = (_from_median(residual, group, count) > limit) & (enough | (size > limit))
    samples, most = block.samples, int(block.samples.max()) + 1
    rows, bad = np.zeros(most), np.zeros(most)
    for k in range(samples.shape[1]):
        np.add.at(rows, samples[:, k], 1.0)
        np.add.at(bad, samples[:, k], beyond)
    # Of a touch's rows beyond the threshold: a displaced touch has half, any other hardly one in
    # ten.
    suspect = bad > 0.25 * rows
    wrong = np.asarray(beyond | suspect[samples].any(axis=1))
    # Of all rows: where more are beyond the threshold, it is the model that is wrong, or the
    # threshold.
    return wrong if wrong.mean() <= 0.5 else np.zeros_like(wrong)


def _from_median(residual: FloatArray, group: IntArray, count: IntArray) -> FloatArray:
    """(n,) how far each row is from the median of its repeats, from the other one of two."""
    first = np.cumsum(count) - count
    deviation = np.empty_like(residual)
    for k in range(residual.shape[1]):
        ordered = residual[np.lexsort((residual[:, k], group)), k]
        median = (ordered[first + (count - 1) // 2] + ordered[first + count // 2]) / 2
        deviation[:, k] = residual[:, k] - median[group]
    distance = np.linalg.norm(deviation, axis=1) * np.where(count == 2, 2.0, 1.0)[group]
    return np.where(count[group] == 1, np.inf, distance)


@dataclass(frozen=True)
class LackOfFit:
    """One block's residuals against its repeats.

    Attributes:
        kind: of the term.
        unit: m or rad.
        residual: robust standard deviation of one residual component.
        repeat: the same from differences between repeats of the same touch.
    """

    kind: str
    unit: Unit
    residual: float
    repeat: float

    @property
    def ratio(self) -> float:
        """Residual over repeat scatter: one for a model that lacks nothing."""
        return self.residual / self.repeat


def lack_of_fit(solution: Solution) -> tuple[LackOfFit, ...]:
    """Compare every block that has repeated touches; the others cannot be judged this way."""
    problem = solution.problem
    lines = iter(problem.linearise(solution.x, solution.sigmas))
    fits = []
    for term in problem.terms:
        touch = term.repeats()
        for block in term.blocks:
            residual, once = next(lines).residual, one_of_each_rest(term, block)
            one_of_each = replace(block, samples=block.samples[once])
            repeat = _repeat_scatter(one_of_each, residual[once], touch)
            if repeat is not None:
                level = float(np.median(np.abs(residual))) / NORMAL_MEDIAN
                fits.append(LackOfFit(term.kind, block.unit, level, repeat))
    return tuple(fits)


def _repeat_scatter(block: Block, residual: FloatArray, touch: IntArray) -> float | None:
    """Robust standard deviation of one component within groups of repeats, or None."""
    group, count = repeat_groups(block, touch)
    if np.sum(count > 1) < ENOUGH_GROUPS:
        return None
    # The mean has taken one of every group's residuals.
    lost = np.sqrt(1.0 - 1.0 / np.maximum(count, 2))[group, None]
    freed = about_mean(residual, group, count) / lost
    scatter = float(np.median(np.abs(freed[count[group] > 1]))) / NORMAL_MEDIAN
    return scatter if scatter > 0 else None


@dataclass(frozen=True)
class TouchRepeatability:
    """How far the tip comes to lie from where repeats of the same touch have it on average.

    No certificate enters and hardly the calibration: it is what a person, a seat and the readings
    do. It is the floor under every error, and not what an arm is accurate to.

    Attributes:
        rms: root mean square distance in space from the mean of the repeats, m, with the n - 1 of
            each touch.
        std: standard deviation of ``rms``, for scatter that is the same along three axes, m.
        touches: how many were repeats of another.
        places: how many different touches they repeat.
    """

    rms: float
    std: float
    touches: int
    places: int


def touch_repeatability(term: Term, values: Mapping[str, float]) -> TouchRepeatability | None:
    """Scatter of the tip among repeats of the same touch, or None without enough of them.

    What was read again at one rest counts once. Gross errors count like all others.

    Args:
        term: whose samples these are.
        values: of the arm's parameters, m and rad; nominal where not given.
    """
    once = np.unique(term.poses.rests, return_index=True)[1]
    position = term.poses.at(values)[1][once]
    _, place, count = np.unique(term.repeats()[once], return_inverse=True, return_counts=True)
    if np.sum(count > 1) < ENOUGH_GROUPS:
        return None
    repeated = count > 1
    inside = about_mean(position, place, count)[repeated[place]]
    spare = float(np.sum(count[repeated] - 1))
    rms = float(np.sqrt(np.sum(inside**2) / spare))
    std = rms / float(np.sqrt(2.0 * position.shape[1] * spare))
    return TouchRepeatability(rms, std, int(np.sum(count[repeated])), int(np.sum(repeated)))


Source = Literal["repeats", "neighbours"]


@dataclass(frozen=True)
class RowNoise:
    """Residuals of one block, and what rows alone say of its noise.

    Attributes:
        kind: of the term.
        name, unit: of the block.
        level: robust standard deviation of one component of the residuals, m or rad.
        noise: the same of the rows' own scatter; NaN where nothing tells it.
        source: what tells it.
    """

    kind: str
    name: str
    unit: Unit
    level: float
    noise: float
    source: Source

    @property
    def ratio(self) -> float:
        """Residuals over noise; NaN where nothing tells the noise."""
        return self.level / self.noise


def noise_of_rows(solution: Solution) -> list[RowNoise]:
    """One for each block of each term, in the problem's order."""
    problem = solution.problem
    lines = iter(problem.linearise(solution.x, problem.assumed_sigmas()))
    repeats = {(fit.kind, fit.unit): fit.repeat for fit in lack_of_fit(solution)}
    rows = []
    for term in problem.terms:
        for block in term.blocks:
            residual = next(lines).residual
            noise = repeats.get((term.kind, block.unit))
            source: Source = "repeats" if noise else "neighbours"
            if noise is None:
                noise = _noise_by_neighbours(term, block, residual)
            level = robust_level(residual)
            rows.append(RowNoise(term.kind, block.name, block.unit, level, noise, source))
    return rows


def _noise_by_neighbours(term: Term, block: Block, residual: FloatArray) -> float:
    """Standard deviation of one component by differences of neighbours in posture, or NaN."""
    if not isinstance(term.poses, ArmPoses) or block.samples.shape[1] != 1:
        return math.nan
    # Readings of one rest share its posture's noise: one of each.
    once = np.unique(term.poses.rests[block.samples[:, 0]], return_index=True)[1]
    # Rows below which neighbours say too little of the noise: a median of twenty is known to a
    # fifth.
    if len(once) < 20:
        return math.nan

    postures = term.poses.samples.q[block.samples[once, 0]]
    spread = np.std(postures, axis=0)
    tree = cKDTree(postures / np.where(spread > 0, spread, 1.0))
    neighbour = tree.query(tree.data, k=2)[1][:, 1]
    return robust_level(residual[once] - residual[once][neighbour]) / math.sqrt(2.0)
