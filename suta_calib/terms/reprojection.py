"""Residuals of corners in pictures: where a board's point is seen, less where it was found.

Own unknowns are the poses of camera and board (6 + 6), then the intrinsics (9) and the board's
stretch (2) where they are free;
data are u v, the point x y z, m/px, and the intrinsics where they are not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import casadi as ca

from suta_calib.geometry.pinhole import pixel_of
from suta_calib.geometry.symbols import Symbol
from suta_calib.terms.block import Pose, Residual, pose_of
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EYE_TO_HAND, EyeSetup
from suta_calib.terms.stretch import stretched_point

# Nearest that a point is taken to be to a camera while a solver looks for it, m.
NEAREST: Final = 1e-3


def _reprojection(in_eye: Symbol, intrinsics: Symbol, data: Symbol) -> Symbol:
    """Error of a corner, as the length that it covers at the board; data: u v x y z m/px."""
    # Largest error of a corner's coordinate, pixels: more says no more. A board that a wrong
    # reading puts behind the camera is nowhere in the picture, and a lens's polynomial has it
    # anywhere.
    farthest = 1e4
    depth = ca.fmax(in_eye[2], NEAREST)
    u, v = pixel_of(in_eye[0], in_eye[1], depth, intrinsics)
    error = ca.vertcat(u - data[0], v - data[1])
    return data[5] * ca.fmax(-farthest, ca.fmin(error, farthest))


def _seen_from_hand(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    """The board's point in an eye on the hand."""
    in_hand = poses[0].inverse_act(_on_board(unknowns, data))
    return pose_of(unknowns[0:6]).inverse_act(in_hand)


def _seen_from_base(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    """The point of a board on the hand in an eye that stands."""
    in_base = poses[0].R @ _on_board(unknowns, data) + poses[0].p
    return pose_of(unknowns[0:6]).inverse_act(in_base)


def _on_board(unknowns: Symbol, data: Symbol) -> Symbol:
    board = pose_of(unknowns[6:12])
    return board.R @ data[2:5] + board.p


# Every residual is a function of its own: what was compiled for it is found again by it.
def _known_in_hand(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    return _reprojection(_seen_from_hand(poses, unknowns, data), data[6:15], data)


def _known_beside(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    return _reprojection(_seen_from_base(poses, unknowns, data), data[6:15], data)


def _unknown_in_hand(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    return _reprojection(_seen_from_hand(poses, unknowns, data), unknowns[12:21], data)


def _unknown_beside(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    return _reprojection(_seen_from_base(poses, unknowns, data), unknowns[12:21], data)


def _stretched(unknowns: Symbol, data: Symbol) -> tuple[Symbol, Symbol]:
    """Own unknowns without the board's stretch, and data with the point where it makes it."""
    made = stretched_point(data[2:5], unknowns[-2:])
    return unknowns[:-2], ca.vertcat(data[0:2], made, data[5:])


def _known_in_hand_stretched(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    return _known_in_hand(poses, *_stretched(unknowns, data))


def _known_beside_stretched(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    return _known_beside(poses, *_stretched(unknowns, data))


def _unknown_in_hand_stretched(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    return _unknown_in_hand(poses, *_stretched(unknowns, data))


def _unknown_beside_stretched(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    return _unknown_beside(poses, *_stretched(unknowns, data))


# By where the eye is, whether its intrinsics are unknown, and whether the board's stretch is.
REPROJECTION: Final[Mapping[tuple[EyeSetup, bool, bool], Residual]] = {
    (EYE_IN_HAND, False, False): _known_in_hand,
    (EYE_IN_HAND, True, False): _unknown_in_hand,
    (EYE_TO_HAND, False, False): _known_beside,
    (EYE_TO_HAND, True, False): _unknown_beside,
    (EYE_IN_HAND, False, True): _known_in_hand_stretched,
    (EYE_IN_HAND, True, True): _unknown_in_hand_stretched,
    (EYE_TO_HAND, False, True): _known_beside_stretched,
    (EYE_TO_HAND, True, True): _unknown_beside_stretched,
}
