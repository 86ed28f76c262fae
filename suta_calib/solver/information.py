"""What the data say about the parameters at one point: information, and how much of it is real.

Three matrices over all parameters, from the whitened Jacobian J:

    A  = Σ Jᵀ ψ' J            curvature of the robust cost (the bread of the sandwich)
    M  = Var(Σ Jᵀ ψ)          variance of its gradient (the meat), by sample rather than by row
    F  = E[ΔJᵀ ΔJ]            information that noise in the readings alone would feign

Rows that share samples are not independent: the (JᵀJ)⁻¹ of pairwise distances understates standard
deviations by two to four times. A direction v with vᵀAv not well above vᵀFv is excited by nothing
but noise (errors in variables): its estimate would be precise and wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from suta_calib.geometry import FloatArray
from suta_calib.solver.evaluation import Linearised
from suta_calib.solver.problem import Problem
from suta_calib.terms.poses import ArmPoses
from suta_calib.terms.term import IntArray

# Readings that are looked at to learn how far the tip reaches: an average needs no more.
REACH_SAMPLES: Final = 500
# Touches from which on none has leverage worth freeing residuals of.
MANY_TOUCHES: Final = 2000
# Eigenvalue of a covariance, relative to the largest, that is rounding.
ROUNDING: Final = 1e-14
# Weight that lets a direction count as feigned once half of its information is residual-made: noise
# may feign a hundredth (`identifiability.FEIGNED`).
RESIDUAL_MADE: Final = 0.02


@dataclass(frozen=True, eq=False)
class Information:
    """The matrices of this module at one point, (n, n) over all parameters, priors excluded."""

    curvature: FloatArray
    variance: FloatArray
    feigned: FloatArray


@dataclass(frozen=True, eq=False)
class Rows:
    """One block's whitened rows.

    Attributes:
        line: the block at this point.
        jacobian: (n·d, parameters) whitened, dense.
        belief: (n,) factor of each row in a robust fit, one where every row is believed.
    """

    line: Linearised
    jacobian: FloatArray
    belief: FloatArray


def whitened_rows(problem: Problem, x: FloatArray, sigmas: Sequence[float]) -> list[Rows]:
    """Residual rows of every block with their Jacobians, divided by the noise level."""
    rows = []
    for line in problem.linearise(x, sigmas):
        scale = 1.0 / line.sigma[:, None, None]
        arm, own = problem.evaluation.columns(line, scale * line.by_pose, scale * line.by_own)
        width = problem.evaluation.own_count
        other = np.zeros((len(arm), width)) if own is None else own.toarray()
        rows.append(Rows(line, np.hstack([arm, other]), np.ones(len(line.sigma))))
    return rows


def predicted_information(
    problem: Problem, x: FloatArray, sigmas: Sequence[float], *, robust: bool = False
) -> Information:
    """What samples that all scatter alike can tell.

    Args:
        problem: terms and parameters.
        x: where.
        sigmas: noise level of each block.
        robust: believe rows as Huber weighs them at x. Wrong before the fit, where a wrong geometry
            makes residuals large; needed after it, where gross errors would feign information
            (an outlier tells the scale of an arm that touched one point, and tells it wrongly).
    """
    rows = whitened_rows(problem, x, sigmas)
    if robust:
        rows = [
            replace(r, jacobian=_robust_jacobian(r), belief=np.sqrt(r.line.weight)) for r in rows
        ]
    curvature = sum(r.jacobian.T @ r.jacobian for r in rows)
    variance = sum(_predicted_variance(r) for r in rows)
    return Information(
        np.asarray(curvature), np.asarray(variance), _feigned_information(problem, x, sigmas, rows)
    )


def observed_covariance(
    problem: Problem, x: FloatArray, sigmas: Sequence[float], free: IntArray
) -> FloatArray:
    """Covariance (n, n) of the estimate at x, zero for entries that were not free.

    The sandwich A⁻¹ (M + P) A⁻¹ with the priors' precision P in A as well: scatter as the residuals
    show it, outliers as Huber weighs them, rows of one touch together.
    """
    rows = whitened_rows(problem, x, sigmas)
    prior = np.diag(problem.prior_precision())
    curvature = prior + sum(j.T @ j for j in map(_robust_jacobian, rows))
    bread = np.zeros_like(prior)
    bread[np.ix_(free, free)] = _pseudo_inverse(curvature[np.ix_(free, free)])
    covariance = bread @ prior @ bread
    for term in problem.terms:
        mine = [r for r in rows if any(r.line.view.block is b for b in term.blocks)]
        covariance += _clustered_variance(mine, term.repeats(), bread)
    return covariance


def predicted_covariance(problem: Problem, information: Information, free: IntArray) -> FloatArray:
    """The same before any residual is known, from `predicted_information`."""
    prior = np.diag(problem.prior_precision())
    bread = np.zeros_like(prior)
    inverse = _pseudo_inverse((information.curvature + prior)[np.ix_(free, free)])
    bread[np.ix_(free, free)] = inverse
    return bread @ (information.variance + prior) @ bread


def noise_levels(problem: Problem, x: FloatArray, sigmas: Sequence[float]) -> list[float]:
    """Standard deviation of one component of each block, as the residuals at x show it.

    Huber's proposal: the spread of residuals winsorised at their threshold, so that outliers do
    not count as noise; at least a millionth, because rounding is not information.
    """
    levels = []
    for line, assumed in zip(problem.linearise(x, sigmas), sigmas, strict=True):
        block = line.view.block
        squared = np.einsum("nd,nd->n", line.residual, line.residual)
        inside = np.minimum(squared, block.noise.huber**2)
        used = problem.arm_count + problem.evaluation.own_count
        freedom = max(len(squared) * block.size - used, len(squared) * block.size / 2)
        level = float(np.sqrt(inside.sum() / freedom))
        levels.append(max(level, 1e-6) if np.isfinite(level) else assumed)
    return levels


def _feigned_information(
    problem: Problem, x: FloatArray, sigmas: Sequence[float], rows: Sequence[Rows]
) -> FloatArray:
    """F: how much the Jacobian changes when the readings change by their own noise.

    The noise of the readings is not known; what is known is how far it moves the tip. Every joint
    gets the same share of it. Information that only the size of the residuals makes counts as well.
    """
    n = problem.arm_count + problem.evaluation.own_count
    total = np.zeros((n, n))
    if problem.arm is None or problem.arm_count == 0:
        return total
    before = whitened_rows(problem, x, sigmas)
    with problem.evaluation.table.shifted(_jitter(problem, x, sigmas)):
        after = whitened_rows(problem, x, sigmas)
    for row in before:
        total += _by_residual_alone(problem, row)
    for old, new, r in zip(before, after, rows, strict=True):
        belief = np.repeat(r.belief, len(old.jacobian) // len(r.belief))
        change = belief[:, None] * (new.jacobian - old.jacobian)
        total += change.T @ change
    return total


def _by_residual_alone(problem: Problem, row: Rows) -> FloatArray:
    """Information about turns that a residual in a turning frame feigns by being large.

    Rᵀ(c - p) turns with the tool, so its derivative by the tool's orientation is as long as the
    residual itself, and vanishes with it: no such residual can tell where the tool points.
    """
    line = row.line
    turns = line.by_pose * line.pattern.angular / line.sigma[:, None, None]
    size = np.linalg.norm(line.residual, axis=1) / line.sigma
    by_turn = np.linalg.norm(turns, axis=(1, 2))
    if np.any(by_turn > 1.5 * size + 1e-9) or not by_turn.any():
        return np.zeros((row.jacobian.shape[1],) * 2)
    arm, _ = problem.evaluation.columns(line, turns, line.by_own)
    whole = np.hstack([arm, np.zeros((len(arm), problem.evaluation.own_count))])
    return np.asarray(whole.T @ whole) * RESIDUAL_MADE


def _jitter(problem: Problem, x: FloatArray, sigmas: Sequence[float]) -> list[FloatArray]:
    """Noise of every arm source's readings (n, joints) that moves the tip as the residuals say."""
    random = np.random.default_rng(0)
    level = {v.first_sample: s for v, s in zip(problem.evaluation.views, sigmas, strict=True)}
    first, shifts = 0, list[FloatArray]()
    values = problem.values(x)
    for term in problem.terms:
        source = term.poses
        if isinstance(source, ArmPoses):
            share = level[first] * np.sqrt(3.0) / _reach(source, values)
            shifts.append(share * random.standard_normal(source.samples.q.shape))
        first += len(source)
    return shifts


def _reach(source: ArmPoses, values: dict[str, float]) -> float:
    """Tip motion per unit of noise in every joint, m/rad: root of the summed squared levers."""
    step = 1e-6
    q = source.samples.q[:: 1 + len(source) // REACH_SAMPLES]
    around = q + step * np.eye(q.shape[1])[:, None, :]
    _, position = source.arm.forward(np.vstack([q, *around]), values)
    rest, *turned = position.reshape(-1, len(q), 3)
    levers = (np.array(turned) - rest) / step
    return float(np.sqrt(np.sum(levers**2) / len(q))) or 1.0


def _predicted_variance(rows: Rows) -> FloatArray:
    """Variance of the gradient if every sample's pose scatters alike and rows share samples."""
    line = rows.line
    if line.view.block.samples.shape[1] == 1:
        return np.asarray(rows.jacobian.T @ rows.jacobian)
    poses = line.by_pose / line.sigma[:, None, None]
    per_sample = len(rows.jacobian) / float(np.sum(poses**2))
    believed = line.pattern.by_velocity(poses * rows.belief[:, None, None])
    score = believed.T @ rows.jacobian
    return np.asarray(score.T @ score) * per_sample


def _robust_jacobian(rows: Rows) -> FloatArray:
    """Rows whose square sums to the curvature of Huber's loss."""
    line = rows.line
    n, size = line.residual.shape
    jacobian = rows.jacobian.reshape(n, size, -1) * np.sqrt(line.weight)[:, None, None]
    outer = np.flatnonzero(line.weight < 1.0)
    if len(outer):
        unit = line.residual[outer] / np.linalg.norm(line.residual[outer], axis=1, keepdims=True)
        along = np.einsum("nd,ndp->np", unit, jacobian[outer])
        jacobian[outer] -= unit[:, :, None] * along[:, None, :]
    return jacobian.reshape(n * size, -1)


def _clustered_variance(rows: Sequence[Rows], touch: IntArray, bread: FloatArray) -> FloatArray:
    """A⁻¹ (Σ of products of row gradients that share a touch) A⁻¹ for one term's blocks.

    Cluster-robust variance for dyads (Aronow, Samii, Assenova 2015, doi:10.1093/pan/mpv018), which
    is White's for rows of one sample each. Residuals are freed of their leverage touch by touch
    (CR2; Bell and McCaffrey 2002): a fit follows the few touches it has.

    Args:
        rows: whitened rows.
        touch: (samples,) cluster of each sample; repeats of a touch are one cluster, because they
            share what the model gets wrong about their posture.
        bread: (n, n) inverse curvature A⁻¹.
    """
    unit = np.sqrt(np.maximum(np.diag(bread), 0.0))
    outer = np.outer(unit, unit)
    values, vectors = np.linalg.eigh(np.divide(bread, outer, where=outer > 0, out=0 * outer))
    kept = values > ROUNDING * max(float(values[-1]), 1e-300)
    root = unit[:, None] * vectors[:, kept] * np.sqrt(values[kept])
    count, width = int(touch.max()) + 1, root.shape[1]
    by_touch, twice = np.zeros((count, width)), np.zeros((width, width))
    for r in rows:
        line = r.line
        n, size = line.residual.shape
        belief = np.sqrt(line.weight)
        gain = (r.jacobian @ root).reshape(n, size, width) * belief[:, None, None]
        score = np.einsum("ndp,nd,n->np", gain, line.residual, belief / line.sigma)
        members = touch[line.view.block.samples]
        mine = np.zeros_like(by_touch)
        for k in range(members.shape[1]):
            np.add.at(mine, members[:, k], score)
        by_touch += _freed(mine, gain, members) if count <= MANY_TOUCHES else mine
        twice += _between_pairs(score, gain, members)
    spread = root @ _positive(by_touch.T @ by_touch - twice) @ root.T
    return np.asarray(spread)


def _freed(by_touch: FloatArray, gain: FloatArray, members: IntArray) -> FloatArray:
    """Scores per touch multiplied by (I - YᵀY)^(-½), Y the touch's rows in units of the fit."""
    freed = by_touch.copy()
    for k in np.unique(members):
        y = gain[(members == k).any(axis=1)].reshape(-1, gain.shape[2])
        values, vectors = np.linalg.eigh(y.T @ y)
        scale = 1.0 / np.sqrt(np.clip(1.0 - values, 0.1, 1.0))
        freed[k] = vectors @ (scale * (vectors.T @ by_touch[k]))
    return freed


def _between_pairs(score: FloatArray, gain: FloatArray, members: IntArray) -> FloatArray:
    """What rows between the same two touches contribute: they were counted once for each."""
    if members.shape[1] == 1:
        return np.zeros((score.shape[1],) * 2)
    _, pair = np.unique(np.sort(members, axis=1), axis=0, return_inverse=True)
    pair = pair.reshape(-1)
    leverage = np.bincount(pair, np.einsum("ndp,ndp->n", gain, gain))
    by_pair = np.zeros((len(leverage), score.shape[1]))
    np.add.at(by_pair, pair, score)
    freed = by_pair / np.sqrt(1.0 - np.clip(leverage, 0.0, 0.9))[:, None]
    return np.asarray((members.shape[1] - 1) * freed.T @ freed)


def _positive(matrix: FloatArray) -> FloatArray:
    """Nearest positive semidefinite matrix: a difference of two need not be one."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def _pseudo_inverse(matrix: FloatArray) -> FloatArray:
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    outer = np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(matrix / outer, 1e-12, True) / outer)
