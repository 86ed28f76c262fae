"""Eyes that look from one rest of a hand share its errors: what these are, and what is left.

The turn and the place of every residual are ``J x + H ξ + e``: of the unknowns x, of the hand's
error ξ at the rest, which all rows of it share, and of what the eye errs by alone. How large the
parts are (variance components: the hand's displacements, its turns about itself and about its base;
displacements and turns of each eye) is what makes the residuals most probable once the unknowns
have taken their part of them: restricted maximum likelihood (Patterson and Thompson 1971,
doi:10.1093/biomet/58.3.545; the fixed point of Harville 1977, doi:10.2307/2286796). A good eye then
is not spoiled by a bad one.

With these, generalised least squares finds x, and the best prediction of ξ (Henderson 1975,
doi:10.2307/2529430) takes the hand's errors out of its poses. Neighbouring rests may err alike;
that is asked of the residuals as in `correlation`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.geometry.numbers import rotation_from_vector, skew
from suta_calib.pose_calibration.correlation import common_covariance, embedded, kernels
from suta_calib.pose_calibration.robot_noise import PairedHandEye, RobotNoise
from suta_calib.pose_calibration.robust_fit import MANY_ROWS, MOST_ROWS, ROUNDING, RobustFit
from suta_calib.solver.evaluation import Linearised
from suta_calib.solver.information import scaled_inverse, whitened_rows
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve_again
from suta_calib.terms.block import summed
from suta_calib.terms.hand_eye_start import Poses

# Numbers of a residual, and of what a hand errs by: displacements, turns about itself, turns about
# its base.
WAYS: Final = 6
OF_HAND: Final = 9
AXES: Final = 3
# Rows of whose rests variances are asked: they are known to a few hundredths then.
ENOUGH: Final = 600


@dataclass(frozen=True, eq=False)
class SharedHand:
    """Poses that allow for the errors of a hand which several eyes share.

    Attributes:
        solution: of the pairs with the hand's poses less their errors.
        covariance: of its parameters.
        noise: (1 + eyes, 2) scatter of one component of displacements, in units of the problem, and
            of turns, rad: of the hand, then of each eye.
        rows_alike: how many rows are worth one, at worst, because they share the hand's errors.
    """

    solution: Solution
    covariance: FloatArray
    noise: FloatArray
    rows_alike: float


@dataclass(frozen=True, eq=False)
class _Rows:
    """Residuals (n, 6) of pairs, and how unknowns (n, 6, p) and the hand (n, 6, 9) change them.

    ``rest`` and ``eye`` (n,) are numbers from 0.
    """

    residual: FloatArray
    jacobian: FloatArray
    by_hand: FloatArray
    rest: IntArray
    eye: IntArray

    def of_rests(self, chosen: IntArray) -> _Rows:
        """Those of some rests."""
        rows = np.flatnonzero(np.isin(self.rest, chosen))
        return _Rows(
            *(self.residual[rows], self.jacobian[rows], self.by_hand[rows]),
            *(np.unique(self.rest[rows], return_inverse=True)[1], self.eye[rows]),
        )

    def sums(self, rows: FloatArray) -> FloatArray:
        """Sums of rows (n, …) over each rest."""
        count = int(self.rest.max()) + 1
        return summed(rows.reshape(len(rows), -1), self.rest, count).reshape(count, *rows.shape[1:])


@dataclass(frozen=True, eq=False)
class _Variances:
    """Of the hand's displacements, turns and turns about the base (3,), and of eyes (eyes, 2)."""

    hand: FloatArray
    eyes: FloatArray

    def of_rows(self, eye: IntArray) -> FloatArray:
        """(n, 6) what each eye errs by alone."""
        return np.repeat(self.eyes[eye], AXES, axis=1)

    @property
    def of_hand(self) -> FloatArray:
        """(9,) of all components."""
        return np.repeat(self.hand, AXES)


class _Fitted:
    """Generalised least squares of rows with given variances.

    Attributes:
        step: (p,) that minimises.
        weighed: (n, 6, p) V⁻¹J.
        covariance: (p, p) of the unknowns.
        left: (n, 6) V⁻¹ (r + J step).
        of_rests: (rests, 9) predicted errors of the hand, in units of their scatter.
    """

    def __init__(self, rows: _Rows, variances: _Variances) -> None:
        self._rows, self._variances = rows, variances
        of_eye = variances.of_rows(rows.eye)[..., None]
        scaled = rows.by_hand * np.sqrt(variances.of_hand)
        over = scaled / of_eye
        inner = rows.sums(np.swapaxes(scaled, 1, 2) @ over)
        self._inner = np.linalg.inv(np.eye(OF_HAND) + inner)
        both = np.concatenate([rows.jacobian, rows.residual[..., None]], axis=2)
        self._scaled, self._over, self._own = scaled, over, of_eye
        weighed = (
            both / of_eye
            - over @ (self._inner @ rows.sums(np.swapaxes(over, 1, 2) @ both))[rows.rest]
        )
        self.weighed = weighed[..., :-1]
        flat, unknowns = rows.jacobian.reshape(-1, both.shape[2] - 1), both.shape[2] - 1
        self.covariance = scaled_inverse(flat.T @ self.weighed.reshape(-1, unknowns))
        self.step = -self.covariance @ (flat.T @ weighed[..., -1].reshape(-1))
        self.left = weighed[..., -1] + self.weighed @ self.step
        self.of_rests = rows.sums(np.einsum("nac,na->nc", scaled, self.left))

    def likelier(self) -> _Variances:
        """Variances under which the residuals are more probable."""
        rows, now = self._rows, self._variances
        taken = rows.sums(np.swapaxes(self._scaled, 1, 2) @ self.weighed)
        freedom = (1.0 - np.diagonal(self._inner, axis1=1, axis2=2)).sum(axis=0)
        freedom -= np.sum((taken @ self.covariance) * taken, axis=(0, 2))
        power = np.sum(self.of_rests**2, axis=0)
        hand = now.hand * _ratio(power.reshape(AXES, -1).sum(1), freedom.reshape(AXES, -1).sum(1))
        of_eye = self._own[..., 0]
        spread = self._over @ self._inner[rows.rest]
        redundancy = 1.0 - of_eye * np.sum(spread * self._over, axis=2)
        redundancy -= of_eye * np.sum((self.weighed @ self.covariance) * self.weighed, axis=2)
        squares = (of_eye * self.left) ** 2
        count = len(now.eyes)
        by_eye = [
            summed(part.reshape(len(part), 2, AXES).sum(axis=2), rows.eye, count)
            for part in (squares, redundancy)
        ]
        # Few numbers of an eye say nothing of the others.
        # Numbers for which an eye is believed to err as the others do: those of one row.
        believed = 3.0
        enough = by_eye[1].min(axis=1) >= believed
        of_each = _ratio(*by_eye)[enough] if enough.any() else now.eyes
        typical = np.exp(np.mean(np.log(of_each), axis=0))
        return _Variances(hand, (by_eye[0] + believed * typical) / (by_eye[1] + believed))


def _ratio(power: FloatArray, freedom: FloatArray) -> FloatArray:
    """Variances that may become small, but never nothing."""
    return np.asarray(np.maximum(power, 1e-24) / np.maximum(freedom, 1e-9))


def share_hand(
    fit: RobustFit,
    noise: RobotNoise,
    base: FloatArray,
    floors: Sequence[float],
    explained: Sequence[FloatArray] = (),
) -> SharedHand | None:
    """Poses and ± that allow for what eyes share; None where no rest has rows of two eyes.

    Args:
        fit: of the pairs, row by row.
        noise: that made its term.
        base: (3,) where the hand's base is in the frame of its poses.
        floors: noise of places and turns that is assumed at least.
        explained: of each block, (inliers, 3), what of the residuals is known to be in them.
    """
    rows = np.flatnonzero(fit.inliers)
    term = noise.plain(rows)
    rests, eye = np.asarray(term.poses.postures), term.seen_together.eye
    pairs = np.unique(np.column_stack([rests, eye]), axis=0)
    if len(pairs) == len(np.unique(rests)):
        return None
    solution, free = fit.solution, fit.solution.free
    problem = Problem([term])
    x = solution.x.copy()
    explained_part = np.hstack([*explained]) if explained else 0.0

    R, p = term.poses.at(solution.values)
    about = skew(p - base)

    def at(x: FloatArray) -> _Rows:
        lines = whitened_rows(problem, x, [1.0, 1.0])
        moves = np.zeros((len(rows), WAYS, OF_HAND))
        moves[:, :AXES, :AXES] = moves[:, AXES:, AXES : 2 * AXES] = np.eye(AXES)
        moves[:, AXES:, 2 * AXES :] = np.eye(AXES)
        moves[:, :AXES, 2 * AXES :] = -about
        by_hand = np.concatenate([_by_pose(r.line) for r in lines], axis=1) @ moves
        jacobian = np.concatenate(
            [r.jacobian.reshape(len(rows), AXES, -1)[:, :, free] for r in lines], axis=1
        )
        residual = np.hstack([r.line.residual for r in lines]) - explained_part
        return _Rows(residual, jacobian, by_hand, rests, eye)

    true = _most_likely(at(x), fit)
    # The floors are of what hand and eye err by together.
    # Noise, in units of the problem or rad, below which the solver's arithmetic is what is fitted.
    least = np.square(np.maximum(floors, 1e-6)) / 2.0
    assumed = replace(true, eyes=np.maximum(true.eyes, least))
    # Steps that the curvature of the turns leaves to do.
    for _ in range(2):
        x[free] += _Fitted(at(x), assumed).step
    here = at(x)
    fitted = _Fitted(here, assumed)
    off = (fitted.of_rests * np.sqrt(assumed.of_hand))[rests]
    turned = off[:, AXES : 2 * AXES] + off[:, 2 * AXES :]
    moved = off[:, :AXES] + np.cross(off[:, 2 * AXES :], p - base)
    hand = rotation_from_vector(-turned) @ R, p - moved
    again = replace(solution, minimum=replace(solution.minimum, x=x))
    levels = np.sqrt(assumed.eyes)
    settled = solve_again(
        Problem([noise.without_hand(rows, hand, levels, solution.problem.terms[0])]),
        again,
        SolverOptions(weights=None, confirm=False),
    )
    covariance = np.zeros((len(x),) * 2)
    covariance[np.ix_(free, free)] = _spread(here, fitted, true, hand, term)
    # Turns about the base displace the hand, too.
    place, turn, about_base = true.hand
    place += about_base * float(np.mean(np.sum((p - base) ** 2, axis=1))) * 2.0 / 3.0
    of_hand = np.array([place, turn + about_base])
    shared = float(np.max(of_hand / (of_hand + np.mean(true.eyes[eye], axis=0))))
    together = np.bincount(rests)
    inflation = 1.0 + (float(np.mean(together[rests])) - 1.0) * shared
    return SharedHand(settled, covariance, np.sqrt(np.vstack([of_hand, true.eyes])), inflation)


def _by_pose(line: Linearised) -> FloatArray:
    """(n, 3, 6) derivative by displacements and turns of the hand, of which some do nothing."""
    by_pose = np.zeros((*line.residual.shape, WAYS))
    for first, part in ((0, ~line.pattern.angular), (AXES, line.pattern.angular)):
        if part.any():
            by_pose[..., first : first + AXES] = line.by_pose[..., part]
    return by_pose


def _most_likely(rows: _Rows, fit: RobustFit) -> _Variances:
    """Variances of the restricted maximum likelihood, of part of many rests."""
    count = int(rows.rest.max()) + 1
    most = max(int(count * ENOUGH / len(rows.residual)), 3)
    eyes = int(rows.eye.max()) + 1
    if most < count:
        rows = rows.of_rests(np.linspace(0, count - 1, most).astype(np.intp))
    place, turn = np.square(fit.sigmas) / 2.0 + ROUNDING**2
    now = _Variances(np.array([place, turn / 2.0, turn / 2.0]), np.tile([place, turn], (eyes, 1)))
    for _ in range(60):
        likelier = _Fitted(rows, now).likelier()
        again = _Variances(likelier.hand + ROUNDING**2, likelier.eyes + ROUNDING**2)
        total = again.hand[[0, 1, 1]] + again.eyes[:, [0, 1, 1]].min(axis=0)
        change = np.abs(again.hand - now.hand) / total
        settled = max(float(change.max()), float(np.abs(np.log(again.eyes / now.eyes)).max()))
        now = again
        # A standard deviation is then known to less than a hundredth.
        if settled < 5e-3:
            break
    return now


def _spread(
    rows: _Rows, fitted: _Fitted, true: _Variances, hand: Poses, term: PairedHandEye
) -> FloatArray:
    """Covariance (p, p) of generalised least squares, where neighbours may err alike."""
    n, unknowns = len(rows.residual), fitted.weighed.shape[2]
    count = int(rows.rest.max()) + 1
    bread = fitted.covariance
    if count > MOST_ROWS:
        pulls = rows.sums(np.einsum("nap,na->np", rows.jacobian, fitted.left))
        return np.asarray(bread @ (pulls.T @ pulls) @ bread)
    of_eye = true.of_rows(rows.eye)
    of_eyes = fitted.weighed * np.sqrt(of_eye)[..., None]
    flat = of_eyes.reshape(-1, unknowns)
    first = np.unique(rows.rest, return_index=True)[1]
    space = embedded(*(part[first] for part in hand))
    scaled = rows.by_hand * np.sqrt(true.of_hand)
    pulls = rows.sums(np.swapaxes(scaled, 1, 2) @ fitted.weighed)
    total = flat.T @ flat
    for group in (slice(0, AXES), slice(AXES, OF_HAND)):
        pull = pulls[:, group].reshape(count, -1)
        for belief, shape in _beliefs(rows, true, space, group):
            common = (shape @ pull).reshape(-1, unknowns)
            total += belief * pull.reshape(-1, unknowns).T @ common
    freedom = AXES * count - unknowns / 2.0
    # The scatter of few rests is itself uncertain, as that of few rows.
    uncertain = freedom / (freedom - 2.0) if count < MANY_ROWS and freedom > 2.0 else 1.0
    independent = np.asarray(uncertain * bread @ total @ bread)
    if n > MOST_ROWS:
        return independent
    # What one eye sees in like places, another does not.
    samples = term.poses.samples
    assert samples.rotation is not None
    assert samples.position is not None
    # Distance, in units in which 1 is far, of what two eyes see.
    by_eye = 30.0 * np.eye(len(true.eyes))[rows.eye]
    sight = np.hstack([embedded(samples.rotation, samples.position), by_eye])
    unit = np.sqrt(of_eye)
    every_row = np.arange(n, dtype=np.intp)
    white = of_eyes, fitted.left * unit
    return independent + common_covariance(
        *(*white, np.ones(WAYS), bread, [sight], every_row, every_row, (AXES, AXES))
    )


def _beliefs(
    rows: _Rows, true: _Variances, space: FloatArray, group: slice
) -> Iterator[tuple[float, FloatArray]]:
    """How probable it is that a group of the hand's errors is alike (rests, rests) at neighbours.

    Args:
        rows: less what is fitted.
        true: variances of errors that are not.
        space: (rests, k) of poses in which 1 is far.
        group: of the nine components.
    """
    count = len(space)
    # Rests of which it is asked whether neighbours err alike.
    chosen = np.unique(np.linspace(0, count - 1, min(count, 45)).astype(np.intp))
    chosen_rows, at = rows.of_rests(chosen), np.ix_(chosen, chosen)
    of_eye = true.of_rows(chosen_rows.eye)[..., None]
    both = np.concatenate([chosen_rows.jacobian, chosen_rows.residual[..., None]], axis=2)
    scaled = chosen_rows.by_hand * np.sqrt(true.of_hand)
    over = np.swapaxes(scaled / of_eye, 1, 2)
    inner, of_hand = chosen_rows.sums(over @ scaled), chosen_rows.sums(over @ both)
    flat = both.reshape(-1, both.shape[2])
    plain = flat.T @ (both / of_eye).reshape(flat.shape)
    likelihoods = [
        (
            np.log(prior) + _restricted(inner, of_hand, plain, part, len(flat), group),
            prior,
            covariance,
        )
        for prior, part, covariance in _shapes(space, at)
    ]
    most = max(likelihood for likelihood, _, _ in likelihoods)
    beliefs = np.exp([likelihood - most for likelihood, _, _ in likelihoods])
    for belief, (_, _, covariance) in zip(beliefs / beliefs.sum(), likelihoods, strict=True):
        # Less than this adds nothing to a standard deviation.
        if belief > 1e-3:
            yield float(belief), covariance


def _shapes(
    space: FloatArray, at: tuple[IntArray, ...]
) -> Iterator[tuple[float, FloatArray, FloatArray]]:
    """Prior probability, and correlation of some rests and of all, of what neighbours may share."""
    for prior, shape, parts in kernels([space], None, len(space)):
        for part in parts:
            covariance = (1.0 - part) * np.eye(len(space)) + part * shape
            yield prior, covariance[at], covariance


def _restricted(
    inner: FloatArray,
    of_hand: FloatArray,
    plain: FloatArray,
    shape: FloatArray,
    numbers: int,
    group: slice,
) -> float:
    """Restricted log-likelihood where a group of the hand's errors has the correlation ``shape``.

    Args:
        inner: (r, 9, 9) HᵀD⁻¹H of each rest.
        of_hand: (r, 9, p + 1) HᵀD⁻¹ of derivatives and residuals.
        plain: (p + 1, p + 1) of these themselves, D⁻¹ between them.
        shape: (r, r).
        numbers: of the residuals, all in all.
        group: of the nine components.
    """
    rests, root = len(shape), np.linalg.cholesky(shape)
    factor = np.zeros((OF_HAND, rests, rests))
    factor[:] = np.eye(rests)
    factor[group] = root
    # Lᵀ T L by components: a triangle of rests for each two of them.
    matrix = np.empty((OF_HAND, rests, OF_HAND, rests))
    for c in range(OF_HAND):
        for d in range(OF_HAND):
            matrix[c, :, d] = (factor[c].T * inner[:, c, d]) @ factor[d]
    size = OF_HAND * rests
    right = (np.swapaxes(factor, 1, 2) @ np.swapaxes(of_hand, 0, 1)).reshape(size, -1)
    triangle = np.linalg.cholesky(np.eye(size) + matrix.reshape(size, size))
    solved = np.linalg.solve(triangle, right)
    left = plain - solved.T @ solved
    information, pull = left[:-1, :-1], left[:-1, -1]
    unit = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, axes = np.linalg.eigh(information * np.outer(unit, unit))
    determined = values > 1e-10 * values[-1]
    along = (axes.T @ (unit * pull))[determined]
    power = max(float(left[-1, -1] - np.sum(along**2 / values[determined])), 1e-300)
    freedom = max(numbers - int(determined.sum()), 1)
    determinants = 2.0 * np.log(np.diag(triangle)).sum() + np.log(values[determined]).sum()
    # In units in which an unknown is told as well by all: what they are does not matter.
    determinants -= 2.0 * np.log(np.where(unit < 1e149, unit, 1.0)).sum()
    return -0.5 * float(determinants + freedom * np.log(power))
