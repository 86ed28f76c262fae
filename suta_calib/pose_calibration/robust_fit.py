"""The robust solve that pivot, hand-eye and registration share.

From the rows of a consensus: solve with Huber's loss at the noise found so far, judge every row
against the solution, solve again without the outliers, until nothing changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
from scipy.special import chdtr, chdtrc, fdtrc

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.pose_calibration.consensus import DIMENSION, FALSE_ALARM, Consensus, outlier_limit
from suta_calib.pose_calibration.correlation import common_covariance, embedded
from suta_calib.pose_calibration.stated_noise import Agreement
from suta_calib.solver.compiled_residual import term_residuals
from suta_calib.solver.covariance import observed_parts, predicted_covariance
from suta_calib.solver.information import (
    Information,
    Rows,
    block_information,
    scaled_inverse,
    whitened_rows,
)
from suta_calib.solver.losses import huber_threshold
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import judged, solve, solve_again, solve_unjudged
from suta_calib.terms.block import Noise
from suta_calib.terms.poses import MeasuredPoses
from suta_calib.terms.term import Term
from suta_calib.trust.evidence import Evidence, log_ways
from suta_calib.trust.examination import Examination, MeasuredRows
from suta_calib.trust.serial_correlation import blocks, correlation_length
from suta_calib.trust.uncertainty_budget import AS_STATED, KnownScatter

# Rows from which on each may speak for its own scatter.
MANY_ROWS: Final = 30
# Rows from which on neighbours in a series tell what they have in common well enough by themselves.
MOST_ROWS: Final = 400
THRESHOLD: Final = huber_threshold(DIMENSION)
# Residual, in units of the problem's extent or rad, that is rounding: exact data have no other.
ROUNDING: Final = 1e-9

# A term over some of the rows, with the noise of each of its blocks.
Make = Callable[[IntArray, Sequence[Noise]], Term]


@dataclass(frozen=True, eq=False)
class RobustFit:
    """A solution, with the residuals of all rows and which of them are inliers.

    Attributes:
        solution: over the inliers.
        residuals: of all rows by block, each (n, 3), m or rad.
        inliers: (n,) rows that were fitted.
        suspects: (n,) those of them that stand out without being proven wrong.
        sigmas: scatter of one component of each block.
        spread: computes the covariance, which of most fits nobody asks for; of the residuals less
            what is known to be in them, by block, each (inliers, 3), if given.
        agreement: of the first block's residuals with the scatter that was stated of it; None
            where nothing was.
        scatter: how well the scatter behind the covariance is known.
    """

    solution: Solution
    residuals: tuple[FloatArray, ...]
    inliers: BoolArray
    suspects: BoolArray
    sigmas: tuple[float, ...]
    spread: Callable[[Sequence[FloatArray]], FloatArray]
    agreement: Agreement | None = None
    scatter: KnownScatter = AS_STATED

    @cached_property
    def covariance(self) -> FloatArray:
        """Of the solution's parameters, in its order.

        From the residuals row by row (block by block where neighbours are alike) where these are
        many, else from their common scatter, which is the stated one unless the residuals
        contradict it.
        """
        return self.spread(())

    def examined(
        self,
        length: float,
        rows: str,
        called: Mapping[str, str],
        numbers: IntArray | None = None,
        seen_by: Mapping[str, IntArray] | None = None,
        alike: float = 1.0,
    ) -> Examination:
        """The linearised result, for tests of the hypotheses about wrong data.

        Args:
            length: m per unit of the fit's lengths.
            rows: what they are, in the plural.
            called: words for what an unknown belongs to, by its owner.
            numbers: (n,) of the rows in their file; as they are by default.
            seen_by: rows that look at an unknown that not all of them look at.
            alike: how many rows at least are worth one, because they share errors.
        """
        every = np.arange(len(self.inliers), dtype=np.intp) if numbers is None else numbers
        measured = MeasuredRows(self.inliers, every, rows, called, seen_by or {}, alike)
        # Rows of a stream that share errors count less.
        white = [r[self.inliers] / s for r, s in zip(self.residuals, self.sigmas, strict=True)]
        repeated = max(correlation_length(np.hstack(white)), alike)
        return Examination.of_poses(self.solution, self.sigmas, repeated, length, measured)

    def followed(self, evidence: Evidence) -> FloatArray:
        """(p, p) covariance of the solution's parameters for having followed an effect."""
        covariance, free = np.zeros((len(self.solution.x),) * 2), self.solution.free
        more = 1.0 + 1.0 / max(evidence.significance, 1.0) ** 2
        covariance[np.ix_(free, free)] = more * np.outer(evidence.moves, evidence.moves)
        return covariance


def parts_of(poses: MeasuredPoses) -> Callable[[IntArray], MeasuredPoses]:
    """What takes rows of poses, each once and in order.

    Round after round it is asked for the same rows: they are the same poses then, of which it need
    not be found again which of them hardly differ.
    """

    @lru_cache(maxsize=4)
    def taken(rows: bytes) -> MeasuredPoses:
        return poses.take(np.frombuffer(rows, dtype=np.intp))

    return lambda rows: poses if len(rows) == len(poses) else taken(rows.tobytes())


def robust_fit(
    make: Make,
    start: Consensus,
    floors: Sequence[float] | None = None,
    *,
    robust: bool = True,
    revise: Callable[[Mapping[str, float], BoolArray], None] | None = None,
    stated: float | None = None,
) -> RobustFit:
    """Solve, find outliers, and solve again; rows are outliers only if the others prove it.

    Args:
        make: the term over given rows.
        start: first guess at the inliers and at the noise.
        floors: noise of each block that is assumed at least when blocks are weighed, m or rad.
        robust: False for least squares over the rows of the start, all of them believed.
        revise: called with the values found and the inliers after every solve; may change what
            `make` makes.
        stated: scatter of one component of the only block that instruments state, m.
    """

    def plainly(rows: BoolArray) -> RobustFit:
        believed = Consensus(rows, np.array(fit.sigmas))
        return _settled(make, believed, floors, False, None, stated, fit.solution)

    fit = _settled(make, start, floors, robust, revise, stated)
    count, suspects = len(fit.inliers), np.flatnonzero(~fit.inliers)
    if not robust or not len(suspects) or count > MOST_ROWS:
        return fit
    everyone = np.ones(count, dtype=np.bool_)
    needed = len(fit.solution.free) / (DIMENSION * len(fit.sigmas))
    plain = plainly(everyone)
    if not plain.solution.converged:
        return fit  # Rows so far off that nothing fits beside them are proven wrong.
    total, distance = _misfit(plain, fit.sigmas).sum(), _misfit(fit, fit.sigmas)
    suspects = suspects[np.argsort(-distance[suspects])]
    remaining, least = fit, 1.0
    # All of them, then fewer: of many not one by one, each costs a fit.
    numbers = np.unique(np.geomspace(1, len(suspects), 12).round().astype(np.intp))[::-1]
    for dropped, fewer in zip(numbers.tolist(), [*numbers[1:].tolist(), 0], strict=True):
        # Rows that err alike where they are alike are not independent, nor are their components: a
        # row is one cluster.
        freedom = count - dropped - needed
        rest = max(float(_misfit(remaining, fit.sigmas)[remaining.inliers].sum()), ROUNDING**2)
        gain = (total / rest - 1.0) * freedom / dropped
        # Any choice of as many rows might have been the suspicious one.
        alone = fdtrc(dropped, freedom, gain) if freedom > 0 else 1.0
        chance = min(alone * math.exp(min(log_ways(count, dropped), 700.0)), 1.0)
        # Where many are wrong so many choices are possible that no chance is small. But a tenth of
        # many rows, on average at twice the limit of an outlier, no tail of a distribution makes:
        # something else was measured there. A hand, whose turns are fitted too, may err alike in
        # many like poses.
        if len(fit.sigmas) == 1 and count >= MANY_ROWS and dropped >= 0.1 * count:
            far = float(distance[suspects[:dropped]].mean())
            chance *= far < 2.0 * outlier_limit(count, 1)
        least = min(least, chance)
        if chance < FALSE_ALARM:
            break
        believed = everyone.copy()
        believed[suspects[:fewer]] = False
        again = plainly(believed)
        if not again.solution.converged:
            break
        remaining = again
    # Chance of what rows that are kept stand out by, above which it is not worth a word.
    remarkable = least < 0.2 and remaining is not fit
    regained = remaining.inliers & ~fit.inliers
    return replace(remaining, suspects=regained) if remarkable else remaining


def _misfit(fit: RobustFit, sigmas: Sequence[float]) -> FloatArray:
    """(n,) squared residuals of rows in units of what each block scatters."""
    parts = [np.sum(r**2, axis=1) / s**2 for r, s in zip(fit.residuals, sigmas, strict=True)]
    return np.asarray(sum(parts))


def _settled(
    make: Make,
    start: Consensus,
    floors: Sequence[float] | None,
    robust: bool,
    revise: Callable[[Mapping[str, float], BoolArray], None] | None,
    stated: float | None,
    last: Solution | None = None,
    again: Callable[[Problem, Solution, SolverOptions], Solution] = solve_unjudged,
) -> RobustFit:
    """`robust_fit` where every row that stands out is an outlier; from a solution of other rows.

    What the rows tell is judged where they have settled. Should that be another verdict than what
    went on from round to round, the rounds go on with ``again`` asking every time.
    """
    max_rounds = 12
    # Noise in the same units below which the solver's arithmetic would be what is fitted.
    finest = 1e-6
    everything = np.arange(len(start.inliers))
    inliers, sigmas = start.inliers, np.maximum(start.sigmas, ROUNDING)
    least = np.full(len(sigmas), finest) if floors is None else np.maximum(floors, finest)
    for round_ in range(max_rounds):
        assumed = [float(s) for s in np.maximum(sigmas, least)]
        noises = [Noise(s, THRESHOLD * s) if robust else Noise(s) for s in assumed]
        # The levels that weigh the blocks are learned here, round by round.
        problem = Problem([make(np.flatnonzero(inliers), noises)])
        # Least squares that does not come to a minimum beside the robust one in so many iterations
        # has none that tells.
        most = 50 if last is not None and not robust else 200
        options = SolverOptions(weights=None, confirm=False, max_iterations=most)
        solution = (
            solve(problem, options, spread=False) if last is None else again(problem, last, options)
        )
        unjudged, last = last is not None and again is solve_unjudged, solution
        if revise is not None:
            revise(solution.values, inliers)
        if inliers.all() and revise is None:
            lines = problem.linearise(solution.x, solution.sigmas)
            residuals = tuple(line.residual.copy() for line in lines)
        else:
            residuals = term_residuals(make(everything, noises), solution.values)
        # Residuals are smaller than the noise because the unknowns followed it, block by block.
        numbers = DIMENSION * int(inliers.sum())
        left = np.maximum(numbers - _effective_parameters(solution), 1.0)
        scattered = np.array([scatter(r[inliers], robust=robust) for r in residuals])
        levels = np.maximum(np.sqrt(numbers / left) * scattered, ROUNDING)
        agreeing = inliers
        if robust:
            squared = np.array([np.sum(r**2, axis=1) for r in residuals])
            limit = outlier_limit(len(inliers), len(residuals))
            agreeing = np.sum(squared / levels[:, None] ** 2, axis=0) <= limit
        settled = np.array_equal(agreeing, inliers) and np.allclose(levels, sigmas, 0.01, 0)
        # What plain least squares does not come to in one search it does not come to in twelve.
        settled |= not robust and not solution.converged
        if settled or agreeing.sum() < DIMENSION or round_ + 1 == max_rounds:
            break
        inliers, sigmas = agreeing, levels
    if unjudged and (robust or solution.converged):
        believed, weighed = Consensus(inliers, sigmas), judged(solution)
        if weighed is None:
            return _settled(
                make, believed, floors, robust, revise, stated, solution, again=solve_again
            )
        solution = weighed
    # Rows below which the scatter they show is too small by chance: then no less than is assumed.
    few = int(inliers.sum()) < 12
    truly = np.maximum(levels, least) if few else levels
    rows = np.flatnonzero(inliers)
    clusters = int(solution.problem.terms[0].poses.postures.max()) + 1
    # Each block's scatter is learnt from its own part of what the unknowns leave.
    freedom = DIMENSION * clusters - len(solution.free) / len(residuals)
    # The scatter of few is itself uncertain: errors in units of it have Student's variance.
    uncertain = freedom / (freedom - 2.0) if clusters < MANY_ROWS and freedom > 2.0 else 1.0
    agreement = None
    if stated is not None:
        misfit = float(np.sum(residuals[0][inliers] ** 2)) / stated**2
        agreement = Agreement.of(misfit, float(left[0]))
        # What rows have in common leaves no residual: no less than what is stated is believed.
        if not agreement.too_large:
            truly, uncertain, freedom = np.array([stated]), 1.0, math.inf
    # Weights that differ much leave a few rows to speak for themselves: too few for a sandwich.
    many = stated is None and clusters >= MANY_ROWS

    def spread(explained: Sequence[FloatArray]) -> FloatArray:
        inlying = [r[rows] for r in residuals]
        if explained:
            inlying = [r - part for r, part in zip(inlying, explained, strict=True)]
        return uncertain * _covariance(solution, inlying, truly, rows, many=many)

    none = np.zeros_like(inliers)
    scatters = tuple(float(s) for s in levels)
    known = KnownScatter(freedom, uncertain > 1.0)
    return RobustFit(solution, residuals, inliers, none, scatters, spread, agreement, known)


def _effective_parameters(solution: Solution) -> FloatArray:
    """(blocks,) how many unknowns each block's residuals determine: traces of its hat matrix."""
    free = solution.free
    information = block_information(solution.problem, solution.x, solution.sigmas)
    parts = [part[np.ix_(free, free)] for part in information]
    bread = scaled_inverse(sum(parts, np.zeros((len(free), len(free)))))
    return np.array([float(np.sum(bread * part)) for part in parts])


def _covariance(
    solution: Solution,
    residuals: Sequence[FloatArray],
    levels: FloatArray,
    order: IntArray,
    *,
    many: bool,
) -> FloatArray:
    """The sandwich needs ``many`` rows: the scatter of few says nothing of most directions.

    Of few it is A⁻¹ M A⁻¹, with the weights of the fit in A and in M what the blocks truly scatter.
    What rows have in common that are alike comes on top.
    """
    problem, free, poses = solution.problem, solution.free, solution.problem.terms[0].poses
    white = np.hstack([r / level for r, level in zip(residuals, levels, strict=True)])
    postures, by_itself = poses.postures, np.arange(len(white), dtype=np.intp)
    count, groups = len(white), int(postures.max()) + 1
    # Poses that are exact, such as those of certified points, have no errors to share.
    exact = isinstance(poses, MeasuredPoses) and poses.exact
    if many and (exact or groups > MOST_ROWS):
        clusters = blocks(white) if groups == count else postures
        if np.array_equal(clusters, by_itself):
            return solution.covariance
        return observed_parts(solution.spread.fit, [clusters]).total
    rows = whitened_rows(problem, solution.x, solution.sigmas)
    parts = [r.jacobian.T @ r.jacobian for r in rows]
    weights = levels / np.array(solution.sigmas)
    nothing = np.zeros_like(parts[0])
    curvature = sum(parts, nothing)
    if many:
        independent = (
            solution.covariance.copy()
            if groups == count
            else observed_parts(solution.spread.fit, [by_itself]).total
        )
    else:
        truly = sum((w**2 * part for w, part in zip(weights, parts, strict=True)), nothing)
        information = Information(curvature, truly, nothing)
        independent = predicted_covariance(problem, information, free)
    if exact:
        return independent
    # Neighbours may share errors of the hand's poses, and of the seen poses.
    spaces, observed = [embedded(*poses.at(solution.values))], poses.samples
    if observed.position is not None and observed.rotation is not None:
        spaces.append(embedded(observed.rotation, observed.position))
    at = np.ix_(free, free)
    parts = [
        r.jacobian[:, free].reshape(count, DIMENSION, -1) / w
        for r, w in zip(rows, weights, strict=True)
    ]
    jacobian = np.concatenate(parts, axis=1)
    bread, weight = scaled_inverse(curvature[at]), np.repeat(weights**2, DIMENSION)
    independent[at] += common_covariance(
        *(jacobian, white, weight, bread, spaces, order, postures),
        *([DIMENSION] * len(rows), [_to_base(row) for row in rows]),
    )
    return independent


def _to_base(rows: Rows) -> FloatArray:
    """Rotations (n, 3, 3) of a block's residuals into the frame in which poses are given.

    A residual's derivative by the velocity of its pose says how it is turned: displacements by
    displacements, turns by turns.
    """
    line = rows.line
    by_pose = line.by_pose[..., line.pattern.angular == (line.view.block.unit == "rad")]
    length = np.linalg.norm(by_pose, axis=(1, 2), keepdims=True) / np.sqrt(DIMENSION)
    return np.asarray(np.swapaxes(by_pose, 1, 2) / np.maximum(length, 1e-300))


def scatter(residual: FloatArray, *, robust: bool) -> float:
    """Standard deviation of one component; winsorised as Huber's proposal 2 does, but unbiased."""
    squared = np.einsum("nd,nd->n", residual, residual)
    level = float(np.sqrt(squared.mean() / DIMENSION))
    if not robust:
        return level
    inside, tail = chdtr(DIMENSION + 2, THRESHOLD**2), chdtrc(DIMENSION, THRESHOLD**2)
    expected = inside * DIMENSION + THRESHOLD**2 * tail
    for _ in range(20):
        clipped = np.minimum(squared, (THRESHOLD * level) ** 2)
        level = float(np.sqrt(clipped.mean() / expected))
    return level
