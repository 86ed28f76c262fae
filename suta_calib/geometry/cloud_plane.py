"""A plane in a cloud of points that was seen from one place, the origin.

A depth camera errs along its rays, the more the farther away, and neighbours err together. So a
plane is fitted to what is measured along each ray, robustly, with a noise by distance that it tells
itself; and its covariance counts patches, not points. Nothing is random.

A plane has three numbers, and so its covariance has six. Three points of it whose heights err
independently and alike say the same: whoever fits planes to heights of points needs no other
weights.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.ndimage import label
from scipy.optimize import nnls
from scipy.spatial import KDTree

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.geometry.numbers import right_singular

# Fewest points of a plane, and part of the cloud that they must be: any surface has flat pieces.
FEWEST: Final = 100
_PART: Final = 0.1
# Cosine of the steepest angle at which a plane is looked at: beyond, it is seen edge on.
_STEEPEST: Final = 0.1


@dataclass(frozen=True, eq=False)
class CloudPlane:
    """A plane in a cloud.

    Attributes:
        normal: (3,) unit vector, away from the origin.
        distance: from the origin, m.
        middle: (3,) point of the plane, in the middle of what was seen of it, m.
        marks: (3, 3) points of the plane whose heights err independently; they stand for it.
        sigma: standard deviation of the height of each of them, m.
        tilt: (2,) standard deviations of the tilt about the two axes that err by themselves, rad.
        points: how many points are on it.
        rms: of their distances from it, m.
        noise: a and b of ``a + b r²``, of points along their rays at the distance r, m and 1/m.
        rival: how many points the next best plane in the cloud has, of those of this.
    """

    normal: FloatArray
    distance: float
    middle: FloatArray
    marks: FloatArray
    sigma: float
    tilt: FloatArray
    points: int
    rms: float
    noise: tuple[float, float]
    rival: float

    @property
    def height_std(self) -> float:
        """Standard deviation of its height in its middle, m."""
        return float(self.sigma / np.sqrt(3.0))


@dataclass(frozen=True, eq=False)
class _Rays:
    """What was seen along rays from the origin: unit vectors (n, 3), and distances (n,), m."""

    ray: FloatArray
    away: FloatArray

    @classmethod
    def of(cls, points: FloatArray) -> _Rays:
        away = np.linalg.norm(points, axis=1)
        return cls(points / away[:, None], away)

    def some(self, rows: BoolArray | slice) -> _Rays:
        return _Rays(self.ray[rows], self.away[rows])

    def expected(self, plane: FloatArray) -> FloatArray:
        """(n,) distances along the rays of ``m · p = 1``, m; infinite where it is not ahead."""
        ahead = self.ray @ plane
        steepest = _STEEPEST * float(np.linalg.norm(plane))
        return np.where(ahead > steepest, 1.0 / np.maximum(ahead, 1e-12), np.inf)


def plane_in(points: FloatArray) -> CloudPlane | None:
    """The largest plane in points (n, 3), m, seen from the origin; None where there is none."""
    if len(points) < FEWEST:
        return None
    # Of many points 30,000 are fitted, and planes are looked for among 4,000.
    rays = _Rays.of(points[:: -(-len(points) // 30_000)])
    few = rays.some(slice(None, None, -(-len(rays.away) // 4_000)))
    planes, tolerance = _proposals(few)
    if not len(planes):
        return None
    order = np.argsort([-_score(few, plane, tolerance) for plane in planes])
    # Proposals that are improved.
    improved = [_improved(few, planes[k], tolerance) for k in order[:8]]
    improved.sort(key=lambda plane: -_score(few, plane, tolerance))
    best, taken = improved[0], _near(few, improved[0], tolerance)
    if taken.sum() < _PART * len(taken):
        return None
    # What is left without the best plane may hold another one that is as large.
    rest = few.some(~_near(few, best, 2.0 * tolerance))
    rivals = [_near(rest, plane, tolerance).sum() for plane in planes] if len(rest.away) else [0]
    plane = _fitted(rays, best, tolerance)
    return plane and replace(plane, rival=float(max(rivals)) / float(taken.sum()))


def _proposals(rays: _Rays) -> tuple[FloatArray, float]:
    """Planes (k, 3) of pieces of the surface, and how far points lie off, of their distance."""
    points = rays.ray * rays.away[:, None]
    # So many pieces of the surface propose a plane, each of so many neighbours.
    count = min(40, len(points))
    seeds = points[:: max(1, len(points) // 200)]
    _, near = KDTree(points).query(seeds, k=count)
    middle = points[near].mean(axis=1)
    about = points[near] - middle[:, None]
    size, vectors = np.linalg.eigh(np.swapaxes(about, 1, 2) @ about)
    normal = vectors[:, :, 0]
    away = np.einsum("ni,ni->n", normal, middle)
    length = np.linalg.norm(middle, axis=1)
    # Of pieces at an edge, or of clutter, the scatter tells nothing: those of the flattest do.
    scatter = np.sqrt(np.maximum(size[:, 0], 0.0) / count) / length
    # Depth in whole millimetres scatters by nothing in a piece, and no camera is better than that.
    tolerance = float(np.clip(4.0 * np.quantile(scatter, 0.3), 2e-3, 0.03))
    ahead = np.abs(away) > _STEEPEST * length
    return normal[ahead] / away[ahead, None], tolerance


def _near(rays: _Rays, plane: FloatArray, tolerance: float) -> BoolArray:
    """(n,) points on a plane, to a part of their distance."""
    return np.asarray(np.abs(rays.away - rays.expected(plane)) < tolerance * rays.away)


def _score(rays: _Rays, plane: FloatArray, tolerance: float) -> float:
    """How many points are on a plane; those that are off a little count for less."""
    off = (rays.away / rays.expected(plane) - 1.0) / tolerance
    return float(np.sum(np.maximum(1.0 - off**2, 0.0)))


def _improved(rays: _Rays, plane: FloatArray, tolerance: float) -> FloatArray:
    """A plane by all points that are on it: its inverse distance is linear in the ray."""
    for _ in range(3):
        near = _near(rays, plane, tolerance)
        if near.sum() < 3:
            break
        chosen = rays.some(near)
        points = chosen.ray * chosen.away[:, None]
        plane = np.asarray(np.linalg.lstsq(points, np.ones(len(points)), rcond=None)[0])
    return plane


def _fitted(rays: _Rays, plane: FloatArray, tolerance: float) -> CloudPlane | None:
    """The fit near a plane: Gauss and Newton along the rays, Tukey's weights, noise by distance."""
    rays = rays.some(_near(rays, plane, 2.0 * tolerance))
    rays = rays.some(_connected(rays, plane))
    if len(rays.away) < FEWEST:
        return None
    normal, distance = plane / np.linalg.norm(plane), 1.0 / float(np.linalg.norm(plane))
    noise = (0.0, tolerance / 2.0 / float(np.median(rays.away)))
    for _ in range(12):
        slope = rays.ray @ normal
        expected = np.where(slope > _STEEPEST / 2, distance / np.maximum(slope, 1e-12), np.inf)
        off = np.where(np.isfinite(expected), rays.away - expected, np.inf)
        sigma = noise[0] + noise[1] * np.where(np.isfinite(expected), expected, 1.0) ** 2
        # Of Tukey's biweight, with an efficiency of 95 %.
        tukey = np.maximum(1.0 - (off / (4.685 * sigma)) ** 2, 0.0) ** 2
        on = tukey > 0
        if on.sum() < FEWEST:
            return None
        foot = rays.ray[on] * expected[on, None]
        weight = tukey[on] / (sigma[on] * slope[on]) ** 2
        middle = np.average(foot, axis=0, weights=weight)
        across = right_singular(normal[None])[1][1:]
        columns = np.column_stack([np.ones(len(foot)), (foot - middle) @ across.T])
        height, root = off[on] * slope[on], np.sqrt(weight)
        step = np.linalg.lstsq(columns * root[:, None], height * root, rcond=None)[0]
        normal = normal - step[1:] @ across
        normal /= np.linalg.norm(normal)
        distance = float(normal @ (middle + step[0] * normal))
        again = _noise(expected[on], off[on], sigma[on])
        settled = np.allclose(again, noise, rtol=0.02, atol=1e-9) and np.abs(step).max() < 1e-7
        noise = again
        if settled:
            break
    left = height - columns @ step
    return _judged(columns, left, weight, (middle + step[0] * normal, across, normal), noise)


def _judged(
    columns: FloatArray,
    left: FloatArray,
    weight: FloatArray,
    frame: tuple[FloatArray, FloatArray, FloatArray],
    noise: tuple[float, float],
) -> CloudPlane:
    """A fitted plane with its ±.

    Args:
        columns: (n, 3) of its height and its two slopes.
        left: (n,) heights of points, m.
        weight: (n,) of them.
        frame: its middle, two directions (2, 3) in it, and its normal.
        noise: along the rays.
    """
    middle, across, normal = frame
    covariance = _by_patches(columns, left, weight)
    information = np.linalg.inv(covariance)
    total = information[0, 0]
    centre = information[0, 1:] / total
    spread = information[1:, 1:] / total - np.outer(centre, centre)
    angle = 2.0 * np.pi * np.arange(3) / 3.0
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    marks = centre + np.sqrt(2.0) * circle @ np.linalg.cholesky(spread).T
    middle = middle + centre @ across
    return CloudPlane(
        *(normal, float(normal @ middle), middle),
        middle + (marks - centre) @ across,
        float(np.sqrt(3.0 / total)),
        np.sqrt(np.linalg.eigvalsh(covariance[1:, 1:])),
        len(left),
        float(np.sqrt(np.mean(left**2))),
        noise,
        0.0,
    )


def _by_patches(columns: FloatArray, left: FloatArray, weight: FloatArray) -> FloatArray:
    """(3, 3) covariance of a fit whose points err together in patches, never less than alone."""
    curvature = np.linalg.inv(columns.T @ (columns * weight[:, None]))
    alone = curvature * float(np.sum(weight * left**2)) / max(float(np.sum(weight)), 1e-300)
    alone *= float(np.mean(weight)) * len(left) / max(len(left) - 3, 1)
    place = columns[:, 1:] - columns[:, 1:].min(axis=0)
    size = np.maximum(place.max(axis=0), 1e-12)
    # Patches along each side of a plane: errors of points farther apart count as independent.
    patches = 8
    cell = np.minimum((place / size * patches).astype(np.intp), patches - 1)
    _, patch = np.unique(cell @ [patches, 1], return_inverse=True)
    count = int(patch.max()) + 1
    pull = np.zeros((count, 3))
    np.add.at(pull, patch.reshape(-1), columns * (weight * left)[:, None])
    together = curvature @ (pull.T @ pull) @ curvature * count / max(count - 3, 1)
    # In the axes in which the points alone err by one each.
    root = np.linalg.cholesky(alone)
    inverse = np.linalg.inv(root)
    size, vectors = np.linalg.eigh(inverse @ together @ inverse.T)
    return np.asarray(root @ (vectors * np.maximum(size, 1.0)) @ vectors.T @ root.T)


def _connected(rays: _Rays, plane: FloatArray) -> BoolArray:
    """(n,) points in large parts of a plane: not where others cross its continuation."""
    foot = rays.ray * rays.expected(plane)[:, None]
    place = foot @ right_singular(plane[None])[1][1:].T
    place = place - place.min(axis=0)
    # Cells that are wide enough for a point in each, of a cloud as it usually is.
    cells = 40
    size = max(float(place.max()), 1e-9)
    cell = np.minimum((place / size * cells).astype(np.intp), cells - 1)
    grid = np.zeros((cells, cells), dtype=np.intp)
    grid[cell[:, 0], cell[:, 1]] = 1
    part, _ = label(grid, structure=np.ones((3, 3)))
    of_point = part[cell[:, 0], cell[:, 1]]
    counts = np.bincount(of_point)
    return np.asarray(counts[of_point] >= _PART * len(of_point))


def _noise(away: FloatArray, off: FloatArray, sigma: FloatArray) -> tuple[float, float]:
    """A and b of ``a + b r²``, by how points scatter along their rays at several distances."""
    groups = 6
    edges = np.quantile(away, np.linspace(0.0, 1.0, groups + 1))
    which = np.clip(np.searchsorted(edges, away, side="right") - 1, 0, groups - 1)
    parts = [np.flatnonzero(which == k) for k in range(groups)]
    parts = [rows for rows in parts if len(rows) >= FEWEST // groups]
    r = np.array([np.median(away[rows]) for rows in parts])
    # Of a normal distribution half of all are within 0.6745 standard deviations.
    noise = np.array([np.median(np.abs(off[rows])) / 0.6745 for rows in parts])
    # Exact points, or whole millimetres, scatter by nothing about some planes.
    noise = np.maximum(noise, 1e-5 * r)
    a, b = nnls(np.column_stack([1.0 / noise, r**2 / noise]), np.ones(len(parts)))[0]
    return (float(a), float(b)) if len(parts) else (0.0, float(np.median(sigma / away**2)))
