"""The corners of every camera about one point, their sums over pictures, and their errors.

What poses of the hand share is one more set of unknowns: ``e_i = F_i b`` (`shared_errors`). Corners
know of it only by their hand's pose, so that its sums follow from those of the pictures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Final, Self

import numpy as np
from scipy.special import chdtri

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.model.parameters import PLACEMENT
from suta_calib.pose_calibration.correlation import DIRECTIONS, WAYS
from suta_calib.pose_calibration.picture_likelihood import LikelihoodPoint, Sums
from suta_calib.solver.compiled_residual import dense
from suta_calib.solver.losses import huber_weight
from suta_calib.solver.problem import Problem
from suta_calib.terms import CameraView
from suta_calib.terms.camera_alone import CameraState, PicturesSeen, refined
from suta_calib.terms.intrinsics import HELD

# No corner is found more finely, px: what is smaller is rounding.
FINEST: Final = 1e-3


@dataclass(frozen=True, eq=False)
class CameraRows:
    """Corners of one camera.

    Attributes:
        hand: (n,) pose of the hand at which each was seen.
        residual: (n, 2) px.
        jacobian: (n, 2, p) by the unknowns.
        by_pose: (n, 2, 6) by the hand's pose, px per m and rad.
        weight: (n,) how much each is believed.
    """

    hand: IntArray
    residual: FloatArray
    jacobian: FloatArray
    by_pose: FloatArray
    weight: FloatArray


@dataclass(frozen=True, eq=False)
class LensSums:
    """Number, JᵀJ (p, p), Jᵀr (p,) and rᵀr of corners, less what the board's poses take up."""

    count: float
    jj: FloatArray
    jr: FloatArray
    rr: float


@dataclass(frozen=True, eq=False)
class LensPictures:
    """Pictures of one camera whose hand is not believed: their corners tell its lens alone.

    Attributes:
        owner: of the camera's intrinsics.
        pictures: what was seen.
        start: where the board is in each.
    """

    owner: str
    pictures: PicturesSeen
    start: CameraState

    def about(self, names: Sequence[str], x: FloatArray, free: IntArray, width: int) -> LensSums:
        """At parameters x, by the first of ``width`` unknowns, which are the free ones."""
        jj, jr = np.zeros((width, width)), np.zeros(width)
        keys = [f"{self.owner}.{key}" for key in self.pictures.lens.names]
        if keys[0] not in names:
            return LensSums(0.0, jj, jr, 0.0)
        at = np.array([names.index(key) for key in keys])
        start = replace(self.start, intrinsics=x[at])
        state = refined(self.pictures, start, np.full(len(at), HELD), robust=False)
        state = replace(state, intrinsics=x[at])
        errors = self.pictures.errors(state)
        if errors is None:
            return LensSums(0.0, jj, jr, 0.0)
        A, B = (J.reshape(len(J), -1, J.shape[-1]) for J in self.pictures.slopes(state))
        both = np.concatenate([A, errors.reshape(len(A), -1, 1)], axis=2)
        both = (both - B @ (np.linalg.pinv(B) @ both)).reshape(-1, both.shape[2])
        estimated = np.isin(at, free)
        columns = np.searchsorted(free, at[estimated])
        J, r = both[:, :-1][:, estimated], both[:, -1]
        jj[np.ix_(columns, columns)], jr[columns] = J.T @ J, J.T @ r
        count = 2.0 * self.pictures.there.sum() - WAYS * len(B)
        return LensSums(float(count), jj, jr, float(r @ r))


@dataclass(frozen=True, eq=False)
class PictureRows:
    """Corners of all cameras.

    Attributes:
        parts: of each camera.
        shared: (poses of the hand, 6, k) F of what they share; k may be 0.
        lenses: of each camera what tells its lens alone; None of where there is nothing.
    """

    parts: tuple[CameraRows, ...]
    shared: FloatArray
    lenses: tuple[LensSums | None, ...]

    @classmethod
    def about(
        cls,
        problem: Problem,
        x: FloatArray,
        free: IntArray,
        hands: IntArray,
        shared: FloatArray,
        boards: Sequence[str] = (),
        weights: Sequence[FloatArray] | None = None,
        lenses: Sequence[LensPictures | None] = (),
    ) -> Self:
        """Linearise at parameters x, by those that are free and by the sizes of ``boards``.

        Each sample has a pose of the hand, by number; corners of each camera have weights or 1.
        Pictures of ``lenses``, one of each camera, tell its lens alone.
        """
        parts = []
        lines = problem.linearise(x, problem.assumed_sigmas())
        for k, (term, line) in enumerate(zip(problem.terms, lines, strict=True)):
            assert isinstance(term, CameraView)
            _, by_unknowns = problem.evaluation.columns(line, line.by_pose, line.by_own)
            every = dense(by_unknowns).reshape(*line.residual.shape, -1)
            jacobian = every[:, :, free]
            if boards:
                larger = _by_size(problem, term, every, x)
                mine = [np.where(term.target == board, larger, 0.0) for board in boards]
                jacobian = np.concatenate([jacobian, np.stack(mine, axis=2)], axis=2)
            parts.append(
                CameraRows(
                    hands[line.view.block.samples[:, 0] + line.view.first_sample],
                    line.residual / term.pixel,
                    jacobian / term.pixel,
                    # The pose may be any: all six ways show in every corner.
                    line.by_pose / term.pixel,
                    np.ones(len(line.residual)) if weights is None else weights[k],
                )
            )
        width = len(free) + len(boards)
        of_lens = [
            alone.about(problem.names, x, free, width) if alone else None
            for alone in lenses or [None] * len(parts)
        ]
        return cls(tuple(parts), shared, tuple(of_lens))

    def at_hands(self, chosen: BoolArray) -> PictureRows:
        """The corners seen at some poses of the hand (poses,)."""
        parts = tuple(
            CameraRows(*(getattr(part, field.name)[chosen[part.hand]] for field in fields(part)))
            for part in self.parts
        )
        return PictureRows(parts, self.shared, (None,) * len(parts))

    @property
    def sums(self) -> Sums:
        """Over the corners, each weighed; unknowns, then what poses share."""
        groups, by_camera = len(self.shared), []
        for part, lens in zip(self.parts, self.lenses, strict=True):
            r, J, P, w = part.residual, part.jacobian, part.by_pose, part.weight
            wr, wJ, wP = w[:, None] * r, w[:, None, None] * J, w[:, None, None] * P
            pj = np.zeros((groups, WAYS, J.shape[2]))
            pr, pp = np.zeros((groups, WAYS)), np.zeros((groups, WAYS, WAYS))
            np.add.at(pj, part.hand, np.swapaxes(P, 1, 2) @ wJ)
            np.add.at(pr, part.hand, np.einsum("ndc,nd->nc", P, wr))
            np.add.at(pp, part.hand, np.swapaxes(P, 1, 2) @ wP)
            flat, width = wJ.reshape(-1, J.shape[2]), J.shape[2]
            jj, jr = J.reshape(-1, width).T @ flat, flat.T @ r.reshape(-1)
            # Rounding of this size is always there.
            power, count = float(np.sum(wr * r)) + r.size * FINEST**2, float(r.size)
            if lens is not None:
                jj, jr, power, count = (
                    jj + lens.jj,
                    jr + lens.jr,
                    power + lens.rr,
                    count + lens.count,
                )
            jj, jr, pj = self._with_shared(jj, jr, pj, pr, pp)
            by_camera.append((count, jj, jr, power, pj, pr, pp))
        return Sums(*map(np.array, zip(*by_camera, strict=True)))

    def _with_shared(
        self, jj: FloatArray, jr: FloatArray, pj: FloatArray, pr: FloatArray, pp: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The first three with what poses share."""
        F = self.shared
        if not F.shape[2]:
            return jj, jr, pj
        by_shared = pp @ F
        flat, wide = F.reshape(-1, F.shape[2]), by_shared.reshape(-1, F.shape[2])
        across = pj.reshape(-1, pj.shape[2]).T @ flat
        jj = np.block([[jj, across], [across.T, flat.T @ wide]])
        jr = np.concatenate([jr, flat.T @ pr.reshape(-1)])
        return jj, jr, np.concatenate([pj, by_shared], axis=2)

    def beliefs(self, here: LikelihoodPoint, sigmas: FloatArray) -> list[FloatArray]:
        """Huber's weight of every corner, with the hand where its picture puts it."""
        weights = []
        for part, sigma in zip(self.parts, sigmas, strict=True):
            unknowns = part.jacobian.shape[2]
            off = self.shared @ here.step[unknowns:] - here.poses
            error = part.residual + part.jacobian @ here.step[:unknowns]
            error = error + np.einsum("ndc,nc->nd", part.by_pose, off[part.hand])
            # Distance of a corner from where it belongs, in its scatter, that one in a hundred good
            # ones has: what is farther off pulls no harder.
            weights.append(huber_weight(np.sum(error**2, axis=1) / sigma**2, np.array(3.03)))
        return weights

    def squares(self, step: FloatArray) -> tuple[float, float]:
        """Sum of the squared errors of all corners, px², at a step of the unknowns; their weight.

        The hand is taken to be where it says.
        """
        power = weight = 0.0
        for part in self.parts:
            off = part.residual + part.jacobian @ step
            power += float(part.weight @ np.sum(off**2, axis=1))
            weight += float(part.weight.sum())
        return power, weight


def _by_size(problem: Problem, term: CameraView, every: FloatArray, x: FloatArray) -> FloatArray:
    """(n, 2) derivative of the residuals by the logarithm of the size of a term's board.

    A point of it moves as the whole board would if it were pushed along the way from its origin:
    ``every`` (n, 2, p) is the derivative by all unknowns x (p,).
    """
    owner = term.owners[1]
    at = [problem.names.index(f"{owner}.{key}") for key in PLACEMENT]
    turn = rotation_from_vector(x[at[3:]])
    _, point = term.detected
    return np.asarray(
        np.einsum("nda,na->nd", every[:, :, at[:3]], term.pictures.points[point] @ turn.T)
    )


@dataclass(frozen=True, eq=False)
class PictureErrors:
    """Reprojection errors of a camera's pictures at some values, and what is asked of them.

    Attributes:
        residual: (m, 2) of every corner, px.
        picture: (m,) that it is in.
        by_pose: (m, 2, 6) derivative by the hand's pose, px per m and rad.
        count: of pictures.
    """

    residual: FloatArray
    picture: IntArray
    by_pose: FloatArray
    count: int

    @cached_property
    def rms(self) -> FloatArray:
        """(count,) root mean square error of the corners of each picture, px."""
        squared = np.sum(self.residual**2, axis=1)
        corners = np.bincount(self.picture, minlength=self.count)
        return np.asarray(np.sqrt(np.bincount(self.picture, squared, self.count) / corners))

    def _posed(self, k: np.intp) -> tuple[FloatArray, FloatArray]:
        """Pose (6,) that a picture gives the hand, to first order, and the residuals it leaves."""
        mine = self.picture == k
        residual = self.residual[mine].ravel()
        matrix = self.by_pose[mine].reshape(len(residual), WAYS)
        pose = np.linalg.lstsq(matrix, residual, rcond=None)[0]
        return pose, residual - matrix @ pose

    @cached_property
    def by_hand(self) -> FloatArray:
        """(count, 2) by how much each picture has the hand off, to first order: m and rad."""
        displacement = np.zeros((self.count, 2))
        for k in np.unique(self.picture):
            displacement[k] = np.linalg.norm(self._posed(k)[0].reshape(2, DIRECTIONS), axis=1)
        return displacement

    def scatter(self, good: BoolArray) -> float:
        """Of one component, px, by the middle one of the errors in pictures that are believed."""
        middle = float(np.median(np.linalg.norm(self.residual[good[self.picture]], axis=1)))
        # Half of all pairs of unit normal components are longer.
        return max(middle / float(np.sqrt(chdtri(2, 0.5))), FINEST)

    def alone(self, good: BoolArray) -> float:
        """RMS, px, that is left where every picture may have a pose of its own, to first order."""
        rests = [self._posed(k)[1] for k in np.flatnonzero(good)]
        freedom = sum(max(len(rest) - WAYS, 0) for rest in rests)
        left = sum(float(rest @ rest) for rest in rests)
        return float(np.sqrt(2.0 * left / freedom)) if freedom else float("nan")


def picture_errors(term: CameraView, values: Mapping[str, float]) -> PictureErrors:
    """Of all pictures, whether they were fitted or not, at parameter values by name."""
    problem = Problem([term])
    x = np.array([values[name] for name in problem.names])
    (line,) = problem.linearise(x, problem.assumed_sigmas())
    picture = term.blocks[0].samples[:, 0]
    # The pose may be any: all six ways show in every corner.
    by_pose = line.by_pose / term.pixel
    return PictureErrors(line.residual / term.pixel, picture, by_pose, len(term.poses))
