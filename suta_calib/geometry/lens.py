"""Lenses: at which pixel a camera sees a point, by the models of OpenCV, ROS and kalibr.

`PLUMB_BOB` is Brown's model (1971) and `RATIONAL` its quotient of two polynomials, as in OpenCV's
``calib3d``; `EQUIDISTANT` is that of Kannala and Brandt (2006), doi:10.1109/TPAMI.2006.153, as in
``cv::fisheye``. Names of coefficients, their order and the equations are those of OpenCV. A pixel's
centre has whole coordinates: the centre of the first one is at 0, 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import BoolArray, FloatArray

# Intrinsics in the order in which they stand everywhere: these four in px, then the distortion, 1.
FOCAL: Final = ("fx", "fy")
CENTRE: Final = ("cx", "cy")
# Angle from the axis up to which a lens that sees behind itself may see, rad. The widest that are
# sold see 220°, which is 110° from the axis.
_WIDEST: Final = np.radians(120.0)


def _brown(x: Any, y: Any, z: Any, coefficients: Any, atan2: Any) -> tuple[Any, Any]:
    del atan2
    k1, k2, p1, p2, k3 = (coefficients[k] for k in range(5))
    x, y = x / z, y / z
    squared = x * x + y * y
    return _decentred(x, y, 1 + squared * (k1 + squared * (k2 + squared * k3)), p1, p2)


def _quotient(x: Any, y: Any, z: Any, coefficients: Any, atan2: Any) -> tuple[Any, Any]:
    del atan2
    k1, k2, p1, p2, k3, k4, k5, k6 = (coefficients[k] for k in range(8))
    x, y = x / z, y / z
    squared = x * x + y * y
    above = 1 + squared * (k1 + squared * (k2 + squared * k3))
    below = 1 + squared * (k4 + squared * (k5 + squared * k6))
    return _decentred(x, y, above / below, p1, p2)


def _decentred(x: Any, y: Any, radial: Any, p1: Any, p2: Any) -> tuple[Any, Any]:
    squared = x * x + y * y
    return (
        x * radial + 2 * p1 * x * y + p2 * (squared + 2 * x * x),
        y * radial + p1 * (squared + 2 * y * y) + 2 * p2 * x * y,
    )


def _of_angle(angle: Any, coefficients: Any) -> Any:
    k1, k2, k3, k4 = (coefficients[k] for k in range(4))
    s = angle * angle
    return angle * (1 + s * (k1 + s * (k2 + s * (k3 + s * k4))))


def _fisheye(x: Any, y: Any, z: Any, coefficients: Any, atan2: Any) -> tuple[Any, Any]:
    # A point on the axis has no direction from it. So near to it, in m, the two are one.
    across = (x * x + y * y + 1e-20) ** 0.5
    scale = _of_angle(atan2(across, z), coefficients) / across
    return x * scale, y * scale


@dataclass(frozen=True)
class Lens:
    """A model of a lens.

    Attributes:
        name: as ``distortion_model`` of ROS.
        distortion: names of its coefficients.
        also: its other names.
        sees_behind: whether it sees what is beside the camera, and behind it.
        about: what it is for, in words.
        bent: where it puts what an ideal camera with focal length one sees at a point x, y, z.
    """

    name: str
    distortion: tuple[str, ...]
    also: tuple[str, ...]
    sees_behind: bool
    about: str
    bent: Callable[[Any, Any, Any, Any, Any], tuple[Any, Any]]

    @property
    def names(self) -> tuple[str, ...]:
        """Of all intrinsics, in their order."""
        return (*FOCAL, *CENTRE, *self.distortion)

    @property
    def called(self) -> str:
        """Its name, and the one that users know it by."""
        return f"{self.name} (fisheye)" if self.sees_behind else self.name

    @property
    def tangential(self) -> tuple[bool, ...]:
        """Of each coefficient whether it bends across rays, as decentred glasses do."""
        return tuple(name.startswith("p") for name in self.distortion)

    def pixel_of(
        self, x: Any, y: Any, z: Any, intrinsics: Any, atan2: Any = np.arctan2
    ) -> tuple[Any, Any]:
        """Pixel u, v of a point in the camera's frame (x right, y down, z ahead), m.

        Numbers, arrays, or CasADi symbols with the ``atan2`` of CasADi; intrinsics in the order of
        `names`.
        """
        fx, fy, cx, cy = (intrinsics[k] for k in range(4))
        bending = [intrinsics[k] for k in range(4, 4 + len(self.distortion))]
        u, v = self.bent(x, y, z, bending, atan2)
        return fx * u + cx, fy * v + cy

    def ahead(self, points: FloatArray, nearest: float = 0.0) -> BoolArray:
        """(...) which points (..., 3) it can see, further than ``nearest`` from the camera, m."""
        if not self.sees_behind:
            return np.asarray(points[..., 2] > nearest)
        distance = np.linalg.norm(points, axis=-1)
        return np.asarray((distance > nearest) & (points[..., 2] > np.cos(_WIDEST) * distance))

    def projected(self, points: ArrayLike, intrinsics: ArrayLike) -> FloatArray:
        """Pixels (..., 2) of points (..., 3) in the camera's frame, m, that are `ahead`."""
        x, y, z = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
        return np.stack(self.pixel_of(x, y, z, np.asarray(intrinsics, dtype=float)), axis=-1)

    def directions(self, pixels: ArrayLike, intrinsics: ArrayLike | Sequence[float]) -> FloatArray:
        """Unit vectors (..., 3) in the camera's frame to what is seen at pixels (..., 2)."""
        if not self.sees_behind:
            ideal = self.undistorted(pixels, intrinsics)
            there = np.concatenate([ideal, np.ones_like(ideal[..., :1])], axis=-1)
            return np.asarray(there / np.linalg.norm(there, axis=-1, keepdims=True))
        on_plane, values = _less_focus(pixels, intrinsics)
        length = np.linalg.norm(on_plane, axis=-1)
        angle = _angle_of(length, values[4:])
        part = np.sin(angle) / np.where(length > 0, length, 1.0)
        return np.concatenate([on_plane * part[..., None], np.cos(angle)[..., None]], axis=-1)

    def undistorted(self, pixels: ArrayLike, intrinsics: ArrayLike | Sequence[float]) -> FloatArray:
        """Coordinates at unit depth (..., 2) of what is seen at pixels (..., 2).

        Of what is beside or behind the camera they are NaN.
        """
        if not self.sees_behind:
            return _straightened(self, *_less_focus(pixels, intrinsics))
        there = self.directions(pixels, intrinsics)
        depth = np.where(there[..., 2:] > 1e-3, there[..., 2:], np.nan)
        return np.asarray(there[..., :2] / depth)


def _less_focus(
    pixels: ArrayLike, intrinsics: ArrayLike | Sequence[float]
) -> tuple[FloatArray, FloatArray]:
    """Pixels (..., 2) as a camera with focal length one has them; intrinsics as an array."""
    values = np.asarray(intrinsics, dtype=float)
    return (np.asarray(pixels, dtype=float) - values[2:4]) / values[:2], values


def _straightened(lens: Lens, observed: FloatArray, values: FloatArray) -> FloatArray:
    """Coordinates at unit depth (..., 2) of what a lens puts at ``observed`` (..., 2).

    A fixed-point iteration, as OpenCV's ``undistortPoints``, and steps of Newton where it is slow.
    """

    def bent(at: FloatArray) -> FloatArray:
        x, y = np.moveaxis(at, -1, 0)
        return np.stack(lens.bent(x, y, 1.0, values[4:], np.arctan2), axis=-1)

    ideal = observed.copy()
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        # Rounds of a fixed-point iteration, of which each gains a digit for a lens that bends
        # little.
        for _ in range(20):
            ideal = ideal + observed - bent(ideal)
        for _ in range(10):
            off = bent(ideal) - observed
            size = np.abs(off).max(axis=-1)
            slow = np.isfinite(size) & (size > 1e-13)
            if not slow.any():
                break
            at, step = ideal[slow], 1e-6
            right, down = (
                (bent(at + step * e) - bent(at - step * e)) / (2 * step) for e in np.eye(2)
            )
            turn = right[:, 0] * down[:, 1] - right[:, 1] * down[:, 0]
            u, v = off[slow].T
            newton = np.stack(
                [u * down[:, 1] - v * down[:, 0], v * right[:, 0] - u * right[:, 1]], -1
            )
            better = at - newton / turn[:, None]
            nearer = np.abs(bent(better) - observed[slow]).max(axis=-1) < size[slow]
            ideal[slow] = np.where(nearer[:, None], better, at)
            if not nearer.any():
                break
    # Coordinate at unit depth, half a degree from the side, that no such camera sees: where a
    # lens folds back, the iteration goes beyond all bounds.
    return np.asarray(np.where(np.abs(ideal) < 100.0, ideal, observed))


def _angle_of(length: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Angles from the axis, rad, of what a fisheye puts at such a distance from the centre."""
    angle = np.minimum(length, _WIDEST)
    k1, k2, k3, k4 = coefficients
    for _ in range(20):
        s = angle * angle
        slope = 1 + s * (3 * k1 + s * (5 * k2 + s * (7 * k3 + s * 9 * k4)))
        # Where the polynomial falls nothing is seen: it is not left by a step beyond its top.
        change = (_of_angle(angle, coefficients) - length) / np.maximum(slope, 0.05)
        angle = np.clip(angle - change, 0.0, np.pi)
        if not np.any(np.abs(change) > 1e-14):
            break
    return np.asarray(angle)


PLUMB_BOB: Final = Lens(
    "plumb_bob",
    ("k1", "k2", "p1", "p2", "k3"),
    ("radtan", ""),
    False,
    "Brown's model, for lenses up to some 90° wide",
    _brown,
)
RATIONAL: Final = Lens(
    "rational_polynomial",
    ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    ("rational",),
    False,
    "OpenCV's rational model, for lenses up to some 130° wide",
    _quotient,
)
EQUIDISTANT: Final = Lens(
    "equidistant",
    ("k1", "k2", "k3", "k4"),
    ("fisheye", "equi", "kannala_brandt4"),
    True,
    "the fisheye model of OpenCV and kalibr, for lenses up to 220° wide",
    _fisheye,
)
LENSES: Final = {lens.name: lens for lens in (PLUMB_BOB, RATIONAL, EQUIDISTANT)}
# Of any lens.
DISTORTION: Final = tuple(dict.fromkeys(n for lens in LENSES.values() for n in lens.distortion))


def projected(points: ArrayLike, intrinsics: ArrayLike, lens: Lens = PLUMB_BOB) -> FloatArray:
    """Pixels (..., 2) of points (..., 3) in the camera's frame, m; `Lens.projected`."""
    return lens.projected(points, intrinsics)


def lens_called(name: str) -> Lens | None:
    """The lens of that name, or of one of its other names."""
    return next((lens for lens in LENSES.values() if name in (lens.name, *lens.also)), None)
