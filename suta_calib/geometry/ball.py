"""A ball of known radius in a cloud of points that was seen from one place.

The normal of a piece of a ball points at its centre, so every point with its neighbours votes for
one centre, a radius behind it. The votes of a ball meet in one place; those of a plane are spread
over another plane. The fullest places are fitted robustly, and the best fit that looks like a ball
is taken. Nothing is random.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial import KDTree

from suta_calib.arrays import BoolArray, FloatArray, IntArray

# Neighbours that make the normal of a point that votes.
_NEIGHBOURS: Final = 24
# Fewest points of a ball.
FEWEST: Final = 30


@dataclass(frozen=True, eq=False)
class Ball:
    """A ball in a cloud.

    Attributes:
        centre: (3,) in the cloud's frame, m.
        covariance: (3, 3) of the centre, m²; neighbours that err together are counted as few.
        points: how many points are on it.
        rms: of their distances from the surface, m.
        radius: that fits them best, m, if it is not taken for known, and its standard deviation.
        rival: how many points the next best place in the cloud has, of those of this.
    """

    centre: FloatArray
    covariance: FloatArray
    points: int
    rms: float
    radius: tuple[float, float]
    rival: float

    @property
    def sigma(self) -> FloatArray:
        """(3,) standard deviation of each coordinate, m."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def fits(self, radius: float) -> bool:
        """Whether the radius that fits best is this one, m, within what can be told."""
        best, std = self.radius
        # A radius is another one where it is off by so many standard deviations and by this part of
        # it.
        return abs(best - radius) <= max(4.0 * std, 0.05 * radius)


def ball_in(points: FloatArray, radius: float) -> Ball | None:
    """The ball of a radius, m, in points (n, 3) seen from the origin; None where there is none."""
    if len(points) < FEWEST:
        return None
    tree = KDTree(points)
    votes = _votes(points, tree, radius)
    candidates = [
        fit
        for centre in _full_places(votes, radius)
        if (fit := _fitted(points, tree, centre, radius)) is not None
    ]
    # Those that are as large as they should be first; then those with the most points.
    candidates.sort(key=lambda ball: (not ball.fits(radius), -ball.points))
    distinct = list[Ball]()
    for ball in candidates:
        if all(np.linalg.norm(ball.centre - b.centre) > radius for b in distinct):
            distinct.append(ball)
    if not distinct:
        return None
    best, *worse = distinct
    equal = [ball.points for ball in worse if ball.fits(radius) == best.fits(radius)]
    rival = max(equal, default=0) / best.points
    return replace(best, rival=rival)


def _votes(points: FloatArray, tree: KDTree, radius: float) -> FloatArray:
    """(m, 3) centres, each a radius behind a point along the normal of its surroundings."""
    # So many points vote.
    step = max(1, len(points) // 12_000)
    voters = points[::step]
    count = min(_NEIGHBOURS, len(points))
    # Neighbours so near that the piece is nearly flat, and far enough to average the noise.
    distance, near = tree.query(voters, k=count, distance_upper_bound=0.6 * radius)
    there = np.isfinite(distance)
    enough = there.sum(axis=1) >= 8
    near, there, voters = near[enough], there[enough], voters[enough]
    if not len(voters):
        return np.zeros((0, 3))
    # A point in every place that has none counts for nothing.
    about = np.where(there[..., None], points[np.where(there, near, 0)] - voters[:, None], 0.0)
    middle = about.sum(axis=1) / there.sum(axis=1)[:, None]
    about = np.where(there[..., None], about - middle[:, None], 0.0)
    _, vectors = np.linalg.eigh(np.swapaxes(about, 1, 2) @ about)
    normal = vectors[:, :, 0]
    normal *= np.sign(np.einsum("ni,ni->n", normal, voters))[:, None]
    return np.asarray(voters + middle + radius * normal)


def _full_places(votes: FloatArray, radius: float) -> list[FloatArray]:
    """Middles of the places with the most votes, each farther than a radius from the others."""
    places = list[FloatArray]()
    if not len(votes):
        return places
    tree = KDTree(votes)
    # How near votes meet, in radii: normals of small pieces scatter by some tenths of a radian.
    together = 0.15
    counts = tree.query_ball_point(votes, together * radius, return_length=True)
    open_votes = np.ones(len(votes), dtype=np.bool_)
    # Places that are fitted.
    while open_votes.any() and len(places) < 8:
        best = int(np.argmax(np.where(open_votes, counts, -1)))
        near = tree.query_ball_point(votes[best], 2.0 * together * radius)
        places.append(np.median(votes[near], axis=0))
        open_votes[tree.query_ball_point(votes[best], radius)] = False
    return places


def _fitted(points: FloatArray, tree: KDTree, centre: FloatArray, radius: float) -> Ball | None:
    """The fit of a ball near a centre by Gauss and Newton with Tukey's weights; None if none is."""
    # Of Tukey's biweight, with an efficiency of 95 %.
    tukey = 4.685
    start, used = centre, np.zeros(0, dtype=np.intp)
    # So near the surface, in radii, a point is taken for one of the ball's at first.
    spread = 0.3 * radius / tukey
    weight = np.zeros(0)
    for _ in range(25):
        used = np.array(tree.query_ball_point(centre, radius + tukey * spread), dtype=np.intp)
        used = used[_turned_to_us(points[used], centre)]
        if len(used) < FEWEST:
            return None
        away, distance = _from(points[used], centre)
        off = distance - radius
        # From the whole neighbourhood to what lies on the surface.
        near = np.abs(off) < tukey * spread
        spread = min(spread, max(_robust(off[near]), 1e-6 * radius))
        weight = np.maximum(1.0 - (off / (tukey * spread)) ** 2, 0.0) ** 2
        root = np.sqrt(weight)
        step = np.linalg.lstsq(away * root[:, None], off * root, rcond=None)[0]
        centre = np.asarray(centre + step)
        if np.linalg.norm(centre - start) > radius:
            return None
        if np.linalg.norm(step) < 1e-7 * radius:
            break
    on = weight > 0
    return _judged(points, tree, used[on], centre, radius)


def _judged(
    points: FloatArray, tree: KDTree, on: IntArray, centre: FloatArray, radius: float
) -> Ball | None:
    """The ball with its ±, if what was fitted looks like one."""
    if len(on) < FEWEST:
        return None
    away, distance = _from(points[on], centre)
    off = distance - radius
    rms = float(np.sqrt(np.sum(off**2) / (len(on) - 3)))
    # Counted by area: near points are denser, not more of the ball.
    middle = away.mean(axis=0) / np.linalg.norm(away.mean(axis=0))
    reach = float(np.quantile(away @ middle, 0.05))
    inside = tree.query_ball_point(centre, radius - 4.0 * max(rms, 0.01 * radius))
    # RMS of the distances from the surface, in radii, above which it is no ball. How far from their
    # middle direction the points must reach, seen from the centre, as a cosine (35°): less is a
    # piece of any surface. Part of the points before it that may lie inside the ball: nothing is
    # seen through it.
    if rms > 0.1 * radius or reach > 0.82 or len(inside) > 0.2 * len(on):
        return None
    inliers = _alike(points[on], off)
    covariance = np.asarray(rms**2 * inliers * np.linalg.inv(away.T @ away), dtype=np.float64)
    # With the radius free: what other ball would fit as well?
    columns = np.column_stack([away, np.ones(len(on))])
    solved = np.linalg.lstsq(columns, off, rcond=None)[0]
    change, left = float(solved[3]), off - columns @ solved
    free = float(np.sum(left**2) / (len(on) - 4)) * _alike(points[on], left)
    std = float(np.sqrt(free * np.linalg.inv(columns.T @ columns)[3, 3]))
    return Ball(centre, covariance, len(on), rms, (radius + change, std), 0.0)


def _alike(points: FloatArray, off: FloatArray) -> float:
    """How many points say what one alone would: variance of sums of neighbours, over that of each.

    A stereo camera matches windows, so that neighbours err together.
    """
    count = min(len(points), _NEIGHBOURS)
    _, near = KDTree(points).query(points, k=count)
    together = off[near].mean(axis=1)
    variance = float(np.mean(off**2))
    return max(1.0, count * float(np.mean(together**2)) / variance) if variance > 0 else 1.0


def _turned_to_us(points: FloatArray, centre: FloatArray) -> BoolArray:
    """(n,) points where a ball's surface looks at the origin, but for its rim."""
    away, _ = _from(points, centre)
    ray = points / np.linalg.norm(points, axis=1)[:, None]
    # Cosine of the steepest angle at which the surface is looked at: beyond, at its rim, a depth
    # camera mixes the ball with what is behind it.
    return np.asarray(np.einsum("ni,ni->n", away, ray) < -0.5)


def _from(points: FloatArray, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Directions (n, 3) and distances (n,) of points from a centre."""
    offset = points - centre
    distance = np.maximum(np.linalg.norm(offset, axis=1), 1e-12)
    return offset / distance[:, None], distance


def _robust(values: FloatArray) -> float:
    """Standard deviation by the median of the sizes."""
    return float(np.median(np.abs(values))) / 0.6745
