"""Residuals of corners in pictures: where a board's point is seen, less where it was found.

Own unknowns are the poses of camera and board (6 + 6), then the intrinsics and the board's stretch
(2) where they are free, or pose and size of a marker (6 + 1) where markers are; data are u v, the
point x y z, m/px, and the intrinsics where they are not; of a marker its corner x y, in its size
or in m, and whether its place and its size are unknown (0 or 1). An error is the length that it
covers at the board.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Final

import casadi as ca

from suta_calib.geometry.lens import Lens
from suta_calib.geometry.symbols import Symbol
from suta_calib.terms.block import Pose, Residual, pose_of
from suta_calib.terms.eye import point_in_eye
from suta_calib.terms.hand_eye_start import EyeSetup
from suta_calib.terms.length_scale import stretched_point

# Nearest that a point is taken to be to a camera while a solver looks for it, m.
NEAREST: Final = 1e-3


@cache  # What was compiled for a residual is found again by it.
def reprojection(
    setup: EyeSetup, lens: Lens, free: bool, stretched: bool, surveyed: bool = False
) -> Residual:
    """The residual of a corner.

    Args:
        setup: the eye is on the hand, or stands in the base.
        lens: of the eye.
        free: whether the intrinsics are unknown.
        stretched: whether the board's stretch is.
        surveyed: whether markers are.
    """
    # Largest error of a corner's coordinate, pixels: more says no more. A board that a wrong
    # reading puts behind the camera is nowhere in the picture, and a lens's polynomial has it
    # anywhere.
    farthest = 1e4

    def residual(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
        board, point = pose_of(unknowns[6:12]), data[2:5]
        if stretched:
            point = stretched_point(point, unknowns[-2:])
        if surveyed:
            marker, size, placed, sized = pose_of(unknowns[-7:-1]), unknowns[-1], data[-2], data[-1]
            corner = (sized * size + 1 - sized) * ca.vertcat(data[-4], data[-3], 0)
            moved = marker.R @ corner + marker.p
            point = point + placed * moved + (1 - placed) * corner
        beside = board.R @ point + board.p
        in_eye = point_in_eye(poses[0], pose_of(unknowns[0:6]), beside, setup)
        count = len(lens.names)
        intrinsics = unknowns[12 : 12 + count] if free else data[6 : 6 + count]
        depth = in_eye[2] if lens.sees_behind else ca.fmax(in_eye[2], NEAREST)
        u, v = lens.pixel_of(in_eye[0], in_eye[1], depth, intrinsics, ca.atan2)
        error = ca.vertcat(u - data[0], v - data[1])
        return data[5] * ca.fmax(-farthest, ca.fmin(error, farthest))

    return residual
