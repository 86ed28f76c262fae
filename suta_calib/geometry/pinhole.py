"""The pinhole camera with radial and tangential distortion, as OpenCV and ROS have it (plumb_bob).

Brown (1971); the names, their order and the equations are those of OpenCV's ``calib3d``. A pixel's
centre has whole coordinates: the centre of the first one is at 0, 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray

# Intrinsics in the order in which they stand everywhere: the first four in px, the others 1.
FOCAL: Final = ("fx", "fy")
CENTRE: Final = ("cx", "cy")
DISTORTION: Final = ("k1", "k2", "p1", "p2", "k3")
INTRINSICS: Final = (*FOCAL, *CENTRE, *DISTORTION)


def distorted(x: Any, y: Any, coefficients: Any) -> tuple[Any, Any]:
    """Where a lens puts what an ideal camera with focal length one sees at x, y.

    Numbers, arrays, or CasADi symbols; coefficients in the order of `DISTORTION`.
    """
    k1, k2, p1, p2, k3 = (coefficients[k] for k in range(5))
    squared = x * x + y * y
    radial = 1 + squared * (k1 + squared * (k2 + squared * k3))
    return (
        x * radial + 2 * p1 * x * y + p2 * (squared + 2 * x * x),
        y * radial + p1 * (squared + 2 * y * y) + 2 * p2 * x * y,
    )


def pixel_of(x: Any, y: Any, z: Any, intrinsics: Any) -> tuple[Any, Any]:
    """Pixel u, v of a point in the camera's frame (x right, y down, z ahead, any unit).

    Numbers, arrays, or CasADi symbols; intrinsics in the order of `INTRINSICS`.
    """
    fx, fy, cx, cy = (intrinsics[k] for k in range(4))
    u, v = distorted(x / z, y / z, [intrinsics[k] for k in range(4, 9)])
    return fx * u + cx, fy * v + cy


def projected(points: ArrayLike, intrinsics: ArrayLike) -> FloatArray:
    """Pixels (..., 2) of points (..., 3) in the camera's frame, m.

    Args:
        points: (..., 3), m, not in the plane of the camera's centre.
        intrinsics: (9,) in the order of `INTRINSICS`.
    """
    x, y, z = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
    return np.stack(pixel_of(x, y, z, np.asarray(intrinsics, dtype=float)), axis=-1)


def undistorted(pixels: ArrayLike, intrinsics: ArrayLike | Sequence[float]) -> FloatArray:
    """Coordinates at unit depth (..., 2) of what is seen at pixels (..., 2).

    A fixed-point iteration, as OpenCV's ``undistortPoints``: exact to rounding where the lens bends
    less than it focuses, which is over the picture of every lens that has this model.
    """
    values = np.asarray(intrinsics, dtype=float)
    observed = (np.asarray(pixels, dtype=float) - values[2:4]) / values[:2]
    ideal = observed.copy()
    with np.errstate(over="ignore", invalid="ignore"):
        # Rounds of a fixed-point iteration, of which each gains a digit for any lens without a
        # fold.
        for _ in range(20):
            x, y = np.moveaxis(ideal, -1, 0)
            ideal = ideal + observed - np.stack(distorted(x, y, values[4:]), axis=-1)
    # Coordinate at unit depth, half a degree from the side, that no pinhole camera sees: where a
    # lens folds back, the iteration goes beyond all bounds.
    return np.asarray(np.where(np.abs(ideal) < 100.0, ideal, observed))
