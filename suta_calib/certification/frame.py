"""From pillars in the ground's frame to landmarks in the artefact's, with full covariance.

The artefact's frame: z is the ground's normal, up towards the tops; height is counted from the
ground; x and y are zero at one landmark, the origin; x points along the side plane, with the
artefact on its left, so that y points from the side plane into the artefact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, Final, Literal

import casadi as ca
import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.certification.comparison import QUARTER, quarter_turns
from suta_calib.certification.measuring import (
    CENTRE,
    GROUND,
    YAW,
    MeasuredArtefact,
    PillarGeometry,
    levelled,
)
from suta_calib.certification.noise import ProbingNoise
from suta_calib.certification.plane import agreeing
from suta_calib.certification.points import CertificationOptions, RawPoints
from suta_calib.certification.scatter import Scatter
from suta_calib.errors import ArtefactError, SamplesError, did_you_mean
from suta_calib.geometry.numbers import right_singular, skew, wrap
from suta_calib.measurements import Artefact

Source = Literal["side plane", "farthest landmark"]
ORIGIN: Final = "O"


@dataclass(frozen=True, eq=False)
class Heading:
    """Direction of the side plane in the ground's frame: the artefact's x axis."""

    angle: float  # from the ground frame's x axis, rad
    by_touch: FloatArray  # (3 k) derivative by the side's touches used
    by_ground: FloatArray  # (3) derivative by the ground's small error
    inliers: BoolArray  # (n,) touches of the side that are used
    residuals: FloatArray  # (n,) of all its touches from the plane, m
    scatter: Scatter  # of the side's touches about its plane


def heading_of(raw: RawPoints, measured: MeasuredArtefact, noise: float) -> Heading | None:
    """Along the side plane's line in the ground, with the artefact on its left; None without side.

    Where the touches differ in height, the side may lean: its line at the height of the ground
    counts, not the touches' projection. ``noise`` is a touch's standard deviation, m.
    """
    if raw.side is None:
        return None
    side = (raw.side.position - measured.ground.centre) @ measured.ground.axes.T
    if np.ptp(side[:, :2], axis=0).max() < max(1e-3, 100 * noise):
        raise SamplesError(
            "touches of the side that are within a millimetre of each other",
            "touches along the side, as far apart as possible",
            file=raw.path,
            line=raw.side.lines[0],
            where="side",
        )
    middle = np.mean([g.values[:2] for g in measured.geometry], axis=0)
    # Heights that differ less say nothing of how upright the side is (m).
    leaning = len(side) > 4 and float(np.std(side[:, 2])) > 2e-3
    columns = 2 + leaning

    def fit(rows: BoolArray) -> tuple[FloatArray, FloatArray]:
        centre, turn = _lined_up(side[rows, :2], middle)
        along, across = ((side[:, :2] - centre) @ turn.T).T
        design = np.column_stack([np.ones(len(side)), along, side[:, 2]])[:, :columns]
        return across - design @ np.linalg.lstsq(design[rows], across[rows], rcond=None)[0], design

    used = agreeing(fit, len(side), columns, noise)
    _, turn = _lined_up(side[used, :2], middle)
    outputs = _side(int(used.sum()), leaning)(
        side[used].T, np.zeros(GROUND), np.arctan2(turn[0, 1], turn[0, 0])
    )
    angle, by_touch, by_ground = (np.asarray(o.full(), dtype=float).reshape(-1) for o in outputs)
    residuals = fit(used)[0]
    scatter = Scatter(float(np.sum(residuals[used] ** 2)), int(used.sum()) - columns)
    return Heading(float(angle[0]), by_touch, by_ground, used, residuals, scatter)


def _lined_up(points: FloatArray, middle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centre and rotation (2, 2) into a frame along the points, ``middle`` on its left."""
    centre = points.mean(axis=0)
    along = right_singular(points - centre)[1][0]
    across = np.array([-along[1], along[0]])
    sign = 1.0 if across @ (middle - centre) >= 0 else -1.0
    return centre, sign * np.array([along, across])


@lru_cache(maxsize=16)
def _side(count: int, leaning: bool) -> Any:
    touches, ground = ca.SX.sym("touches", 3, count), ca.SX.sym("ground", GROUND)
    start = ca.SX.sym("start")
    x, y, z = ca.horzsplit(levelled(touches, ground).T)
    along = ca.cos(start) * x + ca.sin(start) * y
    across = ca.cos(start) * y - ca.sin(start) * x
    # The slope along the ground is the same at any height.
    columns = [column - ca.sum1(column) / count for column in [along, z][: 1 + leaning]]
    matrix = ca.horzcat(ca.SX.ones(count, 1), *columns)
    line = ca.inv(matrix.T @ matrix) @ (matrix.T @ across)
    angle = start + ca.atan(line[1])
    derivatives = [ca.jacobian(angle, ca.vec(touches)), ca.jacobian(angle, ground)]
    return ca.Function("side", [touches, ground, start], [angle, *derivatives], {"cse": True})


@dataclass(frozen=True, eq=False)
class Sources:
    """Everything that was touched and used, as columns of one Jacobian."""

    sigma: FloatArray  # (c,) standard deviation of each touched coordinate, m
    ground: FloatArray  # (3, c) the ground's small error by them: turns about x and y, height
    pillars: tuple[slice, ...]  # for each landmark the columns of its touches
    side: slice  # columns of the side's touches

    @property
    def touched_ground(self) -> slice:
        """Columns of the ground's touches."""
        return slice(0, self.pillars[0].start)

    def jacobians(self, pillars: Sequence[PillarGeometry]) -> list[FloatArray]:
        """(rows, c) derivative of each pillar's numbers by everything touched."""
        derivatives = [geometry.by_ground @ self.ground for geometry in pillars]
        for full, geometry, columns in zip(derivatives, pillars, self.pillars, strict=True):
            full[:, columns] += geometry.by_touch
        return derivatives

    def heading_jacobian(self, heading: Heading) -> FloatArray:
        """(c,) derivative of the side's direction by everything touched."""
        full = np.asarray(heading.by_ground @ self.ground)
        full[self.side] += heading.by_touch
        return full

    def std(self, row: FloatArray) -> float:
        """Standard deviation of a number with the derivative (c,), in its unit."""
        return float(np.linalg.norm(row * self.sigma))


def sources_of(measured: MeasuredArtefact, heading: Heading | None, noise: ProbingNoise) -> Sources:
    """What was touched and is used, with the noise of every coordinate.

    A plane by least squares turns and rises with its touches' heights dz as
    ``(Σ Y dz / Σ Y², -Σ X dz / Σ X², mean dz)`` along its principal axes X and Y.
    """
    n = len(measured.ground_points)
    sigmas = [np.full(3 * n, noise.ground)]
    for pillar, top in zip(measured.pillars, measured.tops, strict=True):
        touch_sigmas = [noise.touch] * int(top.inliers.sum()) + [noise.of("hole")] * len(
            pillar.holes
        )
        if pillar.front is not None:
            touch_sigmas += [noise.touch * count**-0.5 for count in pillar.flat_counts]
        sigmas.append(np.repeat(touch_sigmas, 3))
    side_touches = 0 if heading is None else int(heading.inliers.sum())
    sigmas.append(np.full(3 * side_touches, noise.of("side")))
    x, y = measured.ground_points[:, 0], measured.ground_points[:, 1]
    sigma = np.concatenate(sigmas)
    ground = np.zeros((GROUND, len(sigma)))
    ground[:, 2 : 3 * n : 3] = y / (y @ y), -x / (x @ x), np.full(n, 1.0 / n)
    edges = np.cumsum([len(s) for s in sigmas])
    *pillars, side = (slice(int(a), int(b)) for a, b in pairwise(edges))
    return Sources(sigma, ground, tuple(pillars), side)


@dataclass(frozen=True, eq=False)
class Placed:
    """Landmarks in the artefact's frame."""

    position: FloatArray  # (n, 3), m
    by: FloatArray  # (n, 3, c) its derivative by everything touched
    yaw: FloatArray  # (n,) direction of the flats, rad; NaN without
    yaw_by: FloatArray  # (n, c)
    heading_by: FloatArray  # (c,) derivative of the x axis's direction in the ground's frame
    turned: int = 0  # quarter turns from the side to x, where a drawing says so


def placed_in_frame(
    measured: MeasuredArtefact,
    jacobians: Sequence[FloatArray],
    heading: Heading | None,
    by: Sources,
    origin: int,
    drawing: Artefact | None,
) -> Placed:
    """Landmarks in the artefact's frame, turned by quarters to be as in the drawing.

    ``jacobians`` are of each pillar by everything touched (``by``), ``heading`` is the side's
    direction if one was touched, ``origin`` the landmark that counts as the origin.
    """
    if heading is None:
        angle, angle_by = _towards_farthest(measured, jacobians, origin, drawing)
        return _placed(measured.geometry, jacobians, origin, angle, angle_by)
    angle, angle_by = heading.angle, by.heading_jacobian(heading)
    where = _placed(measured.geometry, jacobians, origin, angle, angle_by)
    if drawing is None:
        return where
    turned = quarter_turns([p.name for p in measured.pillars], where.position, drawing)
    where = _placed(measured.geometry, jacobians, origin, angle - turned * QUARTER, angle_by)
    return replace(where, turned=turned)


def _placed(
    pillars: Sequence[PillarGeometry],
    jacobians: Sequence[FloatArray],
    origin: int,
    angle: float,
    angle_by: FloatArray,
) -> Placed:
    """Turn by the heading, and count x and y from the origin."""
    local = np.array([g.values[CENTRE] for g in pillars])
    by = np.array([j[CENTRE] for j in jacobians])
    local[:, :2] -= local[origin, :2].copy()
    by[:, :2] -= by[origin, :2].copy()
    c, s = np.cos(angle), np.sin(angle)
    back = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    position = local @ back.T
    # A heading that turns one way turns everything else the other way.
    lever = np.stack([position[:, 1], -position[:, 0], 0 * position[:, 2]], axis=1)
    turned = np.einsum("ij,njc->nic", back, by) + lever[..., None] * angle_by
    has = [len(g.values) > YAW for g in pillars]
    yaw = np.array([g.values[YAW] if h else np.nan for g, h in zip(pillars, has, strict=True)])
    yaw_by = np.array([j[YAW] if h else 0 * angle_by for j, h in zip(jacobians, has, strict=True)])
    return Placed(position, turned, wrap(yaw - angle), yaw_by - angle_by, angle_by)


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


def origin_of(names: Sequence[str], options: CertificationOptions) -> int:
    """Which landmark has x = y = 0: the one asked for, ``O``, or the first."""
    origin = options.origin or (ORIGIN if ORIGIN in names else names[0])
    if origin not in names:
        raise ArtefactError(
            f"no touches of landmark {origin!r}",
            f"one of {', '.join(names)}",
            where="origin",
            hint=did_you_mean(origin, names),
        )
    return names.index(origin)


def _towards_farthest(
    measured: MeasuredArtefact,
    jacobians: Sequence[FloatArray],
    origin: int,
    drawing: Artefact | None,
) -> tuple[float, FloatArray]:
    """Without a side: x from the origin to the landmark farthest from it, or as it is drawn."""
    centres = np.array([g.values[:2] for g in measured.geometry])
    away = centres - centres[origin]
    names = [pillar.name for pillar in measured.pillars]
    candidates = [k for k, n in enumerate(names) if drawing is None or n in drawing.landmarks]
    far = max(candidates, key=lambda k: float(away[k] @ away[k]), default=origin)
    if not away[far].any():
        return 0.0, np.zeros(jacobians[0].shape[1])
    angle = float(np.arctan2(away[far, 1], away[far, 0]))
    by = jacobians[far][:2] - jacobians[origin][:2]
    angle_by = np.array([-away[far, 1], away[far, 0]]) @ by / (away[far] @ away[far])
    if drawing is not None and names[origin] in drawing.landmarks:
        drawn = np.diff(drawing.position_of([names[origin], names[far]]), axis=0)[0]
        angle -= float(np.arctan2(drawn[1], drawn[0]))
    return angle, angle_by
