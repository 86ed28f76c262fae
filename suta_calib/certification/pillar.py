"""What the touches of one pillar say, as differentiable functions of the touches.

All points are in the ground's frame: its middle, its principal axes, z up. The functions take the
ground's own small error as further inputs, so that uncertainty runs from every touch to every
coordinate by the chain rule, with exact derivatives from CasADi.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import casadi as ca
import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.symbols import Symbol, symbolic_rotation

# Rows of a pillar's answer.
X, Y, Z, SLOPE_X, SLOPE_Y, UNEVEN_X, UNEVEN_Y, DIAGONAL_02, DIAGONAL_13, YAW, WIDTH = range(11)
# Inputs about the ground: turns about x and y (rad), height (m).
GROUND: Final = 3
# Conditioning of the top's fit: its touches are millimetres apart.
_MM: Final = 1e-3


@dataclass(frozen=True, eq=False)
class PillarGeometry:
    """One pillar's numbers, and how they follow its touches and the ground.

    Attributes:
        values: (9,) or, with flats, (11,): x, y, z of the centre of its top (m), slopes of the top,
            distance between the middles of the two diagonals (x and y, m), their lengths (m), yaw
            of the direction from back to front (rad), distance of the flats (m).
        by_touch: (rows, 3 k) derivative by the touches: top, holes, front, back.
        by_ground: (rows, 3) by the ground's turn about x and y and its height.
    """

    values: FloatArray
    by_touch: FloatArray
    by_ground: FloatArray


def pillar_geometry(
    top: FloatArray, holes: FloatArray, flats: tuple[FloatArray, FloatArray] | None
) -> PillarGeometry:
    """Evaluate one pillar.

    Args:
        top: (k, 3) touches used, in the ground's frame, m.
        holes: (4, 3) in order around.
        flats: front and back (3,), or None.
    """
    touches = np.vstack([top, holes, *(flats or ())])
    outputs = _pillar(len(top), flats is not None)(touches.T, np.zeros(GROUND))
    values, by_touch, by_ground = (np.asarray(o.full(), dtype=float) for o in outputs)
    # CasADi's columns run over coordinates first: touches were given as 3 x k for that.
    return PillarGeometry(values[:, 0], by_touch, by_ground)


@lru_cache(maxsize=32)
def _pillar(tops: int, flats: bool) -> Any:
    touches = ca.SX.sym("touches", 3, tops + 4 + 2 * flats)
    ground = ca.SX.sym("ground", GROUND)
    level = levelled(touches, ground)
    top, hole = level[:, :tops], level[:2, tops : tops + 4]
    centre = crossing(hole)
    # Least squares plane through the top: its height at the centre, and its slopes.
    across = (top[:2, :] - ca.repmat(centre, 1, tops)).T / _MM
    design = ca.horzcat(ca.SX.ones(tops, 1), across)
    plane = ca.inv(design.T @ design) @ (design.T @ top[2, :].T)
    middle = (hole[:, 0] + hole[:, 2] - hole[:, 1] - hole[:, 3]) / 2
    diagonals = [ca.norm_2(hole[:, 2] - hole[:, 0]), ca.norm_2(hole[:, 3] - hole[:, 1])]
    rows = [centre, plane[0], plane[1:] / _MM, middle, *diagonals]
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

    Args:
        holes: in the ground's frame, m.
        least: smallest share of a diagonal on either side of the crossing.
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
