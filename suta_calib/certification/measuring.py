"""Raw points in the ground's frame, checked: every pillar's numbers.

What the touches of one pillar say is a differentiable function of the touches. All points are in
the ground's frame: its middle, its principal axes, z up. The functions take the ground's own small
error as further inputs, so that uncertainty runs from every touch to every coordinate by the chain
rule, with exact derivatives from CasADi.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import casadi as ca
import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.certification.plane import Plane, Top, fit_plane, judge_tops, on_a_line
from suta_calib.certification.points import Pillar, RawPoints
from suta_calib.errors import SamplesError
from suta_calib.geometry.symbols import Symbol, symbolic_rotation
from suta_calib.units import mm

# Rows of a pillar's answer.
CENTRE, SLOPES, UNEVEN, DIAGONALS = slice(0, 3), slice(3, 5), slice(5, 7), slice(7, 9)
YAW, WIDTH = 9, 10
# Inputs about the ground: turns about x and y (rad), height (m).
GROUND: Final = 3


@dataclass(frozen=True, eq=False)
class PillarGeometry:
    """One pillar's numbers, and how they follow its touches and the ground."""

    # (9,) or, with flats, (11,): x, y, z of the centre of its top (m), slopes of the top, distance
    # between the middles of the two diagonals (x and y, m), their lengths (m), yaw of the direction
    # from back to front (rad), distance of the flats (m).
    values: FloatArray
    by_touch: FloatArray  # (rows, 3 k) derivative by the touches: top, holes, front, back
    by_ground: FloatArray  # (rows, 3) by the ground's turn about x and y and its height


@lru_cache(maxsize=32)
def _pillar(tops: int, flats: bool) -> Any:
    touches = ca.SX.sym("touches", 3, tops + 4 + 2 * flats)
    ground = ca.SX.sym("ground", GROUND)
    level = levelled(touches, ground)
    top, hole = level[:, :tops], level[:2, tops : tops + 4]
    centre = crossing(hole)
    # Least squares plane through the top: its height at the centre, and its slopes. Touches are
    # millimetres apart, which conditions the fit.
    mm_apart = 1e-3
    across = (top[:2, :] - ca.repmat(centre, 1, tops)).T / mm_apart
    design = ca.horzcat(ca.SX.ones(tops, 1), across)
    plane = ca.inv(design.T @ design) @ (design.T @ top[2, :].T)
    middle = (hole[:, 0] + hole[:, 2] - hole[:, 1] - hole[:, 3]) / 2
    diagonals = [ca.norm_2(hole[:, 2] - hole[:, 0]), ca.norm_2(hole[:, 3] - hole[:, 1])]
    rows = [centre, plane[0], plane[1:] / mm_apart, middle, *diagonals]
    if flats:
        ahead = level[:2, tops + 4] - level[:2, tops + 5]
        rows += [ca.atan2(ahead[1], ahead[0]), ca.norm_2(ahead)]
    value = ca.vertcat(*rows)
    derivatives = [ca.jacobian(value, ca.vec(touches)), ca.jacobian(value, ground)]
    return ca.Function("pillar", [touches, ground], [value, *derivatives], {"cse": True})


def levelled(points: Symbol, ground: Symbol) -> Symbol:
    """Points (3, k) as seen from a ground that is turned and raised by ``ground``."""
    turn = symbolic_rotation(ca.vertcat(ground[0], ground[1], 0))
    return turn.T @ points - ca.repmat(ca.vertcat(0, 0, ground[2]), 1, points.shape[1])


def crossing(hole: Symbol) -> Symbol:
    """Where the diagonals 0-2 and 1-3 of four points (2, 4) cross."""
    a, b = hole[:, 2] - hole[:, 0], hole[:, 3] - hole[:, 1]
    start = hole[:, 1] - hole[:, 0]
    share = (start[0] * b[1] - start[1] * b[0]) / (a[0] * b[1] - a[1] * b[0])
    return hole[:, 0] + share * a


def diagonals_cross(holes: FloatArray, least: float) -> bool:
    """Whether the diagonals 0-2 and 1-3 of (4, 2 or 3) points cross well inside both.

    Well means with at least the share ``least`` of a diagonal on either side.
    """
    a, b = holes[2, :2] - holes[0, :2], holes[3, :2] - holes[1, :2]
    start = holes[1, :2] - holes[0, :2]
    lengths = np.linalg.norm(a) * np.linalg.norm(b)
    cross = a[0] * b[1] - a[1] * b[0]
    if lengths == 0.0 or abs(cross) < least * lengths:
        return False
    s = (start[0] * b[1] - start[1] * b[0]) / cross
    u = (start[0] * a[1] - start[1] * a[0]) / cross
    return bool(least < s < 1 - least and least < u < 1 - least)


def order_around(holes: FloatArray) -> tuple[int, ...]:
    """Indices of (4, 2 or 3) points in order around their middle, from 0 on."""
    away = holes[:, :2] - holes[:, :2].mean(axis=0)
    order = np.argsort(np.arctan2(away[:, 1], away[:, 0]))
    start = int(np.flatnonzero(order == 0)[0])
    return tuple(int(k) for k in np.roll(order, -start))


@dataclass(frozen=True, eq=False)
class MeasuredArtefact:
    """Everything before a frame is chosen."""

    ground: Plane  # the plane; its axes and centre are the ground's frame
    ground_points: FloatArray  # (n, 3) its touches in use, in that frame, m
    pillars: tuple[Pillar, ...]  # what was touched, in the file's order
    tops: tuple[Top, ...]  # each top, judged
    geometry: tuple[PillarGeometry, ...]  # each pillar's numbers, in that frame


def measure(raw: RawPoints, sigma: float | None) -> MeasuredArtefact:
    """Fit the ground, judge the tops and work out every pillar; ``sigma`` (m) is a stated noise.

    Raises:
        SamplesError: touches that define no plane or no centre, and which.
    """
    ground = _ground(raw, sigma)

    def local(points: FloatArray) -> FloatArray:
        return np.asarray((points - ground.centre) @ ground.axes.T)

    tops = [local(p.top.position) for p in raw.pillars]
    holes = [local(p.holes.position) for p in raw.pillars]
    for pillar, top, hole in zip(raw.pillars, tops, holes, strict=True):
        _check_pillar(raw, pillar, top, hole)
    judged = judge_tops(tops, sigma, ground.scatter.sigma)
    geometry = []
    for pillar, points, hole, verdict in zip(raw.pillars, tops, holes, judged, strict=True):
        flats = [local(flat) for flat in (pillar.front, pillar.back) if flat is not None]
        # CasADi's columns run over coordinates first: touches are given as 3 x k for that.
        touches = np.vstack([points[verdict.inliers], hole, *flats]).T
        outputs = _pillar(int(verdict.inliers.sum()), len(flats) > 0)(touches, np.zeros(GROUND))
        values, by_touch, by_ground = (np.asarray(o.full(), dtype=float) for o in outputs)
        geometry.append(PillarGeometry(values[:, 0], by_touch, by_ground))
    inside = local(raw.ground.position[ground.inliers])
    return MeasuredArtefact(ground, inside, raw.pillars, judged, tuple(geometry))


def _ground(raw: RawPoints, sigma: float | None) -> Plane:
    """The ground, its normal towards the tops."""
    if on_a_line(raw.ground.position, sigma or 0.0):
        raise SamplesError(
            f"{len(raw.ground)} touches of the ground that lie on a line",
            "touches spread over the plane",
            file=raw.path,
            where="ground",
        )
    plane = fit_plane(raw.ground.position, sigma)
    heights = [float(np.mean((p.top.position - plane.centre) @ plane.axes[2])) for p in raw.pillars]
    if np.median(heights) < 0:
        # A half turn about the plane's first axis keeps the frame right-handed.
        plane = Plane(plane.centre, plane.axes * [[1], [-1], [-1]], plane.inliers, -plane.residuals)
    return plane


def _check_pillar(raw: RawPoints, pillar: Pillar, top: FloatArray, holes: FloatArray) -> None:
    where, first = f"landmark {pillar.name!r}", pillar.top.lines[0]
    # Share of a diagonal on either side of the crossing below which holes cannot be in order.
    if not diagonals_cross(holes, 0.2):
        order, lines = order_around(holes), ", ".join(map(str, pillar.holes.lines))
        hint = f"their order around the pillar is {' '.join(map(str, order))}"
        if order in ((0, 1, 2, 3), (0, 3, 2, 1)):
            hint = "one of them belongs to another landmark"
        raise SamplesError(
            f"holes (lines {lines}) whose diagonals 0-2 and 1-3 do not cross each other",
            "four holes 0 1 2 3 in order around the pillar",
            file=raw.path,
            where=where,
            hint=hint,
        )
    if on_a_line(top * [1, 1, 0], 0.0):
        defect = f"{len(top)} touches of its top that lie on a line"
        spread = "touches spread over the top"
        raise SamplesError(defect, spread, file=raw.path, line=first, where=where)
    distance = float(np.hypot(*(top.mean(axis=0) - holes.mean(axis=0))[:2]))
    around = float(np.linalg.norm(holes - holes.mean(axis=0), axis=1).max())
    if distance > 2.0 * around:
        raise SamplesError(
            f"a top {mm(distance):.1f} mm away from the middle of its holes",
            f"a top within {mm(2.0 * around):.1f} mm of the middle of its holes",
            file=raw.path,
            line=first,
            where=where,
            hint="check whether both belong to this landmark",
        )
