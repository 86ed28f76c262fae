"""Which way the artefact's x axis points: along its side plane, or by convention."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, Literal

import casadi as ca
import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.certification.pillar import GROUND, levelled
from suta_calib.certification.plane import agreeing
from suta_calib.geometry.symbols import Symbol

Source = Literal["side plane", "farthest landmark"]
# Heights of the side's touches that differ less say nothing of how upright it is (m).
UPRIGHT: Final = 2e-3


@dataclass(frozen=True, eq=False)
class Heading:
    """Direction of the artefact's x axis in the ground's frame.

    Attributes:
        source: what it was taken from.
        angle: from the ground frame's x axis, rad.
        by_touch: (3 k) derivative by the side's touches used; empty without a side.
        by_ground: (3) derivative by the ground's small error.
        inliers: (n,) touches of the side that are used.
        residuals: (n,) of all its touches from the plane, m.
        rms: scatter of the side's touches about its plane, m.
    """

    source: Source
    angle: float
    by_touch: FloatArray
    by_ground: FloatArray
    inliers: BoolArray
    residuals: FloatArray
    rms: float


def side_heading(side: FloatArray, middle: FloatArray, noise: float) -> Heading:
    """Along the side plane's line in the ground, with the artefact on its left.

    Where the touches differ in height, the side may lean: its line at the height of the ground
    counts, not the touches' projection.

    Args:
        side: (n, 3) touches in the ground's frame, m.
        middle: (2,) middle of the landmarks: y points from the side towards it.
        noise: standard deviation of a touch, m.
    """
    leaning = len(side) > 4 and float(np.std(side[:, 2])) > UPRIGHT
    columns = 3 if leaning else 2

    def fit(rows: BoolArray) -> tuple[FloatArray, FloatArray]:
        centre, turn = _lined_up(side[rows, :2], middle)
        along, across = ((side[:, :2] - centre) @ turn.T).T
        design = np.column_stack([np.ones(len(side)), along, side[:, 2]])[:, :columns]
        return across - design @ np.linalg.lstsq(design[rows], across[rows], rcond=None)[0], design

    used = agreeing(fit, len(side), columns, noise)
    _, turn = _lined_up(side[used, :2], middle)
    start = float(np.arctan2(turn[0, 1], turn[0, 0]))
    function = _side(int(used.sum()), leaning)
    outputs = function(side[used].T, np.zeros(GROUND), start)
    angle, by_touch, by_ground = (np.asarray(o.full(), dtype=float).reshape(-1) for o in outputs)
    freedom = int(used.sum()) - columns
    residuals = fit(used)[0]
    squared = float(np.sum(residuals[used] ** 2))
    rms = float(np.sqrt(squared / freedom)) if freedom > 0 else 0.0
    return Heading("side plane", float(angle[0]), by_touch, by_ground, used, residuals, rms)


def _lined_up(points: FloatArray, middle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centre and rotation (2, 2) into a frame along the points, ``middle`` on its left."""
    centre = points.mean(axis=0)
    along = np.linalg.svd(points - centre)[2][0]
    across = np.array([-along[1], along[0]])
    sign = 1.0 if across @ (middle - centre) >= 0 else -1.0
    return centre, sign * np.array([along, across])


@lru_cache(maxsize=16)
def _side(count: int, leaning: bool) -> Any:
    touches, ground = ca.SX.sym("touches", 3, count), ca.SX.sym("ground", GROUND)
    start = ca.SX.sym("start")
    level = levelled(touches, ground)
    along, across = _turned(level, start)
    design = [ca.SX.ones(count, 1), _centred(along)]
    if leaning:
        # The slope along the ground is the same at any height.
        design.append(_centred(level[2, :].T))
    matrix = ca.horzcat(*design)
    found = ca.inv(matrix.T @ matrix) @ (matrix.T @ across)
    angle = start + ca.atan(found[1])
    derivatives = [ca.jacobian(angle, ca.vec(touches)), ca.jacobian(angle, ground)]
    return ca.Function("side", [touches, ground, start], [angle, *derivatives], {"cse": True})


def _centred(column: Symbol) -> Symbol:
    return column - ca.dot(column, ca.SX.ones(*column.shape)) / column.shape[0]


def _turned(points: Symbol, angle: Symbol) -> tuple[Symbol, Symbol]:
    cosine, sine = ca.cos(angle), ca.sin(angle)
    x, y = points[0, :].T, points[1, :].T
    return cosine * x + sine * y, cosine * y - sine * x
