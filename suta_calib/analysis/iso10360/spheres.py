"""Two spheres of points: the smallest that holds them, and the one that fits them best."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError

LEAST_POINTS: Final = 4
_ROUNDING: Final = 1e-9
# Points nearer to a plane than this share of their extent leave the sphere undetermined.
_FLAT: Final = 1e-3


@dataclass(frozen=True)
class Sphere:
    """A sphere.

    Attributes:
        centre: (3,) m.
        radius: m.
        amplification: standard uncertainty of a fitted centre (3-D) per that of a touch; 0 where
            the sphere was not fitted.
    """

    centre: FloatArray
    radius: float
    amplification: float = 0.0


def smallest_sphere(points: FloatArray) -> Sphere:
    """The smallest sphere that holds points (n, 3), m.

    Grows from the points it must pass through (Gärtner 1999, doi:10.1007/3-540-48481-7_29): the
    farthest point outside joins them, and the smallest sphere of at most five is found outright.
    """
    support = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    while True:
        sphere, support = _of_few(points, support)
        away = np.linalg.norm(points - sphere.centre, axis=1)
        farthest = int(np.argmax(away))
        if away[farthest] <= sphere.radius * (1 + _ROUNDING) + 1e-15 or farthest in support:
            return sphere
        support = [*support, farthest]


def _of_few(points: FloatArray, chosen: list[int]) -> tuple[Sphere, list[int]]:
    """Smallest sphere of a few points, and which of them it passes through."""
    best: tuple[Sphere, list[int]] | None = None
    for size in range(1, min(len(chosen), 4) + 1):
        for some in combinations(chosen, size):
            sphere = _through(points[list(some)])
            away = np.linalg.norm(points[chosen] - sphere.centre, axis=1)
            holds = (away <= sphere.radius * (1 + _ROUNDING) + 1e-15).all()
            if holds and (best is None or sphere.radius < best[0].radius):
                best = sphere, list(some)
    assert best is not None, "some sphere through at most four points holds them all"
    return best


def _through(points: FloatArray) -> Sphere:
    """The smallest sphere through points (n, 3), n at most four: its centre lies among them."""
    sides = points[1:] - points[0]
    share = np.linalg.lstsq(2 * sides @ sides.T, (sides**2).sum(axis=1), rcond=None)[0]
    offset = sides.T @ share
    return Sphere(points[0] + offset, float(np.linalg.norm(offset)))


def best_sphere(points: FloatArray, where: str = "") -> Sphere:
    """The sphere with the least squares of distances to points (n, 3), n at least four.

    Raises:
        SamplesError: too few points, or points that lie in a plane.
    """
    if len(points) < LEAST_POINTS:
        raise SamplesError(
            f"{len(points)} points on the sphere", f"at least {LEAST_POINTS}", where=where
        )
    middle = points.mean(axis=0)
    away = points - middle
    sizes = np.linalg.svd(away, compute_uv=False)
    if sizes[2] < _FLAT * sizes[0]:
        raise SamplesError("points in one plane", "points spread over the sphere", where=where)
    rows = np.column_stack([2 * away, np.ones(len(away))])
    start = np.linalg.lstsq(rows, (away**2).sum(axis=1), rcond=None)[0]
    radius = np.sqrt(max(float(start[3] + start[:3] @ start[:3]), 0.0))
    scale = float(sizes[0])
    found = least_squares(
        lambda x: (np.linalg.norm(away - x[:3] * scale, axis=1) - x[3] * scale) / scale,
        np.append(start[:3], radius) / scale,
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    ).x * scale  # fmt: skip
    centre = middle + found[:3]
    return Sphere(centre, float(found[3]), _amplification(points - centre))


def _amplification(away: FloatArray) -> float:
    """For touches (n, 3) seen from the centre; a pole and four places on the equator give 1.5."""
    normals = away / np.linalg.norm(away, axis=1, keepdims=True)
    inverse = np.linalg.pinv(np.column_stack([normals, np.ones(len(away))]))
    return float(np.linalg.norm(inverse[:3]))
