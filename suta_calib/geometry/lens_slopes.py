"""Derivatives of pixels, by CasADi: of any lens, from its one formula."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.lens import Lens


def pixel_slopes(
    lens: Lens, points: FloatArray, intrinsics: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Derivatives of pixels by the points (..., 2, 3) and by the intrinsics (..., 2, n).

    Args:
        lens: of the camera.
        points: (..., 3) in the camera's frame, m, that the lens can see.
        intrinsics: (n,) in the order of `Lens.names`.
    """
    shape, n = points.shape[:-1], int(np.prod(points.shape[:-1]))
    width = len(lens.names)
    if not n:
        return np.zeros((*shape, 2, 3)), np.zeros((*shape, 2, width))
    flat = _slopes(lens).map(n)(points.reshape(-1, 3).T, np.tile(intrinsics[:, None], n))
    both = np.asarray(flat).T.reshape(*shape, 3 + width, 2)
    both = np.swapaxes(both, -1, -2)
    return both[..., :3], both[..., 3:]


@cache
def _slopes(lens: Lens) -> ca.Function:
    point, values = ca.SX.sym("point", 3), ca.SX.sym("values", len(lens.names))
    pixel = ca.vertcat(*lens.pixel_of(point[0], point[1], point[2], ca.vertsplit(values), ca.atan2))
    slopes = ca.densify(ca.jacobian(pixel, ca.vertcat(point, values)))
    return ca.Function("slopes", [point, values], [slopes])
