"""How sure a camera's projection is, over its picture.

Errors of the intrinsics and a turn of the camera look alike. What counts is what is left of the
former after the turn that takes up most of it where corners were seen: then it is about the lens,
and not about which frame is called the camera's (the "projection uncertainty" of mrcal, far away).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.geometry.lens_slopes import pixel_slopes
from suta_calib.geometry.numbers import skew
from suta_calib.measurements.camera import Camera


@dataclass(frozen=True, eq=False)
class ProjectionMap(Displayable):
    """Over a camera's picture, how sure the place is where a far point is seen.

    Attributes:
        u, v: (w,) and (h,) where it was asked, px.
        std: (h, w) px (2-D); NaN where the lens sees nothing.
    """

    u: FloatArray
    v: FloatArray
    std: FloatArray

    @classmethod
    def of(cls, camera: Camera, seen: FloatArray) -> ProjectionMap:
        """Of a camera with its covariance, and of where corners were seen (k, 2), px."""
        # Points of the picture along each side.
        across, down = 33, 25
        u, v = np.linspace(0, camera.width - 1, across), np.linspace(0, camera.height - 1, down)
        pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
        std = np.full(len(pixels), np.nan)
        rays = camera.directions(pixels)
        in_front = camera.lens.ahead(rays)
        in_front &= (
            np.abs(camera.project(np.where(in_front[:, None], rays, [0, 0, 1.0])) - pixels).max(1)
            < 0.1
        )
        std[in_front] = projection_std(camera, seen, pixels[in_front])
        return cls(u, v, std.reshape(down, across))

    @property
    def middle(self) -> float:
        """In the middle of the picture, px."""
        return float(self.std[len(self.v) // 2, len(self.u) // 2])

    @property
    def worst(self) -> float:
        """Where it is least sure, px."""
        return float(np.nanmax(self.std))


def projection_std(camera: Camera, seen: FloatArray, pixels: FloatArray) -> FloatArray:
    """Standard deviations (n,) of where far points are seen, px (2-D).

    Args:
        camera: with the covariance of its intrinsics.
        seen: (k, 2) where corners were, px.
        pixels: (n, 2) where it is asked, px.
    """
    assert camera.covariance is not None
    # More corners say the same.
    subset = seen[:: max(1, len(seen) // 2000)]
    by_values, by_turn = _slopes(camera, subset)
    n = by_values.shape[-1]
    turn = np.linalg.lstsq(by_turn.reshape(-1, 3), by_values.reshape(-1, n), rcond=None)[0]
    by_values, by_turn = _slopes(camera, pixels)
    left = by_values - by_turn @ turn
    variance = np.einsum("nij,jk,nik->n", left, camera.covariance, left)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _slopes(camera: Camera, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives of pixels by the intrinsics (n, 2, c), and by a turn of the camera (n, 2, 3)."""
    rays = camera.directions(pixels)
    by_point, by_values = pixel_slopes(camera.lens, rays, camera.intrinsics)
    return by_values, by_point @ skew(rays)
