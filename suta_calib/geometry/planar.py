"""Circles and lines in profiles: what most of the points of a piece of one lie on.

Every candidate goes through three points at equal steps along the profile, or two; the one that
most points lie on is fitted to these. Nothing is random, so that one profile always gives one
answer.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray

# Points that tell a circle, or a line, from what noise and edges make.
FEWEST_POINTS: Final = 12
# Points belong to a curve within so many standard deviations of their noise.
_NEAR: Final = 4.0


class Circle(NamedTuple):
    """A circle of which an arc was seen.

    Attributes:
        centre: (2,), m.
        radius: m.
        on: (n,) the points that are on the arc.
        scatter: of these about it, m.
    """

    centre: FloatArray
    radius: float
    on: BoolArray
    scatter: float


class PlanarLine(NamedTuple):
    """A line of which a piece was seen.

    Attributes:
        ends: (2, 2) of the piece, m.
        on: (n,) the points that are on it.
        scatter: of these about it, m.
    """

    ends: FloatArray
    on: BoolArray
    scatter: float


def profile_noise(points: FloatArray) -> float:
    """Standard deviation of z, m, from second differences: whatever the surface is.

    It is that of the quieter parts: beside a shiny ball half of a profile may be reflections.
    """
    bend = np.abs(np.diff(points[:, 1], 2))
    # m: no scanner is better, and a quantised profile seems to have no noise at all.
    least_noise = 2e-6
    if not len(bend):
        return least_noise
    parts = np.array_split(bend, max(len(bend) // 40, 1))
    # 1.4826 of the median of |x| is σ, and the variance of a second difference is 6 σ².
    sigma = [1.4826 * float(np.median(part)) / np.sqrt(6.0) for part in parts]
    return max(float(np.quantile(sigma, 0.25)), least_noise)


def circle_in(points: FloatArray, largest: float = np.inf) -> Circle | None:
    """The circle of which most points (n, 2) show an arc; None where there is none.

    Args:
        points: of a profile, in its order, m.
        largest: radius, m.
    """
    n = len(points)
    if n < FEWEST_POINTS:
        return None
    noise = profile_noise(points)
    # Chords and sections differ from a circle by noise, and by the ball's own errors of form.
    near = max(_NEAR * noise, 1e-5)
    # Of a larger one no profile shows enough: a table is no part of a ball.
    # Of a circle, how much must be seen: of less, curvature is not told from a bent surface.
    least_arc = np.radians(25.0)
    widest = float(np.ptp(points[:, 0])) / (2.0 * np.sin(least_arc / 2.0))
    most = min(largest * 1.01 + near, widest)
    rows = _spread_rows(n, 3)
    centre, radius = _through(points[rows])
    with np.errstate(invalid="ignore"):
        possible = np.isfinite(radius) & (radius <= most) & (radius > 3.0 * near)
    centre, radius = centre[possible], radius[possible]
    voters, enough = _voters(points)
    best, votes = None, 0
    # Some at a time: of a long profile all take much memory.
    for first in range(0, len(centre), 64):
        centres, of_some = centre[first : first + 64], radius[first : first + 64]
        away = np.linalg.norm(voters - centres[:, None], axis=2) - of_some[:, None]
        count = np.sum(np.abs(away) < near, axis=1)
        k = int(np.argmax(count))
        if count[k] > votes:
            best, votes = (centres[k], float(of_some[k])), int(count[k])
    if best is None or votes < enough:
        return None
    c, r = best
    on = np.zeros(n, dtype=np.bool_)
    scatter = noise
    for _ in range(20):
        away = np.linalg.norm(points - c, axis=1) - r
        inside = _one_side(points, c, np.abs(away) < max(_NEAR * scatter, near))
        if inside.sum() < FEWEST_POINTS:
            return None
        if np.array_equal(inside, on):
            break
        on = inside
        c, r = fitted_circle(points[on])
        away = np.linalg.norm(points[on] - c, axis=1) - r
        # What an edge adds must not widen what counts as near.
        scatter = min(max(1.4826 * float(np.median(np.abs(away))), noise), 2.0 * scatter)
    if not np.isfinite(r) or r > most or _seen_angle(points[on] - c) < least_arc:
        return None
    return Circle(c, r, on, float(np.std(np.linalg.norm(points[on] - c, axis=1))))


def line_in(points: FloatArray) -> PlanarLine | None:
    """The line on which most points (n, 2) lie; None where there is none."""
    n = len(points)
    if n < FEWEST_POINTS:
        return None
    noise = profile_noise(points)
    near = max(_NEAR * noise, 1e-5)
    rows = _spread_rows(n, 2)
    start, along = points[rows[:, 0]], points[rows[:, 1]] - points[rows[:, 0]]
    length = np.linalg.norm(along, axis=1)
    start, along = start[length > 0], along[length > 0] / length[length > 0][:, None]
    normal = np.column_stack([-along[:, 1], along[:, 0]])
    voters, enough = _voters(points)
    best, votes = None, 0
    for first in range(0, len(start), 64):
        batch = slice(first, first + 64)
        away = np.einsum("mni,mi->mn", voters - start[batch, None], normal[batch])
        count = np.sum(np.abs(away) < near, axis=1)
        k = int(np.argmax(count))
        if count[k] > votes:
            row = first + k
            best, votes = np.abs((points - start[row]) @ normal[row]) < near, int(count[k])
    if best is None or votes < enough:
        return None
    on, scatter = best, noise
    for _ in range(20):
        middle = points[on].mean(axis=0)
        across = np.linalg.svd(points[on] - middle, full_matrices=False)[2][1]
        away = (points - middle) @ across
        scatter = min(max(1.4826 * float(np.median(np.abs(away[on]))), noise), 2.0 * scatter)
        inside = np.abs(away) < max(_NEAR * scatter, near)
        if np.array_equal(inside, on) or inside.sum() < FEWEST_POINTS:
            break
        on = inside
    return PlanarLine(piece_of_line(points[on]), on, float(np.std(away[on])))


def piece_of_line(points: FloatArray) -> FloatArray:
    """Two points (2, 2) on the line of least squares through points (n, 2).

    They say of any line what all the points say of it: their mean and their moment are the same.
    """
    middle = points.mean(axis=0)
    _, singular, axes = np.linalg.svd(points - middle, full_matrices=False)
    half = singular[0] / np.sqrt(len(points)) * axes[0]
    return np.array([middle - half, middle + half])


def fitted_circle(points: FloatArray) -> tuple[FloatArray, float]:
    """Centre (2,) and radius of the circle of least squares through points (n, 2)."""
    middle = points.mean(axis=0)
    p = points - middle
    square = np.sum(p**2, axis=1)
    solved = np.linalg.lstsq(np.column_stack([2.0 * p, np.ones(len(p))]), square, rcond=None)[0]
    c, r = solved[:2], float(np.sqrt(max(solved[2] + solved[:2] @ solved[:2], 0.0)))
    for _ in range(10):
        away = p - c
        distance = np.maximum(np.linalg.norm(away, axis=1), 1e-300)
        slope = np.column_stack([away / distance[:, None], np.ones(len(p))])
        step = np.linalg.lstsq(slope, distance - r, rcond=None)[0]
        c, r = c + step[:2], r + float(step[2])
        if np.abs(step).max() < 1e-12:
            break
    return c + middle, r


def _voters(points: FloatArray) -> tuple[FloatArray, float]:
    """Points that vote on candidates, and how many of them must agree."""
    step = -(-len(points) // 300)
    return points[::step], max(FEWEST_POINTS / step, 4.0)


def _spread_rows(n: int, count: int) -> IntArray:
    """(m, count) rows at equal steps, for candidates."""
    row_sets = []
    # Candidates are through points that are so large a part of the profile apart.
    for part in (0.02, 0.04, 0.08, 0.15, 0.3, 0.45):
        step = max(int(part * n), 2)
        last = n - 1 - (count - 1) * step
        if last < 0:
            continue
        # First points of candidates, per step.
        first = np.unique(np.linspace(0, last, min(80, last + 1)).astype(np.intp))
        row_sets.append(first[:, None] + step * np.arange(count))
    return np.concatenate(row_sets) if row_sets else np.zeros((0, count), dtype=np.intp)


def _through(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centres (m, 2) and radii (m,) of the circles through three points (m, 3, 2)."""
    a, b, c = points[:, 0], points[:, 1], points[:, 2]
    u, v = b - a, c - a
    twice = 2.0 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    uu, vv = np.sum(u**2, axis=1), np.sum(v**2, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (v[:, 1] * uu - u[:, 1] * vv) / twice
        z = (u[:, 0] * vv - v[:, 0] * uu) / twice
    offset = np.column_stack([x, z])
    return a + offset, np.linalg.norm(offset, axis=1)


def _one_side(points: FloatArray, centre: FloatArray, near: BoolArray) -> BoolArray:
    """Of points near a circle, those on the side of it that the scanner sees: most of them."""
    above = points[:, 1] > centre[1]
    return np.asarray(near & (above if 2 * np.sum(above & near) > near.sum() else ~above))


def _seen_angle(away: FloatArray) -> float:
    """How large an angle points (n, 2) about a centre span, rad."""
    angle = np.unwrap(np.sort(np.arctan2(away[:, 1], away[:, 0])))
    gaps = np.diff([*angle, angle[0] + 2.0 * np.pi])
    return float(2.0 * np.pi - gaps.max())
