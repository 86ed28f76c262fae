"""Noise of a depth camera by distance.

Depth is found by triangulation (stereo, structured light) or by time of flight. By triangulation
its standard deviation grows with the square of the distance: Khoshelham and Oude Elberink (2012),
doi:10.3390/s120201437, eq. 10. Across the ray a point is as uncertain as its pixel, which covers a
length in proportion to the distance: Nguyen, Izadi, Lovell (2012), doi:10.1109/3DIMPVT.2012.84.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
from scipy.optimize import nnls

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.geometry.numbers import (
    register_points,
    rotation_from_vector,
    vector_turning_z_to,
)
from suta_calib.measurements.fields import Value, keyed, quantity
from suta_calib.measurements.yaml_file import YamlSection
from suta_calib.units import from_mm

# Nearest depth that the noise is said of, m: what is nearer has wrong axes or another unit.
_NEAREST: Final = 0.05


def _read_along(section: YamlSection, name: str) -> Any:
    constant, growing = section.numbers(name, 2)
    if min(constant, growing) < 0 or not max(constant, growing) > 0:
        expected = "two numbers in mm, 0 or more, and not both 0"
        raise section.refuse(f"[{constant:g}, {growing:g}]", expected, at=(name,))
    return from_mm(constant), from_mm(growing)


@dataclass(frozen=True)
class DepthNoise(Displayable):
    """Standard deviation ``a + b z²`` along the ray, and ``c z`` across it, at the depth z in m.

    Attributes:
        along: a and b, m and 1/m.
        across: c.
    """

    along: tuple[float, float] = keyed(
        Value("two numbers in mm", _read_along),
        "Along the ray: the part that is the same at every distance, and what is added at 1 m; it "
        "grows with the square of the distance.",
        name="along_mm",
    )
    across: float = keyed(
        quantity("m", "positive"),
        "Across the ray at 1 m; it grows with the distance.",
        name="across_mm",
    )

    def sigmas(self, depth: FloatArray) -> FloatArray:
        """Standard deviations (n, 3), m, at depths (n,), m: twice across the ray, then along it."""
        z = np.maximum(depth, _NEAREST)
        across = self.across * z
        return np.column_stack([across, across, self.along[0] + self.along[1] * z**2])

    @classmethod
    def learnt(cls, pictures: Iterable[tuple[FloatArray, FloatArray]]) -> Self | None:
        """From how the points of a rigid board scatter about it, whatever the poses of the hand.

        Args:
            pictures: points (k, 3) on the board and in the camera, m, of each picture.

        Returns:
            None where there are too few points to tell.
        """
        depths, spreads, counts = list[float](), list[tuple[float, float]](), list[int]()
        for on_board, in_camera in pictures:
            count = len(in_camera)
            # Points of a picture that say how they scatter: three are the pose of the board.
            if count < 6:
                continue
            R, p = register_points(on_board, in_camera)
            left = np.einsum("nji,nj->ni", ray_axes(in_camera), in_camera - on_board @ R.T - p)
            # The six unknowns of the pose took their share.
            share = np.sqrt(3 * count / (3 * count - 6))
            by_axis = _robust_sigma(left) * share
            depths.append(float(np.median(in_camera[:, 2])))
            spreads.append((float(np.hypot(*by_axis[:2])) / np.sqrt(2.0), float(by_axis[2])))
            counts.append(count)
        if not depths:
            return None
        z, (across, along) = np.maximum(depths, _NEAREST), np.array(spreads).T
        weight = np.sqrt(counts) / np.maximum(along, 1e-9)
        a, b = nnls(np.column_stack([weight, weight * z**2]), weight * along)[0]
        c = float(np.average(across / z, weights=counts))
        # Exact points scatter by nothing: they weigh alike.
        return cls((float(a), float(b)), c) if max(a, b) > 1e-9 and c > 1e-9 else None


# Of a depth camera of which nobody says it, and whose points do not tell it: the first Kinect's, in
# round numbers (Nguyen 2012). Nothing but its shape counts, for one factor on it is learnt.
TYPICAL: Final = DepthNoise((1.2e-3, 1.9e-3), 1.4e-3)


def ray_axes(points: FloatArray) -> FloatArray:
    """Rotations (n, 3, 3) whose z axes are along the rays to points (n, 3)."""
    length = np.linalg.norm(points, axis=1, keepdims=True)
    ray = np.where(length > 0, points / np.where(length > 0, length, 1.0), [0.0, 0.0, 1.0])
    return rotation_from_vector(vector_turning_z_to(ray))


def _robust_sigma(left: FloatArray) -> FloatArray:
    """(d,) standard deviations of columns (n, d) whose mean is zero, by their middle size."""
    # Of a normal distribution half of all are within 0.6745 standard deviations.
    return np.asarray(np.median(np.abs(left), axis=0) / 0.6745)
