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

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.pinhole import CENTRE, DISTORTION, FOCAL
from suta_calib.pose_calibration.correlation import common_covariance
from suta_calib.pose_calibration.picture_likelihood import (
    WAYS,
    Known,
    Likelihood,
    Point,
    Sums,
)
from suta_calib.solver.kernel import dense
from suta_calib.solver.level_uncertainty import covariance_of_levels
from suta_calib.solver.losses import huber_weight
from suta_calib.solver.problem import Problem
from suta_calib.solver.weights import CAMERA, Learned, WeightOptions, prior_groups
from suta_calib.terms import CameraView
from suta_calib.terms.camera_start import HELD

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
# What of a level's logarithm is no move any more.
STILL: Final = 0.03
# What comes to what is known of a camera, in units of it, that makes it nothing.
WIDE: Final = 30.0


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

    def sums(self, weights: Sequence[FloatArray]) -> Sums:
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
        return Sums(*map(np.array, zip(*found, strict=True)))

    def beliefs(self, here: Point, sigmas: FloatArray) -> list[FloatArray]:
        """Huber's weight of every corner, with the hand where its picture puts it."""
        weights = []
        for (hand, r, J, P), sigma in zip(self.parts, sigmas, strict=True):
            own = r + J @ here.step - np.einsum("ndc,nc->nd", P, here.poses[hand])
            weights.append(huber_weight(np.sum(own**2, axis=1) / sigma**2, np.array(FAR)))
        return weights


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
        known = Known(precision[free], (x - nominal)[free], groups, WeightOptions().camera)
        likelihood = Likelihood(rows.sums(weights), known)
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


def _in_common(here: Point, alike: Sequence[FloatArray]) -> FloatArray:
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
