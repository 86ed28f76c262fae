"""Whose noise turns the residuals of a hand-eye calibration: the hand's or the eye's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements.samples import Samples
from suta_calib.model.parameters import PLACEMENT
from suta_calib.pose_calibration.consensus import Consensus, some_rows
from suta_calib.pose_calibration.robust_fit import RobustFit, parts_of, robust_fit
from suta_calib.solver.kernel import term_residuals
from suta_calib.terms.block import Noise
from suta_calib.terms.hand_eye import HandEye
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.terms.poses import MeasuredPoses

# Before the data are asked: anything from none to all.
EXPECTED: Final = 0.5
SPREAD: Final = 0.29
UNKNOWNS: Final = 12
# What the pose of the eye in the hand is called among the unknowns.
EYE: Final = HandEye.frames[0].own


def estimate_robot_noise_fraction(position: FloatArray, swept: FloatArray) -> float:
    """Part of the rotational noise, as a variance, that is the hand's; between 0 and 1.

    A turn of the hand moves the target by turn x lever, seen from the eye; a turn of what the eye
    sees does not. The regression of one on the other is the fraction, shrunk towards one half where
    few poses tell little.

    ``position`` (n, 3) are residuals of the target's position in the eye, ``swept`` the turn in
    each residual times the lever from hand to target, in the same unit.
    """
    told, against = float(np.sum(swept**2)), float(np.sum(swept * position))
    if told == 0.0:
        return EXPECTED
    fraction = against / told
    freedom = max(position.size - UNKNOWNS / 2, 1.0)
    prior = float(np.sum((position - fraction * swept) ** 2)) / freedom / SPREAD**2
    return float(np.clip((against + EXPECTED * prior) / (told + prior), 0.0, 1.0))


class RobotNoise:
    """How much of the rotational noise is the hand's, revised with the solution.

    Args:
        hand, seen: rotations (n, 3, 3) and positions (n, 3) of both, in units of the problem.
        finest_turn: noise of a turn, rad, that is assumed at least.

    Attributes:
        fraction: of the rotational noise that is the hand's, as `make` takes it.
    """

    def __init__(self, hand: Poses, seen: Poses, finest_turn: float) -> None:
        self._seen, self._finest = seen, finest_turn
        nothing = np.zeros((len(hand[1]), 0))
        samples = Samples.from_arrays([], nothing, position=seen[1], rotation=seen[0])
        self._poses = parts_of(MeasuredPoses(*hand, samples))
        self.fraction = EXPECTED

    def make(self, rows: IntArray, noises: Sequence[Noise]) -> HandEye:
        """The term over some rows."""
        return self._term(rows, noises, self.fraction)

    def revise(self, values: Mapping[str, float], inliers: BoolArray) -> None:
        """Estimate the fraction from the inliers' residuals at the values found."""
        rows = np.flatnonzero(inliers)
        at_target = term_residuals(self._term(rows, (Noise(), Noise()), 0.0), values)
        x = np.array([values[f"{EYE}.{key}"] for key in PLACEMENT])
        R_seen, p_seen = self._seen[0][rows], self._seen[1][rows]
        in_eye = np.einsum("nij,nj->ni", R_seen, at_target[1])
        lever = p_seen + rotation_from_vector(x[3:]).T @ x[:3]
        self.fraction = estimate_robot_noise_fraction(at_target[0], np.cross(in_eye, lever))

    def explains(self, fit: RobustFit) -> bool:
        """Whether the residuals at the target grew no more by it than by chance.

        Some of many pairs tell. Neighbours may err alike, so that a pair is one witness of places
        and one of turns.
        """
        rows = np.flatnonzero(fit.inliers)
        rows = rows[some_rows(len(rows))]
        plain = robust_fit(
            lambda r, n: self._term(rows[r], n, 0.0),
            Consensus.of_all(len(rows), *fit.sigmas),
            (0.0, self._finest),
            robust=False,
        )
        term = self._term(rows, (Noise(), Noise()), 0.0)
        with_robot_noise = [float(np.sum(r**2)) for r in term_residuals(term, fit.solution.values)]
        without = [float(np.sum(r**2)) for r in plain.residuals]
        allowed = 1.0 + 2.5 * UNKNOWNS / max(2 * len(rows) - UNKNOWNS, 1)
        return all(w <= allowed * p for w, p in zip(with_robot_noise, without, strict=True))

    def _term(self, rows: IntArray, noises: Sequence[Noise], fraction: float) -> HandEye:
        return HandEye(self._poses(rows), noises[0], noises[1], robot_noise_fraction=fraction)
