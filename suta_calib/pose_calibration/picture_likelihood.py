"""The likelihood of how far corners scatter and hands are off, by sums over pictures.

`picture_noise` says of what; this is its mathematics: with the sums over the corners of every
picture, value and gradient take no more than a product of six by six matrices for each.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
from scipy.optimize import minimize

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.pose_calibration.correlation import DIRECTIONS, WAYS

# Step of the differences of logarithms.
STEP: Final = 0.1


@dataclass(frozen=True, eq=False)
class Sums:
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

    def without(self, part: Sums) -> Sums:
        """Over the corners that are not in ``part``, which are among these."""
        return Sums(*(getattr(self, f.name) - getattr(part, f.name) for f in fields(self)))


@dataclass(frozen=True, eq=False)
class PriorKnowledge:
    """What is known of the unknowns beforehand.

    Attributes:
        precision: (p,) 1/prior², zero where nothing is.
        away: (p,) where they are against it.
        groups: (g, p) which of them may be worse known than is said, together.
        spread: of the logarithm of what that adds, in units of the priors.
        shared: (k, p) which of them are errors that neighbouring poses of the hand share, and whose
            scatter is a level; their precision is 1 here.
    """

    precision: FloatArray
    away: FloatArray
    groups: BoolArray
    spread: float
    shared: BoolArray

    def at(self, levels: FloatArray) -> FloatArray:
        """(p,) precision of every unknown.

        Args:
            levels: (g + k,) what comes to the priors of each group, in units of them: a calibration
                that seems better than it says may be so by chance, so that no prior becomes
                narrower; and the scatter of each sort of shared errors, m and rad.
        """
        added, scatter = np.split(levels**2, [len(self.groups)])
        unit = np.where(self.shared.any(axis=0), scatter @ self.shared, 1.0)
        return self.precision / (1.0 + added @ self.groups) / unit

    def with_shared(self, count: int) -> PriorKnowledge:
        """The same with so many coefficients of shared errors: three and three in turn."""
        sorts = np.tile(np.repeat(np.eye(2, dtype=np.bool_), DIRECTIONS, axis=1), count // WAYS)
        return replace(
            self,
            precision=np.concatenate([self.precision, np.ones(count)]),
            away=np.pad(self.away, (0, count)),
            groups=np.pad(self.groups, ((0, 0), (0, count))),
            shared=np.pad(sorts[: 2 if count else 0], ((0, 0), (len(self.precision), 0))),
        )


@dataclass(frozen=True, eq=False)
class LikelihoodPoint:
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


class Likelihood:
    """-log of the restricted likelihood of the levels, with what is known of them.

    The levels are the logarithms of σ of each camera, of τ_p and τ_r, of what comes to the priors
    of each group, and of the scatter of what neighbours share.
    """

    def __init__(self, sums: Sums, prior: PriorKnowledge) -> None:
        self.sums, self.known, self.cameras = sums, prior, len(sums.count)

    def at(self, eta: FloatArray) -> LikelihoodPoint:
        """At some levels."""
        sums, prior, c = self.sums, self.known, self.cameras
        inverse, scale = np.exp(-2.0 * eta[:c]), self._scale(eta)
        precision = prior.at(np.exp(eta[c + 2 :]))
        pp = scale[:, None] * np.tensordot(inverse, sums.pp, 1) * scale
        pj = scale[:, None] * np.tensordot(inverse, sums.pj, 1)
        pr = scale * np.tensordot(inverse, sums.pr, 1)
        inner = np.eye(WAYS) + pp
        solved = np.linalg.solve(inner, np.concatenate([pj, pr[:, :, None]], axis=2))
        # One product over poses and ways: every picture adds to it.
        answered = pj.reshape(-1, pj.shape[2]).T @ solved.reshape(-1, solved.shape[2])
        curvature = np.tensordot(inverse, sums.jj, 1) + np.diag(precision) - answered[:, :-1]
        slope = inverse @ sums.jr + precision * prior.away - answered[:, -1]
        unit = 1.0 / np.sqrt(np.maximum(np.diag(curvature), 1e-300))
        scaled = curvature * np.outer(unit, unit)
        covariance = np.linalg.pinv(scaled, 1e-13, True) * np.outer(unit, unit)
        step = -covariance @ slope
        energy = float(inverse @ sums.rr) + float(precision @ prior.away**2)
        energy -= float(np.sum(pr * solved[:, :, -1])) - float(slope @ step)
        log_determinants = 2.0 * float(sums.count @ eta[:c]) + float(
            np.linalg.slogdet(inner)[1].sum()
        )
        log_determinants += float(np.linalg.slogdet(scaled)[1]) - 2.0 * float(np.log(unit).sum())
        levelled = prior.groups.any(axis=0) | prior.shared.any(axis=0)
        log_determinants -= float(np.log(precision[levelled]).sum())
        added, scatter = np.split(eta[c + 2 :], [len(prior.groups)])
        value = (
            0.5 * (energy + log_determinants) - float(eta[c : c + 2].sum()) - float(scatter.sum())
        )
        value += 0.5 * float(np.sum((added / prior.spread) ** 2))
        answers = solved[:, :, :-1]
        poses = scale * (solved[:, :, -1] + answers @ step)
        return LikelihoodPoint(value, step, covariance, poses, (pp, pj, pr), answers)

    def gradient(self, eta: FloatArray, here: LikelihoodPoint) -> FloatArray:
        """Derivative of the value by the levels, at what `at` found there.

        By Fisher's identity it is that of the expectation, over what unknowns and hand may be given
        the corners, of the likelihood that had them known: so many corners less what their squares
        are expected to sum to, and the same of the hand's poses and of what is known.
        """
        sums, prior, c = self.sums, self.known, self.cameras
        scale, tail = self._scale(eta), eta[c + 2 :]
        widening = tail[: len(prior.groups)]
        added = np.exp(2.0 * widening)
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
        away = np.diag(here.covariance) + (here.step + prior.away) ** 2
        excess = 1.0 - prior.at(np.exp(tail)) * away
        part = added[:, None] * prior.groups / (1.0 + added @ prior.groups)
        return np.concatenate(
            [
                sums.count - np.exp(-2.0 * eta[:c]) * squares,
                ways.sum(axis=1) - 1.0,
                part @ excess + widening / prior.spread**2,
                prior.shared @ excess - 1.0,
            ]
        )

    def best(self, start: FloatArray) -> FloatArray:
        """The levels of largest likelihood."""

        def value_and_gradient(eta: FloatArray) -> tuple[float, FloatArray]:
            here = self.at(eta)
            return here.value, self.gradient(eta, here)

        # How far a level may move in one round.
        bounds = [(level - 3.0, level + 3.0) for level in start.tolist()]
        minimum = minimize(value_and_gradient, start, jac=True, method="L-BFGS-B", bounds=bounds)
        return np.asarray(minimum.x, dtype=np.float64)

    def uncertainty(self, best: FloatArray) -> FloatArray:
        """Covariance of the levels about the best, by differences of the gradient."""
        slopes = [
            [self.gradient(eta, self.at(eta)) for eta in (best + step, best - step)]
            for step in STEP * np.eye(len(best))
        ]
        hessian = np.array([ahead - behind for ahead, behind in slopes]) / (2.0 * STEP)
        values, vectors = np.linalg.eigh((hessian + hessian.T) / 2.0)
        # Largest standard deviation of a logarithm that a parabola about the best tells.
        return np.asarray((vectors / np.maximum(values, 1.5**-2)) @ vectors.T)

    def _scale(self, eta: FloatArray) -> FloatArray:
        """(6,) scatter of the hand's pose in every way, m and rad."""
        return np.repeat(np.exp(eta[self.cameras : self.cameras + 2]), DIRECTIONS)
