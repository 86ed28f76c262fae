"""Bundle adjustment: unknowns that all pictures share, and a pose that each picture has of its own.

All reprojection errors are minimised together by Levenberg and Marquardt; the poses are eliminated
from every step (Schur).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray

Unknowns = TypeVar("Unknowns")


@dataclass(frozen=True, eq=False)
class EliminatedPoses:
    """Normal equations of what pictures share, with the pose of each picture eliminated.

    Attributes:
        curvature: (g, g) of the shared unknowns.
        slope: (g,) of these.
        of_picture: (n, g, g) and (n, g): what each picture has added to either.
        back: (n, 6) and (n, 6, g): step of each pose, and by that of the shared unknowns.
    """

    curvature: FloatArray
    slope: FloatArray
    of_picture: tuple[FloatArray, FloatArray]
    back: tuple[FloatArray, FloatArray]

    def step(self) -> tuple[FloatArray, FloatArray]:
        """(g,) and (n, 6) that lead to the minimum of these equations."""
        shared = -np.linalg.lstsq(self.curvature, self.slope, rcond=None)[0]
        return np.asarray(shared), self.back[0] + self.back[1] @ shared


@dataclass(frozen=True, eq=False)
class PictureEquations:
    """Normal equations of n pictures.

    Attributes:
        AA: (n, g, g) of what they share.
        AB: (n, g, 6) of that and their poses.
        BB: (n, 6, 6) of their poses.
        a: (n, g) slopes of what they share.
        b: (n, 6) of their poses.
        prior: (g, g) information on what they share.
        away: (g,) how far that is from what the prior says.
    """

    AA: FloatArray
    AB: FloatArray
    BB: FloatArray
    a: FloatArray
    b: FloatArray
    prior: FloatArray
    away: FloatArray

    def eliminated(self, damping: float = 0.0) -> EliminatedPoses:
        """The equations without the poses; ``damping`` of Marquardt."""
        damped = self.BB + damping * np.einsum("nii->ni", self.BB)[..., None] * np.eye(6)
        solved = np.linalg.pinv(damped, hermitian=True)
        AA = self.AA - np.einsum("nij,njk,nlk->nil", self.AB, solved, self.AB)
        a = self.a - np.einsum("nij,njk,nk->ni", self.AB, solved, self.b)
        undamped = self.AA.sum(axis=0) + self.prior
        return EliminatedPoses(
            AA.sum(axis=0) + self.prior + damping * np.diag(np.diag(undamped)),
            a.sum(axis=0) + self.prior @ self.away,
            (AA, a),
            (
                -np.einsum("nij,nj->ni", solved, self.b),
                -np.einsum("nij,nlj->nil", solved, self.AB),
            ),
        )


class Bundle(ABC, Generic[Unknowns]):
    """What was seen in pictures, and how errors follow from the unknowns."""

    @abstractmethod
    def errors(self, at: Unknowns) -> FloatArray | None:
        """(…, k, 2) px, zero of what was not found; None where a corner is behind a camera."""

    @abstractmethod
    def weights(self, errors: FloatArray) -> FloatArray:
        """(…, k) of the corners, 1/px²."""

    @abstractmethod
    def away(self, at: Unknowns) -> tuple[FloatArray, FloatArray]:
        """Information (g, g) on the shared unknowns, and how far (g,) they are from it."""

    @abstractmethod
    def equations(self, at: Unknowns, errors: FloatArray, weight: FloatArray) -> PictureEquations:
        """The equations of a step from here."""

    @abstractmethod
    def moved(self, at: Unknowns, shared: FloatArray, poses: FloatArray) -> Unknowns:
        """After a step of the shared unknowns (g,) and of the poses (n, 6)."""

    def cost(self, at: Unknowns, errors: FloatArray, weight: FloatArray) -> float:
        """Weighted sum of squares, with that of the priors."""
        prior, away = self.away(at)
        return float(np.sum(weight[..., None] * errors**2)) + float(away @ prior @ away)

    def minimised(self, start: Unknowns, settled: float) -> Unknowns:
        """The unknowns of least error; ``settled`` is the relative gain from where on it ends."""
        # Damping from where on no step helps.
        stuck, damping = 1e8, 1e-3
        at, errors = start, self.errors(start)
        if errors is None:
            return at
        for _ in range(60):
            weight = self.weights(errors)
            before = self.cost(at, errors, weight)
            equations = self.equations(at, errors, weight)
            while damping < stuck:
                trial = self.moved(at, *equations.eliminated(damping).step())
                trial_errors = self.errors(trial)
                if trial_errors is not None:
                    after = self.cost(trial, trial_errors, weight)
                    if after < before:
                        break
                damping *= 10.0
            else:
                return at
            at, errors, damping = trial, trial_errors, damping / 10.0
            if before - after <= settled * before:
                break
        return at


def corner_weights(errors: FloatArray, there: BoolArray, *, robust: bool) -> FloatArray:
    """(…, k) of the corners of a camera, 1/px², by their own scatter.

    ``robust`` lets corners that are far off pull no harder than others.
    """
    # Distance of a corner, in their scatter, from where on it pulls no harder; the scatter of
    # normal ones in their middle distance; and the least one, px, which is rounding.
    far, middle, finest = 3.0, 1.1774, 1e-3
    length = np.linalg.norm(errors, axis=-1)
    sigma = max(float(np.median(length[there])) / middle, finest)
    pull = np.minimum(1.0, far * sigma / np.maximum(length, finest * sigma))
    return np.where(there, pull if robust else 1.0, 0.0) / sigma**2
