"""Which frames follow the pixels and which the errors of the hand: judged by pictures left out.

Weighing every picture by how far its hand may be off gives the unknowns nearest to the truth, if
the hand errs as is assumed. An arm whose lengths and angles are wrong errs alike at all poses that
are used, in the base's frame most of all. What its pictures have in common there belongs to no
pose, and a board (or a camera beside the arm) that is placed without it is seen some pixels off. So
there are several answers. Each is the generalised least squares of the unknowns, after which

* nothing changes,
* what stands in the base is placed anew where the pixels are best, all else held,
* so it is after all frames went a part of their way to where the pixels are best, or
* the camera's intrinsics went a part of theirs too. All of it is ordinary least squares of the
  reprojection, the hand exactly where it says.

The first of them that predicts pictures which were left out as well as that is taken. A fold costs
a solve of the normal equations: corners and levels stay, and its sums are taken out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.pose_calibration.correlation import DIRECTIONS
from suta_calib.pose_calibration.picture_likelihood import Likelihood, LikelihoodPoint, Sums
from suta_calib.pose_calibration.picture_rows import PictureRows
from suta_calib.solver.problem import Problem
from suta_calib.terms import CameraView
from suta_calib.terms.hand_eye_start import EYE_IN_HAND
from suta_calib.terms.surveyed_markers import SurveyedMarkers

# A model whose errors of pictures left out exceed those of least squares by no more than this part
# predicts as well: folds dealt in another way change the ratio of two models by as much.
AS_GOOD: Final = 1.02
# The same against least squares of the intrinsics too. They bend to take up what is an arm's error,
# which costs X: of 30 simulated sets of wrong arms, twelve ask for it. X is 2.2 mm off there by the
# frames alone, which predict up to 36 % worse, 3.8 mm by all of least squares, and 2.6 mm by as
# small a part of the way as will do. On a measured UR3a these leave 0.72, 0.59 and 0.57 px, and X
# is known to ± 18, 39 and 25 mm.
AS_GOOD_AS_BENT: Final = 1.05
FOLDS: Final = 10
# Of the order in which poses are dealt into folds.
SEED: Final = 0


@dataclass(frozen=True)
class ErrorModel:
    """How the errors of the hand are taken.

    Attributes:
        base_by_pixels: whether what stands in the base is placed where the pixels are best.
        share: part of the way from the generalised least squares, 0, to that of the pixels, 1, that
            frames go before.
        camera_share: part of theirs that the intrinsics go too, where they are estimated.
    """

    base_by_pixels: bool
    share: float
    camera_share: float = 0.0

    @property
    def name(self) -> str:
        """``hand-errors``, ``exact-hand``, or ``mixed``."""
        if not self.base_by_pixels:
            return "hand-errors"
        return "exact-hand" if self.share == 1.0 else "mixed"


FRAMES_BY_PIXELS: Final = ErrorModel(base_by_pixels=True, share=1.0)
_PARTS: Final = (0.25, 0.5, 0.75, 1.0)
# In the order of preference: the first is nearest to the truth where the hand errs as assumed. The
# last is least squares.
MODELS: Final = (
    ErrorModel(base_by_pixels=False, share=0.0),
    *(ErrorModel(base_by_pixels=True, share=share) for share in (0.0, *_PARTS)),
    *(replace(FRAMES_BY_PIXELS, camera_share=share) for share in _PARTS),
)


@dataclass(frozen=True)
class ReprojectionError:
    """Root mean square of the corners' errors, 2-D, px.

    Attributes:
        fitted: of the pictures that were fitted.
        left_out: of pictures that were left out in turn.
    """

    fitted: float
    left_out: float


@dataclass(frozen=True, eq=False)
class Chosen:
    """The model of the hand's errors that was taken.

    Attributes:
        model: that was taken.
        errors: of every model; empty where there were too few pictures to leave some out.
        change: (p,) of the unknowns against the generalised least squares.
        covariance: (p, p) of them.
    """

    model: ErrorModel
    errors: Mapping[ErrorModel, ReprojectionError]
    change: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class _Placing:
    """A step that follows from another one and from the pixels: ``M step - L Jᵀr``."""

    # M and L, (p, p).
    by_step: FloatArray
    by_pixels: FloatArray

    def __call__(self, sums: Sums, step: FloatArray) -> FloatArray:
        """(p,) of a step (p,)."""
        pull = sums.jr[:, : len(step)].sum(axis=0)
        return np.asarray(self.by_step @ step - self.by_pixels @ pull)

    def toward(self, other: _Placing, share: float) -> _Placing:
        """A part of the way from this one to the other."""
        pairs = ((self.by_step, other.by_step), (self.by_pixels, other.by_pixels))
        return _Placing(*((1.0 - share) * mine + share * theirs for mine, theirs in pairs))

    def after(self, first: _Placing) -> _Placing:
        """This one of what the first gives."""
        return _Placing(
            self.by_step @ first.by_step, self.by_step @ first.by_pixels + self.by_pixels
        )


@dataclass(frozen=True, eq=False)
class _Frames:
    """Unknowns (p,) that place what stands in the base, and any camera or board.

    ``inexact`` are those that least squares may move: all but the intrinsics that are exact.
    """

    base: BoolArray
    every: BoolArray
    inexact: BoolArray

    @classmethod
    def of(cls, problem: Problem, unknowns: BoolArray, exact: BoolArray) -> _Frames:
        """Those of a problem's parameters that are estimated (n,); which are exact (n,)."""
        base, every = set[str](), set[str]()
        for term in problem.terms:
            assert isinstance(term, CameraView)
            eye, board, _ = term.owners
            base.add(board if term.setup == EYE_IN_HAND else eye)
            every |= {eye, board}
            if isinstance(term.board, SurveyedMarkers):
                every |= {p.owner for p in term.board.parameters(term.sees_board)}
        owners = np.array([parameter.owner for parameter in problem.parameters.values()])[unknowns]
        return cls(np.isin(owners, list(base)), np.isin(owners, list(every)), ~exact[unknowns])

    def placing(self, sums: Sums, model: ErrorModel) -> _Placing:
        """What a model makes of the generalised least squares."""
        p = len(self.base)
        nothing = _Placing(np.eye(p), np.zeros((p, p)))
        if not model.base_by_pixels:
            return nothing
        jj = sums.jj[:, :p, :p].sum(axis=0)
        frames = nothing.toward(_by_pixels(jj, self.every), model.share)
        part = frames.toward(_by_pixels(jj, self.inexact), model.camera_share)
        return _by_pixels(jj, self.base).after(part)


def choose_model(
    problem: Problem,
    rows: PictureRows,
    likelihood: Likelihood,
    eta: FloatArray,
    covariance: FloatArray,
    *,
    unknowns: BoolArray,
    exact: BoolArray,
) -> Chosen:
    """The model that predicts pictures left out, and its answer.

    Args:
        problem: of the pictures of every camera.
        rows: of their corners.
        likelihood: of ``rows``.
        eta: the levels.
        covariance: (p + shared, p + shared) of the generalised least squares at them.
        unknowns: (n,) which of the problem's parameters are among the p.
        exact: (n,) which of them are known so well that pixels must not bend them.
    """
    here, frames = likelihood.at(eta), _Frames.of(problem, unknowns, exact)
    step = here.step[: len(frames.base)]
    errors = _errors(rows, likelihood, eta, frames)
    model = MODELS[0]
    if errors:
        limit = min(
            AS_GOOD * errors[FRAMES_BY_PIXELS].left_out,
            AS_GOOD_AS_BENT * errors[MODELS[-1]].left_out,
        )
        model = next(model for model in MODELS if errors[model].left_out <= limit)
    placing = frames.placing(likelihood.sums, model)
    return Chosen(
        model,
        errors,
        placing(likelihood.sums, step) - step,
        _covariance(likelihood, eta, here, covariance, placing),
    )


def _by_pixels(jj: FloatArray, placed: BoolArray) -> _Placing:
    """The unknowns ``placed`` (p,) where the pixels are best, the others as they are.

    The reprojection errors have JᵀJ = jj (p, p).
    """
    mine = jj[np.ix_(placed, placed)]
    unit = 1.0 / np.sqrt(np.maximum(np.diag(mine), 1e-300))
    scale = np.outer(unit, unit)
    inverse = np.linalg.pinv(mine * scale, 1e-13, True) * scale
    by_step, by_pixels = np.diag((~placed).astype(float)), np.zeros_like(jj)
    by_step[placed] = -inverse @ np.where(placed, 0.0, jj[placed])
    by_pixels[np.ix_(placed, placed)] = inverse
    return _Placing(by_step, by_pixels)


def _errors(
    rows: PictureRows, likelihood: Likelihood, eta: FloatArray, frames: _Frames
) -> dict[ErrorModel, ReprojectionError]:
    """Errors of every model, of pictures that are fitted and that are left out."""
    hands = np.unique(np.concatenate([part.hand for part in rows.parts]))
    # Fewer poses of the hand leave too few to calibrate.
    if len(hands) < 6:
        return {}
    p = len(frames.base)
    fold = np.full(len(rows.shared), -1)
    fold[np.random.default_rng(SEED).permutation(hands)] = np.arange(len(hands)) % FOLDS
    power, weight = dict.fromkeys(MODELS, 0.0), 0.0
    for k in range(min(FOLDS, len(hands))):
        left = rows.at_hands(fold == k)
        rest = Likelihood(likelihood.sums.without(left.sums), likelihood.known)
        step = rest.at(eta).step[:p]
        for model in MODELS:
            more, count = left.squares(frames.placing(rest.sums, model)(rest.sums, step))
            power[model] += more
        weight += count
    sums, step = likelihood.sums, likelihood.at(eta).step[:p]
    errors = dict[ErrorModel, ReprojectionError]()
    for model in MODELS:
        fitted, count = rows.squares(frames.placing(sums, model)(sums, step))
        errors[model] = ReprojectionError(
            float(np.sqrt(fitted / count)), float(np.sqrt(power[model] / weight))
        )
    return errors


def _covariance(
    likelihood: Likelihood,
    eta: FloatArray,
    here: LikelihoodPoint,
    covariance: FloatArray,
    placing: _Placing,
) -> FloatArray:
    """Covariance (p, p) of the unknowns as they are placed.

    With errors e of the generalised least squares, C its inverse curvature, and n = Jᵀu the sums of
    the pixels' errors at the truth, theirs is ``M e - L n``: ``cov(e, n) = -C JᵀJ`` and
    ``cov(n) = Jᵀ (σ² + P D Pᵀ + P Φ S Φᵀ Pᵀ) J``.
    """
    p, cameras, sums = len(placing.by_step), likelihood.cameras, likelihood.sums
    covariance = covariance[:p, :p]
    if not placing.by_pixels.any():
        return covariance
    jj, levels = sums.jj.sum(axis=0), np.exp(2.0 * eta)
    pixels = np.tensordot(levels[:cameras], sums.jj[:, :p, :p], 1)
    hand = np.repeat(levels[cameras : cameras + 2], DIRECTIONS)
    by_hand = sums.pj.sum(axis=0)[:, :, :p]
    pixels += np.einsum("gcp,c,gcq->pq", by_hand, hand, by_hand, optimize=True)
    shared = jj[:p, p:] / np.sqrt(likelihood.known.at(np.sqrt(levels[cameras + 2 :]))[p:])
    pixels += shared @ shared.T
    M, L = placing.by_step, placing.by_pixels
    mixed = M @ here.covariance[:p, :p] @ jj[:p, :p] @ L.T
    return np.asarray(M @ covariance @ M.T + mixed + mixed.T + L @ pixels @ L.T)
