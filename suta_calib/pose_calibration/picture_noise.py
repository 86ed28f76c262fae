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

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.geometry.pinhole import CENTRE, DISTORTION, FOCAL
from suta_calib.model.parameters import PLACEMENT
from suta_calib.pose_calibration.correlation import common_covariance
from suta_calib.pose_calibration.picture_likelihood import (
    WAYS,
    Known,
    Likelihood,
    Point,
    Sums,
)
from suta_calib.records import dataclass
from suta_calib.solver.kernel import dense
from suta_calib.solver.level_uncertainty import covariance_of_levels
from suta_calib.solver.losses import huber_weight
from suta_calib.solver.options import WeightOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.weights import CAMERA, Learned, prior_groups
from suta_calib.terms import CameraView
from suta_calib.terms.intrinsics import HELD

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
# Part of its size by which a board may be of another one than its file says: hardly anything is
# known of it beforehand, but that motions which do not tell it leave it as it is.
ANY_SIZE: Final = 0.3
# Such a part that one linearisation tells as well as several.
NEAR: Final = 5e-3


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
        levels: logarithms of what scatters, as `Likelihood` has them.
    """

    names: tuple[str, ...]
    x: FloatArray
    covariance: FloatArray
    noise: PictureNoise
    free: IntArray
    told: FloatArray
    told_covariance: FloatArray
    levels: FloatArray

    @property
    def values(self) -> dict[str, float]:
        """Every parameter's value by name, SI and px."""
        return dict(zip(self.names, self.x.tolist(), strict=True))


class _Rows:
    """The corners of every camera at one x, in px."""

    def __init__(
        self,
        problem: Problem,
        x: FloatArray,
        free: IntArray,
        hands: IntArray,
        boards: Sequence[str] = (),
    ) -> None:
        self.groups = int(hands.max()) + 1
        self.parts: list[tuple[IntArray, FloatArray, FloatArray, FloatArray]] = []
        lines = problem.linearise(x, problem.assumed_sigmas())
        for term, line in zip(problem.terms, lines, strict=True):
            assert isinstance(term, CameraView)
            _, own = problem.evaluation.columns(line, line.by_pose, line.by_own)
            hand = hands[line.view.block.samples[:, 0] + line.view.first_sample]
            every = dense(own).reshape(*line.residual.shape, -1)
            jacobian = every[:, :, free]
            if boards:
                larger = _by_size(problem, term, every, x)
                mine = [np.where(term.target == board, larger, 0.0) for board in boards]
                jacobian = np.concatenate([jacobian, np.stack(mine, axis=2)], axis=2)
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


@dataclass(frozen=True, eq=False)
class _Settled:
    """Where the search for unknowns and levels has ended.

    Attributes:
        problem: with the boards as large as they came out.
        x: (n,) its parameters.
        eta: the levels.
        likelihood: about x.
        here: of the levels.
    """

    problem: Problem
    x: FloatArray
    eta: FloatArray
    likelihood: Likelihood
    here: Point


def _settled(
    problem: Problem,
    start: FloatArray,
    free: IntArray,
    hands: IntArray,
    boards: Mapping[str, float],
    eta: FloatArray | None = None,
    rounds: int = ROUNDS,
) -> _Settled:
    """Unknowns and levels of largest likelihood.

    Args:
        problem: of the pictures of every camera, as its job gives it.
        start: (n,) near the answer.
        free: indices of what is estimated.
        hands: (samples,) pose of the hand of every sample.
        boards: those whose size is estimated too, by label; how well it is known, as a part of it.
        eta: the levels to begin from.
        rounds: linearisations at most.
    """
    x, sizes = start.copy(), np.zeros(len(boards))
    unknown, count = np.append(free, len(x) + np.arange(len(boards))), len(free)
    nominal = problem.parameters.array("nominal")
    known_sizes = np.array(list(boards.values())) ** -2.0
    precision = np.concatenate([problem.prior_precision(), known_sizes])[unknown]
    groups = np.pad(_camera_groups(problem), ((0, 0), (0, len(boards))))[:, unknown]
    groups = groups[groups.any(axis=1)]
    cameras = len(problem.terms)
    if eta is None:
        eta = np.log([*([BEGIN[0]] * cameras), *BEGIN[1:], *([1.0] * len(groups))])
    weights: list[FloatArray] | None = None
    now = problem
    for _ in range(rounds):
        rows = _Rows(now, x, free, hands, list(boards))
        weights = weights or [np.ones(len(part[0])) for part in rows.parts]
        away = np.concatenate([(x - nominal)[free], sizes])
        likelihood = Likelihood(
            rows.sums(weights), Known(precision, away, groups, WeightOptions().camera)
        )
        before, eta = eta, likelihood.best(eta)
        here = likelihood.at(eta)
        if _robust(problem):
            weights = rows.beliefs(here, np.exp(eta[:cameras]))
        x[free] += here.step[:count]
        std = np.sqrt(np.diag(here.covariance))
        settled = np.all(np.abs(here.step) <= SETTLED * std)
        if boards:
            sizes = sizes + here.step[count:]
            now = _resized(problem, dict(zip(boards, np.exp(sizes).tolist(), strict=True)))
        if settled and np.all(np.abs(eta - before) <= STILL):
            break
    return _Settled(now, x, eta, likelihood, here)


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
    problem = problem.as_given()
    cameras = len(problem.terms)
    found = _settled(problem, start, free, hands, {})
    x, eta, likelihood, here = found.x, found.eta, found.likelihood, found.here
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
    return Weighed(problem.names, x, every, noise, free, told, of_alone, eta)


def sizes_of_boards(
    problem: Problem,
    weighed: Weighed,
    hands: IntArray,
    alike: Sequence[FloatArray] = (),
) -> dict[str, Learned]:
    """How many times as large as its file says every board is, by the motions of the hand.

    The hand's millimetres are held against the board's: the logarithm of each size is one more
    unknown of the same likelihood, beside all that was free in ``weighed``.

    Args:
        problem: of which ``weighed`` is the answer.
        weighed: what `weigh_pictures` found.
        hands: as it was given them.
        alike: as it was given them.

    Returns:
        By the board's label.
    """
    problem, first = problem.as_given(), len(weighed.free)
    targets = dict.fromkeys(t.target for t in problem.terms if isinstance(t, CameraView))
    boards = dict.fromkeys(targets, ANY_SIZE)
    for rounds in (1, ROUNDS):
        found = _settled(problem, weighed.x, weighed.free, hands, boards, weighed.levels, rounds)
        away = (found.likelihood.known.away + found.here.step)[first:]
        # So near, one step is enough.
        if np.all(np.abs(away) < NEAR):
            break
    levels = found.likelihood.uncertainty(found.eta)
    covariance = found.here.covariance + _in_common(found.here, alike)
    covariance = covariance + covariance_of_levels(found.likelihood.at, found.eta, levels)
    stds = np.sqrt(np.diag(covariance))[first:]
    return {
        board: Learned(float(np.exp(size)), float(std), None)
        for board, size, std in zip(boards, away, stds, strict=True)
    }


def _by_size(problem: Problem, term: CameraView, every: FloatArray, x: FloatArray) -> FloatArray:
    """(n, 2) derivative of the residuals by the logarithm of the board's size.

    A point of it moves as the whole board would if it were pushed along the way from its origin.

    Args:
        problem: of the term.
        term: whose board it is.
        every: (n, 2, p) derivative by all unknowns.
        x: (p,) of them.
    """
    owner = term.owners[1]
    at = [problem.names.index(f"{owner}.{key}") for key in PLACEMENT]
    turn = rotation_from_vector(x[at[3:]])
    _, point = term.found
    return np.asarray(np.einsum("nda,na->nd", every[:, :, at[:3]], term.points[point] @ turn.T))


def _resized(problem: Problem, factors: Mapping[str, float]) -> Problem:
    """The same with every board so many times as large."""
    terms = [
        replace(term, board=term.board.scaled(factors[term.target]))
        for term in problem.terms
        if isinstance(term, CameraView)
    ]
    return Problem(terms)


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
