"""Information of the data on the parameters at one point, and the part that noise causes.

Three matrices over all parameters, from the whitened Jacobian J:

    A  = Σ Jᵀ ψ' J            curvature of the robust cost (the bread of the sandwich)
    M  = Var(Σ Jᵀ ψ)          variance of its gradient (the meat), by sample rather than by row
    F  = E[ΔJᵀ ΔJ]            information that noise in the readings alone would make up

Rows that share samples are not independent: the (JᵀJ)⁻¹ of pairwise distances understates standard
deviations by two to four times. A direction v with vᵀAv not well above vᵀFv is excited by nothing
but noise (errors in variables): its estimate would be precise and wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.solver.evaluation import AT_ONCE, Linearised
from suta_calib.solver.losses import radial
from suta_calib.solver.problem import Part, Problem
from suta_calib.terms.block import summed
from suta_calib.terms.poses import ArmPoses, MeasuredPoses, PoseSource
from suta_calib.units import Unit


@dataclass(frozen=True, eq=False)
class Information(Displayable):
    """The matrices of this module at one point, (n, n) over all parameters, priors excluded."""

    curvature: FloatArray
    variance: FloatArray
    noise_induced: FloatArray


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
    rows, evaluation = [], problem.evaluation
    width = evaluation.arm_count + evaluation.own_count
    for line in problem.linearise(x, sigmas):
        n, size = line.residual.shape
        jacobian, filled = np.empty((n, size, width)), 0
        for part_rows, part in evaluation.parts(line):
            filled = part.shape[2]
            np.divide(part, line.sigma[part_rows, None, None], jacobian[part_rows, :, :filled])
        jacobian[:, :, filled:] = 0.0
        rows.append(Rows(line, jacobian.reshape(n * size, width), np.ones(n)))
    return rows


def kept_rows(problem: Problem, x: FloatArray, sigmas: Sequence[float]) -> list[Rows]:
    """`whitened_rows` that stay as they are when the problem is evaluated elsewhere."""

    def kept(line: Linearised) -> Linearised:
        measured = None if line.measured is None else line.measured.copy()
        return replace(
            line, residual=line.residual.copy(), by_pose=line.by_pose.copy(), measured=measured
        )

    return [replace(r, line=kept(r.line)) for r in whitened_rows(problem, x, sigmas)]


def block_information(problem: Problem, x: FloatArray, sigmas: Sequence[float]) -> list[FloatArray]:
    """JᵀJ (n, n) of every block's whitened rows: without room for the rows of all."""
    return [_summed(problem, line) for line in problem.linearise(x, sigmas)]


def curvature_at(
    problem: Problem, x: FloatArray, sigmas: Sequence[float], *, robust: bool
) -> FloatArray:
    """Curvature (n, n) of the cost at x, priors excluded, without room for the rows."""
    lines = problem.linearise(x, sigmas)
    return sum((_summed(problem, line, robust=robust) for line in lines), _nothing(x))


def _summed(problem: Problem, line: Linearised, *, robust: bool = False) -> FloatArray:
    """JᵀJ (n, n) of a block's whitened rows; where ``robust``, the curvature of Huber's loss."""
    evaluation = problem.evaluation
    total = np.zeros((evaluation.arm_count + evaluation.own_count,) * 2)
    for part_rows, part in evaluation.parts(line):
        width, jacobian = part.shape[2], part / line.sigma[part_rows, None, None]
        if robust:
            total[:width, :width] += _curvature_of_some(line, part_rows, jacobian)
        else:
            rows = jacobian.reshape(-1, width)
            total[:width, :width] += rows.T @ rows
    return total


def predicted_information(
    problem: Problem, x: FloatArray, sigmas: Sequence[float], *, robust: bool = False
) -> Information:
    """Information of samples that all have the same noise.

    Args:
        problem: terms and parameters.
        x: where.
        sigmas: noise level of each block.
        robust: believe rows as Huber weighs them at x. Wrong before the fit, where a wrong geometry
            makes residuals large; needed after it, where gross errors would make up information
            (an outlier tells the scale of an arm that touched one point, and tells it wrongly).
    """
    lines = problem.linearise(x, sigmas)
    beliefs = [np.sqrt(line.weight) if robust else np.ones(len(line.weight)) for line in lines]
    rests = _numbered(problem, [term.poses.rests for term in problem.terms])
    alone = [_each_for_itself(line, rests) for line in lines]
    # Of very many rows that each stand for themselves only sums are needed, which want no room.
    if problem.part is not None and all(alone):
        curvature = sum((_summed(problem, line, robust=robust) for line in lines), _nothing(x))
        induced = _noise_induced_information(problem, x, sigmas, lines, beliefs)
        return Information(curvature, curvature, induced)
    whitened = whitened_rows(problem, x, sigmas)
    rows = [replace(r, belief=belief) for r, belief in zip(whitened, beliefs, strict=True)]
    curvature, variance = _nothing(x), _nothing(x)
    for r, for_itself in zip(rows, alone, strict=True):
        of_block = robust_curvature(r) if robust else r.jacobian.T @ r.jacobian
        curvature += of_block
        if for_itself:
            variance += of_block
        else:
            believed = replace(r, jacobian=robust_jacobian(r)) if robust else r
            variance += _predicted_variance(believed, rests)
    induced = _noise_induced_information(problem, x, sigmas, lines, beliefs, rows)
    return Information(curvature, variance, induced)


def _nothing(x: FloatArray) -> FloatArray:
    return np.zeros((len(x), len(x)))


def noise_levels(problem: Problem, x: FloatArray, sigmas: Sequence[float]) -> list[float]:
    """Standard deviation of one component of each block, as the residuals at x show it.

    Huber's proposal: the spread of residuals winsorised at their threshold, so that outliers do
    not count as noise; at least a millionth, because rounding is not information.
    """
    levels, lines = [], problem.linearise(x, sigmas)
    for line, assumed, postures in zip(lines, sigmas, problem.postures, strict=True):
        block = line.view.block
        size = np.linalg.norm(line.residual, axis=1)
        inside = (
            line.residual * np.minimum(1.0, block.noise.huber / np.maximum(size, 1e-300))[:, None]
        )
        effect = _design_effect(inside, *postures)
        used = effect * (problem.arm_count + problem.evaluation.own_count)
        freedom = max(inside.size - used, inside.size / 2)
        level = float(np.sqrt(np.sum(inside**2) / freedom))
        levels.append(max(level, 1e-6) if np.isfinite(level) else assumed)
    return levels


def _numbered(problem: Problem, groups: Sequence[IntArray]) -> IntArray:
    """(samples,) groups of the samples of every term, none of one term's that of another."""
    first = problem.evaluation.table.first
    return np.concatenate([k + group for k, group in zip(first, groups, strict=False)])


def _design_effect(residual: FloatArray, group: IntArray, count: IntArray) -> float:
    """How many rows say what one says: 1 + (m - 1) ρ with m rows at a posture (Kish 1965).

    The intraclass correlation ρ is one where rows of a posture, ``count`` in each ``group`` (n,),
    have the same residual (n, d), such as a touch that is read again, and zero where each has an
    error of its own.
    """
    n, groups = len(residual), len(count)
    total = float(np.sum(residual**2))
    if groups == n or total == 0.0:
        return 1.0
    sums = summed(residual, group, groups)
    within = (total - float(np.sum(sums**2 / count[:, None]))) / (n - groups)
    shared = min(max(1.0 - within / (total / n), 0.0), 1.0)
    return 1.0 + (float(np.sum(count**2)) / n - 1.0) * shared


def _noise_induced_information(
    problem: Problem,
    x: FloatArray,
    sigmas: Sequence[float],
    lines: Sequence[Linearised],
    beliefs: Sequence[FloatArray],
    rows: Sequence[Rows] = (),
) -> FloatArray:
    """F: how much the Jacobian changes when the readings change by their own noise.

    What is known of that noise is how far it moves the tip: every joint, and the turn of every
    measured pose, gets its share. Information that only the size of the residuals makes counts as
    well. Of very many samples a part tells it; of others ``rows`` are those of all.
    """
    total = _nothing(x)
    for line in lines:
        total += _by_residual_alone(problem, line)
    part = problem.part or Part(problem, (None,) * len(lines))
    shifts = _jitter(problem, [term.poses for term in part.problem.terms], lines)
    if not any(np.any(shift) for shift in shifts):
        return total
    evaluation = part.problem.evaluation
    before = rows if problem.part is None else whitened_rows(part.problem, x, sigmas)
    with evaluation.table.shifted(shifts):
        moved = part.problem.linearise(x, sigmas)
        for old, line, believed, taken in zip(before, moved, beliefs, part.rows, strict=True):
            was = old.jacobian.reshape(*line.residual.shape, len(x))
            belief = believed if taken is None else believed[taken]
            # Some at a time: the change of all is as large as all that it is made from.
            for part_rows, now in evaluation.parts(line):
                width = now.shape[2]
                change = now / line.sigma[part_rows, None, None] - was[part_rows, :, :width]
                change *= belief[part_rows, None, None]
                change = change.reshape(-1, width)
                total[:width, :width] += len(believed) / len(belief) * (change.T @ change)
    return total


def _by_residual_alone(problem: Problem, line: Linearised) -> FloatArray:
    """Information about turns that a residual in a turning frame makes up by being large.

    Rᵀ(c - p) turns with the tool, so its derivative by the tool's orientation is as long as the
    residual itself, and vanishes with it: no such residual can tell where the tool points.
    """
    nothing = np.zeros((problem.arm_count + problem.evaluation.own_count,) * 2)
    turns_at_all = False
    for first in range(0, len(line.residual), AT_ONCE):
        part_rows = slice(first, first + AT_ONCE)
        # In units of σ both, which is left out.
        turning = line.by_pose[part_rows, :, line.pattern.angular]
        by_turn = np.sqrt(np.einsum("ndc,ndc->n", turning, turning))
        size = np.linalg.norm(line.residual[part_rows], axis=1)
        if np.any(by_turn > 1.5 * size + 1e-9 * line.sigma[part_rows]):
            return nothing
        turns_at_all |= bool(by_turn.any())
    if not turns_at_all:
        return nothing
    turns = line.by_pose * line.pattern.angular / line.sigma[:, None, None]
    arm, _ = problem.evaluation.columns(line, turns, line.by_own)
    columns = np.hstack([arm, np.zeros((len(arm), problem.evaluation.own_count))])
    # Weight that lets a direction count as noise-induced once half of its information is made by
    # residuals: noise may make up a hundredth (`identifiability.NOISE_INDUCED_SHARE`).
    return np.asarray(columns.T @ columns) * 0.02


def _jitter(
    problem: Problem, sources: Sequence[PoseSource], lines: Sequence[Linearised]
) -> list[FloatArray]:
    """Noise of the readings of each term's source that moves the tip as the residuals say."""
    random = np.random.default_rng(0)
    shifts = list[FloatArray]()
    for term, source in zip(problem.terms, sources, strict=True):
        mine = [line for line in lines if any(line.view.block is b for b in term.blocks)]
        if isinstance(source, ArmPoses):
            shape, level = source.samples.q.shape, _levels(mine).get("m")
            if level is not None:
                share = level * np.sqrt(3.0) / source.reach
            else:  # Nothing tells how far the tip moves, but how far it turns.
                share = _pose_noise(mine)[5] * np.sqrt(3.0 / max(shape[1], 1))
            shifts.append(share * random.standard_normal(shape))
        else:
            judged = not isinstance(source, MeasuredPoses) or source.judged
            noise = _pose_noise(mine) if judged else np.zeros(6)
            shifts.append(noise * random.standard_normal((len(source), 6)))
    return shifts


def _pose_noise(lines: Sequence[Linearised]) -> FloatArray:
    """Standard deviations (6,) of measured poses, m and rad, that explain a term's residuals.

    Where no residual is an angle, the turns are taken to be what moves the tip by its lever, as far
    as an instrument may be so bad.
    """
    level = _levels(lines)
    turn = level.get("rad", 0.0)
    for line in lines:
        angular = line.pattern.angular
        squares = np.einsum("ndc,ndc->c", line.by_pose, line.by_pose)
        moved, turned = (np.sqrt(squares[c].sum()) for c in (~angular, angular))
        if "rad" not in level and turned > 0:
            if "m" in level:
                turn = level["m"] * float(moved / turned) * np.sqrt(2.0 / 3.0)
            else:  # Plain numbers: as much as explains them, shared by the three axes.
                turn = float(np.median(line.sigma)) * np.sqrt(line.residual.size) / float(turned)
            # No instrument of use has more.
            turn = min(turn, float(np.radians(1.0)))
    return np.repeat([level.get("m", 0.0), turn], 3)


def _levels(lines: Sequence[Linearised]) -> dict[Unit, float]:
    """Noise of one component of a term's residuals by unit."""
    return {line.view.block.unit: float(np.median(line.sigma)) for line in lines}


def _each_for_itself(line: Linearised, rests: IntArray) -> bool:
    """Whether every row looks at one sample, and no two at one rest."""
    samples = line.view.block.samples + line.view.first_sample
    return samples.shape[1] == 1 and int(np.bincount(rests[samples[:, 0]]).max(initial=0)) <= 1


def _predicted_variance(rows: Rows, rests: IntArray) -> FloatArray:
    """Variance of the gradient if the pose at every rest scatters alike and rows share rests."""
    line = rows.line
    samples, width = line.view.block.samples + line.view.first_sample, rows.jacobian.shape[1]
    scale = 1.0
    if samples.shape[1] == 1:
        score, at = rows.jacobian, rests[samples[:, 0]]
    else:
        poses = line.by_pose / line.sigma[:, None, None]
        scale = len(rows.jacobian) / float(np.sum(poses**2))
        believed = poses * rows.belief[:, None, None]
        score, at = line.pattern.summed(believed, rows.jacobian), rests
    if np.bincount(at).max(initial=0) > 1:
        score = summed(score.reshape(len(at), -1), at, len(rests)).reshape(-1, width)
    return np.asarray(score.T @ score) * scale


def robust_curvature(rows: Rows) -> FloatArray:
    """Curvature of Huber's loss: the square of `robust_jacobian`."""
    line, width = rows.line, rows.jacobian.shape[1]
    n, size = line.residual.shape
    jacobian, total = rows.jacobian.reshape(n, size, width), np.zeros((width, width))
    for first in range(0, n, AT_ONCE):
        part_rows = slice(first, first + AT_ONCE)
        total += _curvature_of_some(line, part_rows, jacobian[part_rows])
    return total


def _curvature_of_some(line: Linearised, part_rows: slice, jacobian: FloatArray) -> FloatArray:
    """`robust_curvature` of some rows of a block, whitened (k, d, w)."""
    weight, residual = line.weight[part_rows], line.residual[part_rows]
    jacobian = jacobian * np.sqrt(weight)[:, None, None]
    rows = jacobian.reshape(-1, jacobian.shape[2])
    total = rows.T @ rows
    if (outer := weight < 1.0).any():
        _, along = radial(residual[outer], jacobian[outer])
        total -= along.T @ along
    return np.asarray(total)


def robust_jacobian(rows: Rows) -> FloatArray:
    """Rows whose square sums to the curvature of Huber's loss."""
    line = rows.line
    n, size = line.residual.shape
    jacobian = rows.jacobian.reshape(n, size, -1) * np.sqrt(line.weight)[:, None, None]
    outer = np.flatnonzero(line.weight < 1.0)
    if len(outer):
        unit, along = radial(line.residual[outer], jacobian[outer])
        jacobian[outer] -= unit[:, :, None] * along[:, None, :]
    return jacobian.reshape(n * size, -1)


def robust_product(rows: Rows, columns: FloatArray) -> FloatArray:
    """`robust_jacobian` transposed times that of columns (n·d, k) in its place: (w, k)."""
    line, (n, size) = rows.line, rows.line.residual.shape
    matrices = [matrix.reshape(n, size, matrix.shape[1]) for matrix in (rows.jacobian, columns)]
    total = np.zeros((rows.jacobian.shape[1], columns.shape[1]))
    for first in range(0, n, AT_ONCE):
        part_rows = slice(first, first + AT_ONCE)
        weight, residual = line.weight[part_rows], line.residual[part_rows]
        left, right = (m[part_rows] * np.sqrt(weight)[:, None, None] for m in matrices)
        total += left.reshape(-1, left.shape[2]).T @ right.reshape(-1, right.shape[2])
        if (outer := weight < 1.0).any():
            along = [radial(residual[outer], m[outer])[1] for m in (left, right)]
            total -= along[0].T @ along[1]
    return total


def scaled_inverse(matrix: FloatArray, rounding: float = 1e-12) -> FloatArray:
    """Pseudo-inverse of a positive semidefinite matrix whose diagonal spans many magnitudes.

    Args:
        matrix: (n, n).
        rounding: eigenvalues, in units of the diagonal and of the largest, that count as zero.
    """
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    outer = np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(matrix / outer, rounding, True) / outer)
