"""A point as an eye sees it: one on the hand, or one that stands beside the arm."""

from __future__ import annotations

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.symbols import Symbol
from suta_calib.model.parameters import End
from suta_calib.terms.block import Pose
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EYE_TO_HAND, EyeSetup, Poses, inverse_poses


def carriers(setup: EyeSetup) -> tuple[End, End]:
    """The end of the arm that carries the eye, and the one that carries what it sees."""
    return ("tip", "base") if setup == EYE_IN_HAND else ("base", "tip")


def point_in_eye(hand: Pose, eye: Pose, point: Symbol, setup: EyeSetup) -> Symbol:
    """Coordinates (3,) in the eye of a point of what does not carry it: base, or hand.

    Args:
        hand: ``T_base_hand``.
        eye: in what carries it.
        point: (3,) in the base for an eye on the hand, else in the hand, m.
        setup: where the eye is.
    """
    by_carrier = hand.inverse_act(point) if setup == EYE_IN_HAND else hand.R @ point + hand.p
    return eye.inverse_act(by_carrier)


def points_in_eye(hand: Poses, eye: Poses, points: FloatArray, setup: EyeSetup) -> FloatArray:
    """`point_in_eye` of numbers: points (n, 3), one for each pose of the hand."""
    rotation, position = hand if setup == EYE_TO_HAND else inverse_poses(hand)
    turned = np.einsum("nij,nj->ni", rotation, points)
    return np.asarray((turned + position - eye[1]) @ eye[0])


def point_outside(hand: Pose, eye: Pose, point: Symbol, setup: EyeSetup) -> Symbol:
    """The inverse of `point_in_eye`: from the eye to what does not carry it."""
    by_carrier = eye.R @ point + eye.p
    return hand.R @ by_carrier + hand.p if setup == EYE_IN_HAND else hand.inverse_act(by_carrier)
