"""Pose X of an eye and pose Z of its target, with their covariance; from poses or pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Level
from suta_calib.geometry.numbers import rpy_from_rotation, skew
from suta_calib.pose_calibration.robust_answer import exchanged
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EYE_TO_HAND, EyeSetup
from suta_calib.trust.uncertainty_budget import UncertaintyBudget
from suta_calib.units import deg, from_deg, mm, std_text

Model = Literal["AX=XB", "AX=ZB"]
Unknown = Literal["X", "Z"]
# What X and Z are, by where the eye is.
FRAMES: Final[dict[EyeSetup, dict[Unknown, str]]] = {
    EYE_IN_HAND: {"X": "T_hand_eye", "Z": "T_base_target"},
    EYE_TO_HAND: {"X": "T_base_eye", "Z": "T_hand_target"},
}
# Pairs or pictures below which a standard deviation is hardly more than a guess.
ENOUGH: Final = 12


def unknowns_of(model: Model) -> tuple[Unknown, ...]:
    """Which of X and Z a model asks for."""
    return ("X", "Z") if model == "AX=ZB" else ("X",)


class PoseAccuracy:
    """How well a pose is known, in words.

    Attributes:
        std6: (6,) standard deviations: displacement, m, and turn, rad.
    """

    std6: FloatArray

    def unsure(self, what: str = "X") -> str:
        """Beginning of a sentence about a large uncertainty; empty if the pose is well known."""
        displaced, turned = self.displaced_turned
        # Beyond these more poses are asked for.
        if displaced <= 2e-3 and turned <= from_deg(0.5):
            return ""
        return f"{what} is known to {self.within} only (one standard deviation)"

    @property
    def within(self) -> str:
        """Its standard deviations."""
        displaced, turned = self.displaced_turned
        return f"± {std_text(displaced, 'm')} and ± {std_text(turned, 'rad')}"

    @property
    def displaced_turned(self) -> tuple[float, float]:
        """Standard deviations of the position, m, and turn, rad, each over three axes."""
        displaced, turned = np.linalg.norm(self.std6.reshape(2, 3), axis=1)
        return float(displaced), float(turned)


class AccuracyOfX(PoseAccuracy):
    """That of the pose X whose covariance an answer has.

    Attributes:
        covariance: (6, 6) displacement, m, and turn, rad.
    """

    covariance: FloatArray

    @property
    def std(self) -> FloatArray:
        """(6,) standard deviations of X: displacement, m, and turn, rad."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def std6(self) -> FloatArray:  # type: ignore[override]
        """Of X."""
        return self.std


@dataclass(frozen=True, eq=False)
class PoseBetween(PoseAccuracy):
    """Where an eye is in another one.

    Attributes:
        name: of the eye.
        inside: of the one in which it is.
        pose: (4, 4), m.
        std6: (6,) displacement, m, axes of the one in which it is; turn, rad, its own axes.
        budgets: what these are made of, where the answer tells it.
    """

    name: str
    inside: str
    pose: FloatArray
    std6: FloatArray
    budgets: tuple[UncertaintyBudget, ...] = ()


def relative_pose(
    first: FloatArray, second: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """``T_first_second`` (4, 4) of two poses in one frame, m, and its covariance (6, 6).

    Args:
        first: pose (4, 4), m.
        second: another one.
        covariance: (12, 12) of both: displacement (m, outer axes) and turn (rad, own axes).
    """
    between = np.linalg.inv(first) @ second
    R_first, R_second = first[:3, :3], second[:3, :3]
    jacobian = np.zeros((6, 12))
    jacobian[:3, :3], jacobian[:3, 6:9] = -R_first.T, R_first.T
    jacobian[:3, 3:6] = skew(between[:3, 3])
    jacobian[3:, 3:6] = -R_second.T @ R_first
    jacobian[3:, 9:] = np.eye(3)
    return between, np.asarray(jacobian @ covariance @ jacobian.T)


def placed_points(
    carrier: FloatArray, X: FloatArray, covariance: FloatArray, points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Points (k, 3) of an eye outside what carries it, m, and their standard deviations by X's.

    Args:
        carrier: (4, 4) pose of what carries the eye, m.
        X: (4, 4) pose of the eye in it, m.
        covariance: (6, 6) of X: displacement (m, outer axes) and small turn (rad, eye's axes).
        points: in the eye, m.
    """
    R, turn = carrier[:3, :3], X[:3, :3]
    place = (points @ turn.T + X[:3, 3]) @ R.T + carrier[:3, 3]
    by_turn = -np.einsum("ij,njk->nik", R @ turn, skew(points))
    slope = np.concatenate([np.broadcast_to(R, by_turn.shape), by_turn], axis=2)
    variance = np.einsum("nij,jk,nik->ni", slope, covariance, slope)
    return np.asarray(place), np.asarray(np.sqrt(variance))


class EyePoses(PoseAccuracy):
    """X and Z of an answer.

    Attributes:
        setup: ``eye-in-hand`` or ``eye-to-hand``.
        X: (4, 4), ``T_hand_eye``, or ``T_base_eye`` for eye-to-hand; m.
        Z: (4, 4), ``T_base_target``, or ``T_hand_target`` for eye-to-hand; m.
        covariance: (12, 12) of X and Z: displacement (m, outer frame's axes) and small turn (rad,
            axes of the eye and of the target) of each.
    """

    setup: EyeSetup
    X: FloatArray
    Z: FloatArray
    covariance: FloatArray

    @property
    def std(self) -> dict[Unknown, FloatArray]:
        """Standard deviations (6,) of X and of Z: displacement, m, and turn, rad."""
        std = np.sqrt(np.diag(self.covariance))
        return {"X": std[:6], "Z": std[6:]}

    @property
    def inverted(self) -> Level:
        """Whether the poses seem to be inverted, which exchanges X and Z: ``good`` if not."""
        places = [self.X[:3, 3], self.Z[:3, 3]]
        held, standing = places if self.setup == EYE_IN_HAND else places[::-1]
        std = np.concatenate([self.std["X"][:3], self.std["Z"][:3]])
        return exchanged(held, standing, float(np.linalg.norm(std)))

    @property
    def lengths_told(self) -> str:
        """A sentence with the lengths that suggest that X and Z are exchanged."""
        X, Z = (mm(float(np.linalg.norm(T[:3, 3]))) for T in (self.X, self.Z))
        return (
            f"X is {X:.0f} mm long and Z {Z:.0f} mm: the device on the hand is farther from it "
            "than the fixed one from the base."
        )

    @property
    def Z_told(self) -> str:
        """Z in words: what X would be if the two were exchanged."""
        place, turn = mm(self.Z[:3, 3]), deg(rpy_from_rotation(self.Z[:3, :3]))
        return (
            f"position ({', '.join(f'{v:.1f}' for v in place)}) mm, roll pitch yaw "
            f"({', '.join(f'{v:.2f}' for v in turn)})°"
        )

    @property
    def std6(self) -> FloatArray:  # type: ignore[override]
        """Of X."""
        return self.std["X"]

    @property
    def accuracy_text(self) -> str:
        """Beginning of a sentence with the standard deviations of X."""
        return f"X is known to {self.within} (one standard deviation, 3-D)"
