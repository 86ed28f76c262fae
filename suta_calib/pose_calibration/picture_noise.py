"""Pictures of a board from a hand that is not where it says: how much of either, and what follows.

All corners of a picture share where the hand really was. With J the derivative of a picture's
reprojection errors r by the unknowns and P by the hand's pose,

    r_i = J_i δ + P_i e_i + n_i,    e_i ~ N(0, D),  D = diag(τ_p², τ_r²),    n_i ~ N(0, σ² W_i⁻¹)

so that the covariance of r_i is V_i = σ² W_i⁻¹ + P_i D P_iᵀ, and pictures are weighed as they
deserve: near ones, where a displaced hand shows as many pixels, less than far ones. σ of each
camera, τ_p and τ_r of the hand, and how much worse the cameras are known than is said, are those
of largest restricted likelihood (Patterson and Thompson 1971, doi:10.1093/biomet/58.3.545), and the
covariance is averaged over what else they may be (Kass and Steffey 1989,
doi:10.1080/01621459.1989.10478825).

Of a hand's scatter all sizes are taken to be equally likely beforehand (Gelman 2006,
doi:10.1214/06-BA117A): that of a hand which is exactly where it says may be nothing.

Neither a hand nor who finds corners errs for itself in every picture: what neighbouring pictures
have in common is added to the covariance, by `correlation`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import minimize

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.pinhole import CENTRE, DISTORTION, FOCAL
from suta_calib.pose_calibration.correlation import common_covariance
from suta_calib.solver.kernel import dense
from suta_calib.solver.level_uncertainty import covariance_of_levels
from suta_calib.solver.losses import huber_weight
from suta_calib.solver.options import WeightOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.weights import CAMERA, Learned, prior_groups
from suta_calib.terms import CameraView
from suta_calib.terms.camera_start import HELD

# A hand's pose is wrong in three directions and three turns.
DIRECTIONS: Final = 3
WAYS: Final = 2 * DIRECTIONS
# No corner is found more finely, px: what is smaller is rounding.
FINEST: Final = 1e-3
# Distance of a corner from where it belongs, in its scatter, that one in a hundred good ones has:
# what is farther off pulls no harder.
FAR: Final = 3.03
# Linearisations, until a step is shorter than this part of its standard deviation.
ROUNDS: Final = 10
SETTLED: Final = 1e-3
# Corners' σ, px, and the hand's τ, m and rad, from where the search begins.
BEGIN: Final = (0.1, 1e-4, 1e-4)
# Relative eigenvalue that is none.
ROUNDING: Final = 1e-10
# Logarithms: step of the differences, how far a level may move in one round, and what is no
# move any more.
STEP: Final = 0.1
FARTHEST: Final = 3.0
STILL: Final = 0.03
# What comes to what is known of a camera, in units of it, that makes it nothing.
WIDE: Final = 30.0
# Largest standard deviation of a logarithm that a parabola about the best tells.
VAGUE: Final = 1.5


@dataclass(frozen=True)
class PictureNoise:
    """What scatters, as the pictures tell it.

    Attributes:
        corners: of one component of a corner, px, by camera.
        position: of a hand's pose against what was reported, m, of each direction.
        rotation: the same, rad, about each axis.
    """

    corners: dict[str, float]
    position: Learned
    rotation: Learned


@dataclass(frozen=True, eq=False)
class Weighed:
    """An estimate that weighs the pictures as they deserve.

    Attributes:
        names: of the parameters.
        x: (n,) parameters, SI and px.
        covariance: (n, n) of them.
        noise: what scatters.
        free: indices that were estimated.
        told: (n,) of them as the pictures alone tell them, whatever is known of the cameras.
        told_covariance: (n, n) of these.
    """

    names: tuple[str, ...]
    x: FloatArray
    covariance: FloatArray
    noise: PictureNoise
    free: IntArray
    told: FloatArray
    told_covariance: FloatArray

    @property
    def values(self) -> dict[str, float]:
        """Every parameter's value by name, SI and px."""
        return dict(zip(self.names, self.x.tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class _Sums:
    """Of each camera c and pose g of the hand, over the corners, in px: JᵀWJ, JᵀWr, rᵀWr and so on.

    Attributes:
        count: (c,) numbers.
        jj: (c, p, p).
        jr: (c, p).
        rr: (c,).
        pj: (c, g, 6, p).
        pr: (c, g, 6).
        pp: (c, g, 6, 6).
    """

    count: FloatArray
    jj: FloatArray
    jr: FloatArray
    rr: FloatArray
    pj: FloatArray
    pr: FloatArray
    pp: FloatArray


@dataclass(frozen=True, eq=False)
class _Known:
    """What is known of the unknowns beforehand.

    Attributes:
        precision: (p,) 1/prior², zero where nothing is.
        away: (p,) where they are against it.
        groups: (g, p) which of them may be worse known than is said, together.
        spread: of the logarithm of what that adds, in units of the priors.
    """

    precision: FloatArray
    away: FloatArray
    groups: BoolArray
    spread: float

    def widened(self, added: FloatArray) -> FloatArray:
        """(p,) precision of priors to which independent errors come.

        Args:
            added: (g,) of each group, in units of the priors. A calibration that seems better than
                it says may be so by chance: no prior becomes narrower.
        """
        return self.precision / (1.0 + added**2 @ self.groups)


@dataclass(frozen=True, eq=False)
class _Point:
    """-log restricted likelihood at some levels, and what follows from them.

    Attributes:
        value: of it.
        step: (p,) best one.
        covariance: (p, p) of the step.
        poses: (g, 6) by how much the hand is off, m and rad.
        by_pose: whitened PᵀV⁻¹P (g, 6, 6), PᵀV⁻¹J (g, 6, p) and PᵀV⁻¹r (g, 6) of the corners
            alone, in units of the hand's scatter.
        answers: (g, 6, p) by how much the hand is off per unit of a step, in its scatter.
    """

    value: float
    step: FloatArray
    covariance: FloatArray
    poses: FloatArray
    by_pose: tuple[FloatArray, FloatArray, FloatArray]
    answers: FloatArray


class _Rows:
    """The corners of every camera at one x, in px."""

    def __init__(self, problem: Problem, x: FloatArray, free: IntArray, hands: IntArray) -> None:
        self.groups = int(hands.max()) + 1
        self.parts: list[tuple[IntArray, FloatArray, FloatArray, FloatArray]] = []
        lines = problem.linearise(x, problem.assumed_sigmas())
        for term, line in zip(problem.terms, lines, strict=True):
            assert isinstance(term, CameraView)
            _, own = problem.evaluation.columns(line, line.by_pose, line.by_own)
            hand = hands[line.view.block.samples[:, 0] + line.view.first_sample]
            jacobian = dense(own).reshape(*line.residual.shape, -1)[:, :, free]
            self.parts.append(
                (
                    hand,
                    line.residual / term.pixel,
                    jacobian / term.pixel,
                    # The pose may be any: all six ways show in every corner.
                    line.by_pose / term.pixel,
                )
            )

    def sums(self, weights: Sequence[FloatArray]) -> _Sums:
        """Over the corners, each weighed."""
        found = []
        for (hand, r, J, P), w in zip(self.parts, weights, strict=True):
            wr, wJ, wP = w[:, None] * r, w[:, None, None] * J, w[:, None, None] * P
            pj = np.zeros((self.groups, WAYS, J.shape[2]))
            pr, pp = np.zeros((self.groups, WAYS)), np.zeros((self.groups, WAYS, WAYS))
            np.add.at(pj, hand, np.swapaxes(P, 1, 2) @ wJ)
            np.add.at(pr, hand, np.einsum("ndc,nd->nc", P, wr))
            np.add.at(pp, hand, np.swapaxes(P, 1, 2) @ wP)
            flat, width = wJ.reshape(-1, J.shape[2]), J.shape[2]
            jj, jr = J.reshape(-1, width).T @ flat, flat.T @ r.reshape(-1)
            # Rounding of this size is always there.
            rr = float(np.sum(wr * r)) + r.size * FINEST**2
            found.append((float(r.size), jj, jr, rr, pj, pr, pp))
        return _Sums(*map(np.array, zip(*found, strict=True)))

    def beliefs(self, here: _Point, sigmas: FloatArray) -> list[FloatArray]:
        """Huber's weight of every corner, with the hand where its picture puts it."""
        weights = []
        for (hand, r, J, P), sigma in zip(self.parts, sigmas, strict=True):
            own = r + J @ here.step - np.einsum("ndc,nc->nd", P, here.poses[hand])
            weights.append(huber_weight(np.sum(own**2, axis=1) / sigma**2, np.array(FAR)))
        return weights


class _Likelihood:
    """-log of the restricted likelihood of the levels, with what is known of them.

    The levels are the logarithms of σ of each camera, of τ_p and τ_r, and of what comes to the
    priors of each group.
    """

    def __init__(self, sums: _Sums, known: _Known) -> None:
        self.sums, self.known, self.cameras = sums, known, len(sums.count)

    def at(self, eta: FloatArray) -> _Point:
        """At some levels."""
        sums, known, c = self.sums, self.known, self.cameras
        inverse, scale = np.exp(-2.0 * eta[:c]), self._scale(eta)
        precision = known.widened(np.exp(eta[c + 2 :]))
        pp = scale[:, None] * np.tensordot(inverse, sums.pp, 1) * scale
        pj = scale[:, None] * np.tensordot(inverse, sums.pj, 1)
        pr = scale * np.tensordot(inverse, sums.pr, 1)
        inner = np.eye(WAYS) + pp
        solved = np.linalg.solve(inner, np.concatenate([pj, pr[:, :, None]], axis=2))
        # One product over poses and ways: every picture adds to it.
        answered = pj.reshape(-1, pj.shape[2]).T @ solved.reshape(-1, solved.shape[2])
        curvature = np.tensordot(inverse, sums.jj, 1) + np.diag(precision) - answered[:, :-1]
        slope = inverse @ sums.jr + precision * known.away - answered[:, -1]
        unit = 1.0 / np.sqrt(np.maximum(np.diag(curvature), 1e-300))
        scaled = curvature * np.outer(unit, unit)
        covariance = np.linalg.pinv(scaled, 1e-13, True) * np.outer(unit, unit)
        step = -covariance @ slope
        energy = float(inverse @ sums.rr) + float(precision @ known.away**2)
        energy -= float(np.sum(pr * solved[:, :, -1])) - float(slope @ step)
        whole = 2.0 * float(sums.count @ eta[:c]) + float(np.linalg.slogdet(inner)[1].sum())
        whole += float(np.linalg.slogdet(scaled)[1]) - 2.0 * float(np.log(unit).sum())
        whole -= float(np.log(precision[known.groups.any(axis=0)]).sum())
        value = 0.5 * (energy + whole) - float(eta[c : c + 2].sum())
        value += 0.5 * float(np.sum((eta[c + 2 :] / known.spread) ** 2))
        answers = solved[:, :, :-1]
        poses = scale * (solved[:, :, -1] + answers @ step)
        return _Point(value, step, covariance, poses, (pp, pj, pr), answers)

    def gradient(self, eta: FloatArray, here: _Point) -> FloatArray:
        """Derivative of the value by the levels, at what `at` found there.

        By Fisher's identity it is that of the expectation, over what unknowns and hand may be given
        the corners, of the likelihood that had them known: so many corners less what their squares
        are expected to sum to, and the same of the hand's poses and of what is known.
        """
        sums, known, c = self.sums, self.known, self.cameras
        scale, added = self._scale(eta), np.exp(2.0 * eta[c + 2 :])
        # Second moments of the step and of the hand's poses in their scatter.
        moved, together = here.poses / scale, here.answers @ here.covariance
        steps = here.covariance + np.outer(here.step, here.step)
        both = together + moved[:, :, None] * here.step
        poses = np.linalg.inv(np.eye(WAYS) + here.by_pose[0])
        poses += together @ np.swapaxes(here.answers, 1, 2) + moved[:, :, None] * moved[:, None, :]
        squares = sums.rr + 2.0 * sums.jr @ here.step - 2.0 * np.tensordot(sums.pr, here.poses, 2)
        squares += np.tensordot(sums.jj, steps, 2)
        squares -= 2.0 * np.tensordot(sums.pj, scale[:, None] * both, 3)
        squares += np.tensordot(sums.pp, scale[:, None] * poses * scale, 3)
        ways = np.sum(1.0 - np.diagonal(poses, axis1=1, axis2=2), axis=0).reshape(2, DIRECTIONS)
        away = np.diag(here.covariance) + (here.step + known.away) ** 2
        excess = 1.0 - known.widened(np.sqrt(added)) * away
        part = added[:, None] * known.groups / (1.0 + added @ known.groups)
        return np.concatenate(
            [
                sums.count - np.exp(-2.0 * eta[:c]) * squares,
                ways.sum(axis=1) - 1.0,
                part @ excess + eta[c + 2 :] / known.spread**2,
            ]
        )

    def best(self, start: FloatArray) -> FloatArray:
        """The levels of largest likelihood."""

        def told(eta: FloatArray) -> tuple[float, FloatArray]:
            here = self.at(eta)
            return here.value, self.gradient(eta, here)

        bounds = [(level - FARTHEST, level + FARTHEST) for level in start.tolist()]
        found = minimize(told, start, jac=True, method="L-BFGS-B", bounds=bounds)
        return np.asarray(found.x, dtype=np.float64)

    def uncertainty(self, best: FloatArray) -> FloatArray:
        """Covariance of the levels about the best, by differences of the gradient."""
        slopes = [
            [self.gradient(eta, self.at(eta)) for eta in (best + step, best - step)]
            for step in STEP * np.eye(len(best))
        ]
        hessian = np.array([ahead - behind for ahead, behind in slopes]) / (2.0 * STEP)
        values, vectors = np.linalg.eigh((hessian + hessian.T) / 2.0)
        return np.asarray((vectors / np.maximum(values, VAGUE**-2)) @ vectors.T)

    def _scale(self, eta: FloatArray) -> FloatArray:
        """(6,) scatter of the hand's pose in every way, m and rad."""
        return np.repeat(np.exp(eta[self.cameras : self.cameras + 2]), DIRECTIONS)


def weigh_pictures(
    problem: Problem,
    start: FloatArray,
    free: IntArray,
    hands: IntArray,
    alike: Sequence[FloatArray] = (),
) -> Weighed:
    """The unknowns with every picture weighed by how far the hand is off, and how certainly.

    Args:
        problem: of the pictures of every camera.
        start: (n,) near the answer, as a solver leaves it, SI and px.
        free: indices of what is estimated.
        hands: (samples,) pose of the hand of every sample of every term, from 0: cameras that took
            pictures at the same one share what is wrong with it.
        alike: spaces (poses of the hand, k) in which neighbours may err alike; 1 is far.
    """
    problem, x = problem.as_given(), start.copy()
    nominal = problem.parameters.array("nominal")
    precision = problem.prior_precision()
    groups = _camera_groups(problem)[:, free]
    groups = groups[groups.any(axis=1)]
    cameras = len(problem.terms)
    eta = np.log([*([BEGIN[0]] * cameras), *BEGIN[1:], *([1.0] * len(groups))])
    weights: list[FloatArray] | None = None
    for _ in range(ROUNDS):
        rows = _Rows(problem, x, free, hands)
        weights = weights or [np.ones(len(part[0])) for part in rows.parts]
        known = _Known(precision[free], (x - nominal)[free], groups, WeightOptions().camera)
        likelihood = _Likelihood(rows.sums(weights), known)
        before, eta = eta, likelihood.best(eta)
        here = likelihood.at(eta)
        if _robust(problem):
            weights = rows.beliefs(here, np.exp(eta[:cameras]))
        x[free] += here.step
        std = np.sqrt(np.diag(here.covariance))
        settled = np.all(np.abs(here.step) <= SETTLED * std)
        if settled and np.all(np.abs(eta - before) <= STILL):
            break
    uncertainty = likelihood.uncertainty(eta)
    log_std = np.sqrt(np.diag(uncertainty))
    covariance = here.covariance + covariance_of_levels(likelihood.at, eta, uncertainty)
    covariance = covariance + _in_common(here, alike)
    wide = eta.copy()
    wide[cameras + 2 :] = np.log(WIDE)
    alone = likelihood.at(wide)
    told_covariance = alone.covariance + _in_common(alone, alike)
    position, rotation = (
        Learned(float(np.exp(eta[k])), float(log_std[k]), None) for k in (cameras, cameras + 1)
    )
    noise = PictureNoise(
        {
            term.label: float(np.exp(level))
            for term, level in zip(problem.terms, eta[:cameras], strict=True)
            if isinstance(term, CameraView)
        },
        position,
        rotation,
    )
    whole = np.ix_(free, free)
    every, of_alone, told = np.zeros((len(x),) * 2), np.zeros((len(x),) * 2), x.copy()
    every[whole], of_alone[whole] = covariance, told_covariance
    told[free] += alone.step - here.step
    return Weighed(problem.names, x, every, noise, free, told, of_alone)


def _camera_groups(problem: Problem) -> BoolArray:
    """(3, n) which unknowns are focal lengths, principal points and distortion that may be wrong.

    Who writes down another principal point need not have got the distortion wrong, and what is no
    part of a camera's model tells nothing of the rest.
    """
    widened = [
        group == CAMERA and p.prior is not None and p.prior > HELD
        for p, group in zip(problem.parameters.values(), prior_groups(problem), strict=True)
    ]
    keys = [p.key for p in problem.parameters.values()]
    return np.array([np.isin(keys, kind) & widened for kind in (FOCAL, CENTRE, DISTORTION)])


def _robust(problem: Problem) -> bool:
    """Whether a corner far off may be a blunder."""
    return all(np.isfinite(block.noise.huber) for block in problem.blocks)


def _in_common(here: _Point, alike: Sequence[FloatArray]) -> FloatArray:
    """What the covariance grows by as neighbouring pictures err alike.

    By the poses that the pictures give the hand, whitened: with E = PᵀP/σ² in units of the hand's
    scatter, Pᵀr/σ² has the covariance E + E².
    """
    inner, by_unknowns, errors = here.by_pose
    values, vectors = np.linalg.eigh(inner)
    told = values > ROUNDING * values.max(axis=1, keepdims=True)
    root = np.where(told, values * (1.0 + values), np.inf) ** -0.5
    white = (vectors * root[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    jacobian = white @ by_unknowns
    residual = np.einsum("gij,gj->gi", white, errors) + jacobian @ here.step
    each = np.arange(len(residual), dtype=np.intp)
    return common_covariance(
        jacobian, residual, np.ones(WAYS), here.covariance, alike, each, each, [WAYS]
    )
