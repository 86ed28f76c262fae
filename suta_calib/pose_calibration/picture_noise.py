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

Neither a hand nor who finds corners errs for itself in every picture. An arm of wrong geometry errs
by a smooth function of its posture, which is estimated beside the rest: e_i has a part ``F_i b``
with functions of the pose (`shared_errors`) and b ~ N(0, s_p²) for displacements, s_r² for turns.
What neighbours have in common beyond it is added to the covariance, by `correlation`. Which frames
then follow the pixels, pictures that are left out decide (`picture_models`).

Of a hand's scatter all sizes are taken to be equally likely beforehand (Gelman 2006,
doi:10.1214/06-BA117A): that of a hand which is exactly where it says may be nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.lens import CENTRE, DISTORTION, FOCAL
from suta_calib.pose_calibration.correlation import WAYS, common_covariance
from suta_calib.pose_calibration.picture_likelihood import (
    Likelihood,
    LikelihoodPoint,
    PriorKnowledge,
)
from suta_calib.pose_calibration.picture_models import Chosen, choose_model
from suta_calib.pose_calibration.picture_rows import LensPictures, PictureRows
from suta_calib.solver.noise_evidence import covariance_of_levels
from suta_calib.solver.options import WeightOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.weights import CAMERA, Learned, prior_groups
from suta_calib.terms import CameraView
from suta_calib.terms.intrinsics import HELD
from suta_calib.terms.surveyed_markers import SurveyedMarkers

# Linearisations at most.
ROUNDS: Final = 10
# Corners' σ, px, and the hand's τ, m and rad, from where the search begins.
BEGIN: Final = (0.1, 1e-4, 1e-4)


@dataclass(frozen=True, eq=False)
class Hands:
    """Poses of the hand at which pictures were taken.

    Attributes:
        of_sample: (samples,) which of them every sample of every term has, from 0: cameras that
            took pictures at the same one share what is wrong with it.
        spaces: spaces (poses, k) in which neighbours may err alike; 1 is far.
        shared: (poses, 6, k) errors that they share, by `shared_errors`.
        lenses: of each camera the pictures that are not among the samples: what the hand says of
            them is not believed, and they tell the camera's lens alone.
    """

    of_sample: IntArray
    spaces: Sequence[FloatArray]
    shared: FloatArray
    lenses: Sequence[LensPictures | None]


@dataclass(frozen=True)
class PictureNoise:
    """What scatters, as the pictures tell it.

    Attributes:
        corners: of one component of a corner, px, by camera.
        position: of a hand's pose against what was reported, m, of each direction; of each pose.
        rotation: the same, rad, about each axis.
        shared: errors that neighbouring poses share, m of each direction and rad about each axis;
            zero where there are too few poses to tell.
    """

    corners: dict[str, float]
    position: Learned
    rotation: Learned
    shared: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Weighed:
    """An estimate that weighs the pictures as they deserve.

    Attributes:
        names: of the parameters.
        x: (n,) parameters, SI and px.
        covariance: (n, n) of them.
        noise: what scatters.
        free: indices that were estimated.
        free_estimate: (n,) of them as the pictures alone tell them, whatever is known of the
            cameras.
        told_covariance: (n, n) of these.
        levels: logarithms of what scatters, as `Likelihood` has them.
        chosen: the model of the hand's errors.
        hands: poses of the hand, with what they share if they do.
        by_files: (n, n) the part of the covariance that what is known of the cameras makes.
    """

    names: tuple[str, ...]
    x: FloatArray
    covariance: FloatArray
    noise: PictureNoise
    free: IntArray
    free_estimate: FloatArray
    told_covariance: FloatArray
    levels: FloatArray
    chosen: Chosen
    hands: Hands
    by_files: FloatArray

    @property
    def values(self) -> dict[str, float]:
        """Every parameter's value by name, SI and px."""
        return dict(zip(self.names, self.x.tolist(), strict=True))

    def or_else(self, other: Weighed, chance: float) -> Weighed:
        """The same estimate with its covariance, if with this chance it is right, and else another.

        The mean square error about it (Hoeting et al. 1999, doi:10.1214/ss/1009212519).
        """
        away = other.x - self.x
        doubt = other.covariance + np.outer(away, away)
        return replace(self, covariance=chance * self.covariance + (1.0 - chance) * doubt)


@dataclass(frozen=True, eq=False)
class _Settled:
    """Unknowns x (n,) and levels of largest likelihood; rows are about x less the last step."""

    problem: Problem
    x: FloatArray
    eta: FloatArray
    rows: PictureRows
    likelihood: Likelihood
    here: LikelihoodPoint


def _settled(
    problem: Problem,
    start: FloatArray,
    free: IntArray,
    hands: Hands,
    boards: Mapping[str, float],
    eta: FloatArray | None = None,
    rounds: int = ROUNDS,
) -> _Settled:
    """Unknowns and levels of largest likelihood, from a start near the answer.

    The sizes of ``boards`` are estimated too: by label, how well each is known, as a part of it.
    """
    x, sizes = start.copy(), np.zeros(len(boards))
    unknown, count = np.append(free, len(x) + np.arange(len(boards))), len(free)
    nominal = problem.parameters.array("nominal")
    known_sizes = np.array(list(boards.values())) ** -2.0
    precision = np.concatenate([problem.prior_precision(), known_sizes])[unknown]
    groups = np.pad(_camera_groups(problem), ((0, 0), (0, len(boards))))[:, unknown]
    groups = groups[groups.any(axis=1)]
    away, none = np.zeros(len(unknown)), np.zeros((0, len(unknown)), dtype=np.bool_)
    prior = PriorKnowledge(precision, away, groups, WeightOptions().camera, none)
    prior = prior.with_shared(hands.shared.shape[2])
    cameras = len(problem.terms)
    if eta is None:
        begin = [*([BEGIN[0]] * cameras), *BEGIN[1:], *([1.0] * len(groups))]
        eta = np.log([*begin, *BEGIN[1 : 1 + len(prior.shared)]])
    weights: list[FloatArray] | None = None
    now = problem
    for _ in range(rounds):
        rows = PictureRows.about(
            *(now, x, free, hands.of_sample, hands.shared, list(boards), weights, hands.lenses)
        )
        # What neighbours share is found anew each time: the problem knows nothing of it.
        away = np.concatenate([(x - nominal)[free], sizes])
        prior = replace(prior, away=np.pad(away, (0, len(prior.away) - len(away))))
        likelihood = Likelihood(rows.sums, prior)
        before, eta = eta, likelihood.best(eta)
        here = likelihood.at(eta)
        # A corner far off may be a blunder.
        if all(np.isfinite(block.noise.huber) for block in problem.blocks):
            weights = rows.beliefs(here, np.exp(eta[:cameras]))
        x[free] += here.step[:count]
        std = np.sqrt(np.diag(here.covariance))
        # Until a step is shorter than this part of its standard deviation.
        settled = np.all(np.abs(here.step) <= 1e-3 * std, where=np.arange(len(std)) < count)
        if boards:
            sizes = sizes + here.step[count : len(unknown)]
            now = _resized(problem, dict(zip(boards, np.exp(sizes).tolist(), strict=True)))
        # What of a level's logarithm is no move any more.
        if settled and np.all(np.abs(eta - before) <= 0.03):
            break
    return _Settled(now, x, eta, rows, likelihood, here)


def weigh_pictures(
    problem: Problem,
    start: FloatArray,
    free: IntArray,
    hands: Hands,
    prior_scale: FloatArray | None = None,
) -> Weighed:
    """The unknowns with every picture weighed by how far the hand is off, and how certainly.

    Priors are as given, or times ``prior_scale`` (n,).
    """
    problem = problem.as_given()
    if prior_scale is not None:
        problem = problem.with_priors_scaled(prior_scale)
    cameras, count = len(problem.terms), len(free)
    alone = replace(hands, shared=hands.shared[:, :, :0])
    estimate = _settled(problem, start, free, alone, {})
    levels = _with_shared(estimate, hands)
    if levels is None:
        hands = alone
    else:
        estimate = _settled(problem, estimate.x, free, hands, {}, levels)
    x, eta, likelihood, here = estimate.x, estimate.eta, estimate.likelihood, estimate.here
    uncertainty = likelihood.uncertainty(eta)
    log_std = np.sqrt(np.diag(uncertainty))
    covariance = here.covariance + covariance_of_levels(likelihood.at, eta, uncertainty)
    covariance = covariance + _in_common(here, hands.spaces)
    # Whose prior was made narrow is exact.
    exact = np.zeros(len(x), dtype=np.bool_) if prior_scale is None else prior_scale < 1.0
    chosen = choose_model(
        *(problem, estimate.rows, likelihood, eta, covariance),
        unknowns=np.isin(np.arange(len(x)), free),
        exact=exact,
    )
    wide = eta.copy()
    shared = cameras + 2 + len(likelihood.known.groups)
    # What comes to what is known of a camera, in units of it, that makes it nothing.
    wide[cameras + 2 : shared] = np.log(30.0)
    untold = likelihood.at(wide)
    told_covariance = untold.covariance + _in_common(untold, hands.spaces)
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
        _shared_scatter(hands.shared, np.exp(eta[shared:])),
    )
    estimated = np.ix_(free, free)
    every, of_alone, by_pictures = np.zeros((len(x),) * 2), np.zeros((len(x),) * 2), x.copy()
    known = likelihood.known.at(np.exp(eta[cameras + 2 :]))[:count]
    by_files, told = np.zeros_like(every), here.covariance[:count, :count]
    by_files[estimated] = told * known @ told
    every[estimated], of_alone[estimated] = chosen.covariance, told_covariance[:count, :count]
    by_pictures[free] += (untold.step - here.step)[:count]
    x[free] += chosen.change
    return Weighed(
        *(problem.names, x, every, noise, free, by_pictures, of_alone, eta, chosen, hands),
        by_files=by_files,
    )


def _with_shared(estimate: _Settled, hands: Hands) -> FloatArray | None:
    """Levels with what poses share, if that makes the corners likelier than ``estimate``."""
    count = hands.shared.shape[2]
    if not count:
        return None
    prior, cameras = estimate.likelihood.known.with_shared(count), estimate.likelihood.cameras
    likelihood = Likelihood(replace(estimate.rows, shared=hands.shared).sums, prior)
    # What each pose had for itself is shared for the most part.
    begin = np.concatenate([estimate.eta, estimate.eta[cameras : cameras + 2]])
    # Part of their errors that poses have for themselves, from where the search begins.
    begin[cameras : cameras + 2] += np.log(0.3)
    eta = likelihood.best(begin)
    # Of the scatter of either, all sizes are equally likely beforehand: that is no evidence.
    with_shared = likelihood.at(eta).value + float(eta[-2:].sum())
    # Logarithm of the likelihood by which errors that poses share are better than none: of poses
    # that err each for itself one set in fifty has as much by chance, and of arms with wrong
    # geometry 28 pictures have 10 to 80.
    return eta if with_shared < estimate.here.value - 3.0 else None


def _shared_scatter(shared: FloatArray, levels: FloatArray) -> tuple[float, float]:
    """Root mean square of what poses share, less what all have in common in the base: m and rad."""
    if not len(levels):
        return 0.0, 0.0
    # Displacements by the first coefficient of every six, and turns by the fourth alike.
    part = shared[:, 0, : -2 * WAYS : WAYS]
    size = float(np.sqrt(np.mean(np.sum((part - part.mean(axis=0)) ** 2, axis=1))))
    return size * float(levels[0]), size * float(levels[1])


def sizes_of_boards(problem: Problem, weighed: Weighed) -> dict[str, Learned]:
    """How many times as large as its file says every board is, by label and the hand's motions.

    The hand's millimetres are held against the board's: the logarithm of each size is one more
    unknown of the same likelihood, beside all that was free in ``weighed``, the answer of
    ``problem``.
    """
    problem, first = problem.as_given(), len(weighed.free)
    views = [term for term in problem.terms if isinstance(term, CameraView)]
    targets = dict.fromkeys(t.target for t in views if not isinstance(t.board, SurveyedMarkers))
    # Sizes of markers that are surveyed are estimated by themselves.
    surveyed = {t.target: Learned(1.0, np.inf, None) for t in views if t.target not in targets}
    if not targets:
        return surveyed
    # Part of its size by which a board may be of another one than its file says: hardly anything is
    # known of it beforehand, but that motions which do not tell it leave it as it is.
    boards = dict.fromkeys(targets, 0.3)
    hands, sizes = weighed.hands, slice(first, first + len(boards))
    for rounds in (1, ROUNDS):
        estimate = _settled(problem, weighed.x, weighed.free, hands, boards, weighed.levels, rounds)
        away = (estimate.likelihood.known.away + estimate.here.step)[sizes]
        # So close to the solution one linearisation is sufficient.
        if np.all(np.abs(away) < 5e-3):
            break
    levels = estimate.likelihood.uncertainty(estimate.eta)
    covariance = estimate.here.covariance + _in_common(estimate.here, hands.spaces)
    covariance = covariance + covariance_of_levels(estimate.likelihood.at, estimate.eta, levels)
    stds = np.sqrt(np.diag(covariance))[sizes]
    return surveyed | {
        board: Learned(float(np.exp(size)), float(std), None)
        for board, size, std in zip(boards, away, stds, strict=True)
    }


def _resized(problem: Problem, factors: Mapping[str, float]) -> Problem:
    """The same with every board so many times as large."""
    terms = [
        replace(term, board=term.board.scaled(factors.get(term.target, 1.0)))
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


def _in_common(here: LikelihoodPoint, neighbourhoods: Sequence[FloatArray]) -> FloatArray:
    """What the covariance grows by as neighbouring pictures err alike.

    By the poses that the pictures give the hand, whitened: with E = PᵀP/σ² in units of the hand's
    scatter, Pᵀr/σ² has the covariance E + E².
    """
    inner, by_unknowns, errors = here.by_pose
    values, vectors = np.linalg.eigh(inner)
    # Relative eigenvalue that is none.
    determined = values > 1e-10 * values.max(axis=1, keepdims=True)
    root = np.where(determined, values * (1.0 + values), np.inf) ** -0.5
    white = (vectors * root[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    jacobian = white @ by_unknowns
    residual = np.einsum("gij,gj->gi", white, errors) + jacobian @ here.step
    by_itself = np.arange(len(residual), dtype=np.intp)
    return common_covariance(
        *(jacobian, residual, np.ones(WAYS), here.covariance, neighbourhoods),
        *(by_itself, by_itself, [WAYS]),
    )
