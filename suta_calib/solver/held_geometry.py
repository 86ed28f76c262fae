"""What geometry that a job holds at nominal does to an estimate, where no residual shows it.

Points, planes and lines that are touched know no length: the arm's lengths are then as good as the
one that is held. With h the held parameters, known to T by the drawing, and x what is estimated,

    dx̂/dh = -A_xx⁻¹ A_xh
    I = A_hh - A_hx A_xx⁻¹ A_xh                information of the data on h, x following

A direction of h about which the data say less than the drawing (an eigenvalue of I in units of T
below `SILENT`) leaves no residual. Its error δ is in the estimate, as -A_xx⁻¹ A_xh δ, and in what
is held, as δ. Where these two cancel at the tip it is a convention, and adds nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.numbers import skew
from suta_calib.measurements.scale import GRADES
from suta_calib.model.parameters import OFFSET, POSITION, ROTATION, ParameterSet
from suta_calib.solver.information import curvature_at, noise_levels, scaled_inverse
from suta_calib.solver.problem import Problem
from suta_calib.units import from_deg, from_mm

# Information in units of the drawing's, below which the drawing alone says what a direction is.
SILENT: Final = 0.1
# Cosine, in units of the tolerances, from which on a direction is a factor on all lengths: two that
# do the same, such as a slide of a joint along its axis, share it and have 0.7.
MOSTLY_ALONG: Final = 0.5
# Of one dimension, beside the common factor of the grade, as a standard deviation: a length in m
# and an angle in rad. Machined: ISO 2768-f has limits of 0.05 mm for short lengths and of 0.1 mm
# over 100 mm for angles. Printed: a layer, and a few tenths of a degree of warp.
TOLERANCES: Final = {
    "certified": (from_mm(0.005), from_deg(0.005)),
    "machined": (from_mm(0.05), from_deg(0.03)),
    "printed": (from_mm(0.2), from_deg(0.2)),
}
# Of an arm of which nobody says it, at least: what is estimated may show that it is worse.
ASSUMED: Final = "machined"


@dataclass(frozen=True, eq=False)
class HeldGeometry:
    """Errors, by one standard deviation, of held geometry that neither data nor tip are blind to.

    Attributes:
        names: (m,) the held parameters.
        nominal: (m,) their values, m and rad.
        tolerance: (m,) standard deviation of each by the drawing.
        of_estimate: (n, k) error of the estimate by each of k silent directions.
        of_held: (m, k) error of the held values by them.
        tip: (k,) motion of the tip by each, beside one of the whole arm: m, root mean square over
            the samples.
        tip_beside: the same, (), by what is estimated, if all that is held is right.
    """

    names: tuple[str, ...]
    nominal: FloatArray
    tolerance: FloatArray
    of_estimate: FloatArray
    of_held: FloatArray
    tip: FloatArray
    tip_beside: float

    @property
    def carriers(self) -> tuple[str, ...]:
        """Which of them the tip hangs on most, by one standard deviation of the worst direction."""
        share = np.abs(self.of_held[:, int(np.argmax(self.tip))]) / self.tolerance
        # Part of the largest from which on a held parameter is named.
        return tuple(self.names[k] for k in np.argsort(-share) if share[k] > 0.5 * share.max())

    @property
    def is_scale(self) -> bool:
        """Whether a direction that moves the tip makes all held lengths longer by one factor."""
        lengths = np.array([n.rpartition(".")[2] in POSITION for n in self.names])
        length = np.where(lengths, self.nominal, 0.0) / self.tolerance
        along = np.abs(length @ (self.of_held / self.tolerance[:, None]))
        sizes = np.linalg.norm(self.of_held / self.tolerance[:, None], axis=0)
        return bool(
            np.any(along > MOSTLY_ALONG * sizes * max(float(np.linalg.norm(length)), 1e-300))
        )

    @property
    def matters(self) -> bool:
        """Whether the tip is less sure by it than by noise alone."""
        # Of the tip's standard deviation by noise: then the whole is larger by a twentieth.
        return float(np.linalg.norm(self.tip)) > 0.3 * self.tip_beside


def held_geometry(
    problem: Problem,
    x: FloatArray,
    sigmas: Sequence[float],
    free: IntArray,
    within: FloatArray,
    *,
    robust: bool = True,
) -> HeldGeometry | None:
    """The held geometry of an arm, and what it does where no residual shows it.

    Args:
        problem: terms and parameters.
        x: (n,) the estimate.
        sigmas: noise level of each block.
        free: indices that were estimated.
        within: (n, n) covariance of the estimate if all that is held is right.
        robust: believe rows as Huber weighs them at x; not before the fit, as in
            `predicted_information`.

    Returns:
        None where nothing is held, or everything that is shows in the residuals.
    """
    arm = problem.arm
    if arm is None or not len(free):
        return None
    given = problem.arm_parameters
    names = [
        name
        for name in arm.parameters.names
        if (name in arm.geometric or name in arm.offsets)
        and (name not in given or not given[name].free)
    ]
    if not names:
        return None
    wider = Problem(
        problem.terms,
        ParameterSet([*given.values(), *(arm.offered[n] for n in names if n not in given)]),
    )
    values = dict(zip(problem.names, x.tolist(), strict=True))
    values = {n: arm.offered[n].nominal for n in names} | values
    at = np.array([values[n] for n in wider.names])
    index = {name: k for k, name in enumerate(wider.names)}
    estimated = np.array([index[problem.names[k]] for k in free])
    held = np.array([index[n] for n in names])
    curvature = curvature_at(wider, at, sigmas, robust=robust)
    precision = problem.stated_precision()[free]
    inverse = scaled_inverse(curvature[np.ix_(estimated, estimated)] + np.diag(precision))
    follow = -inverse @ curvature[np.ix_(estimated, held)]
    # What the data tell hangs on the noise that they have, not on the one that weighs them.
    if robust:
        curvature = curvature_at(wider, at, noise_levels(wider, at, sigmas), robust=True)
    both = np.concatenate([estimated, held])
    moves = np.vstack([follow, np.eye(len(held))])
    information = moves.T @ curvature[np.ix_(both, both)] @ moves
    nominal = at[held]
    spread = drawing_covariance(problem, x, within, names, nominal)
    root = np.linalg.cholesky(spread)
    values_of, directions = np.linalg.eigh(root.T @ information @ root)
    silent = root @ directions[:, values_of < SILENT]
    if not silent.shape[1]:
        return None
    followed = follow @ silent
    variances, axes = np.linalg.eigh(within[np.ix_(free, free)])
    noise = axes * np.sqrt(np.maximum(variances, 0.0))
    beside = _registered_motion(wider, estimated, held, noise, np.zeros((len(held), len(free))))
    motion = _registered_motion(wider, estimated, held, followed, silent)
    _, sizes, mixed = np.linalg.svd(motion, full_matrices=False)
    tip = sizes / math.sqrt(len(motion) / 3)
    # Motion of the tip, m, that no arm shows.
    moving = tip > 1e-6
    if not moving.any():
        return None
    mix = mixed[moving].T
    of_estimate = np.zeros((len(x), int(moving.sum())))
    of_estimate[free] = -followed @ mix
    of_held = -silent @ mix
    # Part of a held parameter in a direction, m or rad, that is rounding.
    part = np.abs(of_held).max(axis=1) > 1e-9
    return HeldGeometry(
        tuple(name for name, taken in zip(names, part, strict=True) if taken),
        nominal[part],
        np.sqrt(np.diag(spread))[part],
        of_estimate,
        of_held[part],
        tip[moving],
        math.sqrt(3.0) * float(np.linalg.norm(beside)) / math.sqrt(len(beside)),
    )


def drawing_covariance(
    problem: Problem, x: FloatArray, within: FloatArray, names: list[str], nominal: FloatArray
) -> FloatArray:
    """(m, m) how far off held parameters may be, and all their lengths by one factor.

    The arm's grade says it. Where nobody states one, held dimensions are as far off as the
    estimated ones of their sort turned out to be, for they stand in the same drawing, but no better
    than machined ones.
    """
    assert problem.arm is not None
    grade = problem.arm.grade or ASSUMED
    length, angle = TOLERANCES[grade]
    departures = {
        keys: float(least)
        for keys, least in ((POSITION, length), (ROTATION, angle), ((OFFSET,), angle))
    }
    if not problem.arm.grade:
        for keys, least in departures.items():
            departures[keys] = max(least, _departures(problem, x, within, keys))
    key_of = [n.rpartition(".")[2] for n in names]
    std = np.array([next(s for keys, s in departures.items() if key in keys) for key in key_of])
    common = GRADES[grade] * np.where([key in POSITION for key in key_of], nominal, 0.0)
    return np.asarray(np.diag(std**2) + np.outer(common, common))


def _departures(
    problem: Problem, x: FloatArray, within: FloatArray, keys: tuple[str, ...]
) -> float:
    """Root mean square by which estimated parameters of a sort are off nominal beyond noise."""
    variance, squares = np.diag(within), list[float]()
    for k, p in enumerate(problem.arm_parameters.values()):
        if p.free and p.key in keys and variance[k] > 0:
            squares.append((float(x[k]) - p.nominal) ** 2 - float(variance[k]))
    return math.sqrt(max(float(np.mean(squares)), 0.0)) if squares else 0.0


def _registered_motion(
    problem: Problem,
    estimated: IntArray,
    held: IntArray,
    followed: FloatArray,
    silent: FloatArray,
) -> FloatArray:
    """(3 s, k) motion of the tip at some samples by each direction, less that of the whole arm."""
    table, arm = problem.evaluation.table, problem.arm_count
    n = len(table.position)
    # Samples at which it is looked at.
    rows: IntArray = np.unique(np.linspace(0, n - 1, min(n, 500)).astype(np.intp))
    velocity = table.velocity.reshape(n, 6, -1)[rows, :3]
    of_arm: BoolArray = estimated < arm
    moved = velocity[:, :, estimated[of_arm]] @ followed[of_arm] + velocity[:, :, held] @ silent
    position = table.position[rows]
    centred = position - position.mean(axis=0)
    rigid = np.concatenate([np.tile(np.eye(3), (len(rows), 1, 1)), -skew(centred)], axis=2)
    design, flat = rigid.reshape(-1, 6), moved.reshape(3 * len(rows), -1)
    return np.asarray(flat - design @ np.linalg.lstsq(design, flat, rcond=1e-9)[0])
