"""From pillars in the ground's frame to landmarks in the artefact's, with full covariance.

The artefact's frame: z is the ground's normal, up towards the tops; height is counted from the
ground; x and y are zero at one landmark, the origin; x points along the side plane, with the
artefact on its left, so that y points from the side plane into the artefact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.certification.heading import Heading
from suta_calib.certification.pillar import GROUND, YAW, PillarGeometry, X, Y, Z
from suta_calib.certification.plane import Plane
from suta_calib.geometry.numbers import skew


@dataclass(frozen=True, eq=False)
class Sources:
    """Everything that was touched and used, as columns of one Jacobian.

    Attributes:
        sigma: (c,) standard deviation of each touched coordinate, m.
        ground: (3, c) the ground's small error by them: turns about x and y, height.
        pillars: for each landmark the columns of its touches.
        side: columns of the side's touches.
    """

    sigma: FloatArray
    ground: FloatArray
    pillars: tuple[slice, ...]
    side: slice

    @property
    def count(self) -> int:
        """Number of columns."""
        return len(self.sigma)


def sources(
    ground: Plane,
    ground_points: FloatArray,
    pillar_sigmas: Sequence[FloatArray],
    side_count: int,
    ground_noise: float,
    noise: float,
) -> Sources:
    """Lay out the columns, and the ground plane's error as a function of its touches.

    A plane by least squares turns and rises with its touches' heights dz as
    ``(Σ Y dz / Σ Y², -Σ X dz / Σ X², mean dz)`` along its principal axes X and Y.

    Args:
        ground: the plane.
        ground_points: (n, 3) its touches in use, in its own frame, m.
        pillar_sigmas: standard deviation of every coordinate touched on each pillar, m.
        side_count: touches of the side in use.
        ground_noise: standard deviation of a touch on the ground, m.
        noise: of one on the side, m.
    """
    n = int(ground.inliers.sum())
    x, y = ground_points[:, 0], ground_points[:, 1]
    by_height = np.array([y / (y @ y), -x / (x @ x), np.full(n, 1.0 / n)])
    sizes = [3 * n, *(len(s) for s in pillar_sigmas), 3 * side_count]
    edges = np.concatenate([[0], np.cumsum(sizes)])
    sigma = np.concatenate(
        [np.full(3 * n, ground_noise), *pillar_sigmas, np.full(3 * side_count, noise)]
    )
    plane = np.zeros((GROUND, len(sigma)))
    plane[:, 2 : 3 * n : 3] = by_height
    slices = [slice(int(a), int(b)) for a, b in pairwise(edges[1:])]
    return Sources(sigma, plane, tuple(slices[:-1]), slices[-1])


def pillar_jacobian(geometry: PillarGeometry, columns: slice, by: Sources) -> FloatArray:
    """(rows, c) derivative of a pillar's numbers by everything touched."""
    full = geometry.by_ground @ by.ground
    full[:, columns] += geometry.by_touch
    return np.asarray(full)


def heading_jacobian(heading: Heading, by: Sources) -> FloatArray:
    """(c,) derivative of the side's direction by everything touched."""
    full = heading.by_ground @ by.ground
    full[by.side] += heading.by_touch
    return np.asarray(full)


@dataclass(frozen=True, eq=False)
class Placed:
    """Landmarks in the artefact's frame.

    Attributes:
        position: (n, 3), m.
        by: (n, 3, c) its derivative by everything touched.
        yaw: (n,) direction of the flats, rad; NaN without.
        yaw_by: (n, c).
    """

    position: FloatArray
    by: FloatArray
    yaw: FloatArray
    yaw_by: FloatArray


def placed(
    pillars: Sequence[PillarGeometry],
    jacobians: Sequence[FloatArray],
    origin: int,
    angle: float,
    angle_by: FloatArray,
) -> Placed:
    """Turn by the heading, and count x and y from the origin.

    Args:
        pillars: in the ground's frame, with their `pillar_jacobian`.
        jacobians: of each pillar.
        origin: which of them is the origin.
        angle: of the x axis in the ground's frame, rad.
        angle_by: (c,) its derivative.
    """
    local = np.array([g.values[[X, Y, Z]] for g in pillars])
    by = np.array([j[[X, Y, Z]] for j in jacobians])
    local[:, :2] -= local[origin, :2].copy()
    by[:, :2] -= by[origin, :2].copy()
    c, s = np.cos(angle), np.sin(angle)
    back = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    position = local @ back.T
    turned = np.einsum("ij,njc->nic", back, by)
    # A heading that turns one way turns everything else the other way.
    turned += np.stack([position[:, 1], -position[:, 0], 0 * position[:, 2]], 1)[..., None] * (
        angle_by
    )
    has = np.array([len(g.values) > YAW for g in pillars])
    yaw = np.array([g.values[YAW] if h else np.nan for g, h in zip(pillars, has, strict=True)])
    yaw_by = np.array([j[YAW] if h else 0 * angle_by for j, h in zip(jacobians, has, strict=True)])
    return Placed(position, turned, wrapped(yaw - angle), yaw_by - angle_by)


def wrapped(angle: FloatArray) -> FloatArray:
    """Angles in (-π, π]."""
    return np.asarray(-((np.pi - np.asarray(angle)) % (2 * np.pi)) + np.pi)


def shape_covariance(position: FloatArray, covariance: FloatArray) -> FloatArray:
    """Covariance (3 n, 3 n) of the landmarks' shape: what no motion of the whole explains.

    In a frame tied to one landmark and one side, their errors are everybody's. Distances do not
    depend on a frame: this is the covariance after best superposition (inner constraints; Meissl
    1969, Baarda 1973's S-transformation), which is what a calibration suffers from.
    """
    n = len(position)
    lever = -skew(position - position.mean(axis=0))
    motion = np.concatenate([np.tile(np.eye(3), (n, 1, 1)), lever], axis=2).reshape(3 * n, 6)
    keep = np.eye(3 * n) - motion @ np.linalg.pinv(motion)
    return np.asarray(keep @ covariance @ keep.T)
