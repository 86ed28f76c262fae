"""Gauss-Newton steps within bounds: down to the minimum beside a start.

Each step minimises the quadratic that cost, gradient and Gauss-Newton matrix make at a point over
the box of the bounds, exactly, so that a bound is where a step ends and not where it fails. A step
that does not lower the cost is taken again shorter and turned towards the gradient (Levenberg 1944,
doi:10.1090/qam/10666; Marquardt 1963, doi:10.1137/0111030).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray

# Of the cost: what it could still fall by where the next step is the last: 1e-5 of a standard
# deviation, of which that step leaves next to nothing.
NEGLIGIBLE: Final = 1e-12
# Evaluations; a descent that needs more creeps along, and is left to IPOPT.
_MOST_EVALUATIONS: Final = 60

Evaluate = Callable[[FloatArray], tuple[float, FloatArray, FloatArray]]


@dataclass(frozen=True, eq=False)
class Basin:
    """A minimum that is known: where (n,), its cost, and the gradient and matrix there."""

    z: FloatArray
    cost: float
    gradient: FloatArray
    hessian: FloatArray

    def cost_at(self, z: FloatArray) -> float:
        """The cost at a point beside it."""
        away = z - self.z
        return self.cost + float(away @ self.gradient + 0.5 * away @ self.hessian @ away)

    def holds(self, z: FloatArray, cost: float) -> bool:
        """Whether a point of this cost is about a standard deviation away, by both accounts."""
        rise, expected = cost - self.cost, self.cost_at(z) - self.cost
        # A whitened cost of one is a standard deviation or two. Among outliers Huber's loss is
        # flatter than the matrix says: the quadratic may miss half of the rise.
        return 0.0 <= rise <= 1.0 and abs(expected - rise) <= 0.5 * rise


@dataclass(frozen=True, eq=False)
class Descent:
    """Where a descent ended.

    Attributes:
        z, cost: the point (n,) and its cost.
        settled: whether it is a minimum.
        steps: how many were taken.
        joined: number of the known minimum that it has come to, or comes to by its next step; it
            is left there, and the point and its cost are the minimum's.
        basin: of the minimum, if one was found.
    """

    z: FloatArray
    cost: float
    settled: bool
    steps: int
    joined: int | None = None
    basin: Basin | None = None


def descend(
    evaluate: Evaluate,
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    *,
    settled: float = NEGLIGIBLE,
    steps: int = _MOST_EVALUATIONS,
    basins: Sequence[Basin] = (),
    joins: float = 0.0,
) -> Descent:
    """Gauss-Newton steps from a start (n,) within the bounds (n,), each to a lower cost.

    The last may promise to lower the cost by a share of ``settled``. It ends at one of the known
    minima (``basins``) when a step comes to within ``joins`` of its cost.
    """
    lower, upper = bounds
    z = np.clip(start, lower, upper)
    cost, gradient, hessian = evaluate(z)
    damping, growth, taken = 0.0, 2.0, 0
    if not _finite(cost, gradient, hessian):
        return Descent(z, cost, False, taken)
    # Shares of the diagonal. Where priors alone hold how several unknowns move together, the valley
    # is curved and a whole step leaves it, but the least damping turns it: a hundredth would stop
    # it.
    least_damping = 1e-6
    no_damping = 1e-8
    # So much leaves nothing of a step.
    most_damping = 1e16
    for _ in range(_MOST_EVALUATIONS):
        for number, basin in enumerate(basins):
            if basin.holds(z, cost):
                return Descent(basin.z, basin.cost, True, taken, joined=number)
        room = lower - z, upper - z
        step = bounded_step(hessian, gradient, *room)
        left = promised = _promised(hessian, gradient, step)
        there = np.clip(z + step, lower, upper)
        if left <= settled * cost:
            # Whether this step helps, no cost would tell; it is what is left of the way.
            return Descent(there, cost, True, taken, basin=Basin(there, cost, gradient, hessian))
        if damping:
            damped = hessian + damping * np.diag(np.diag(hessian))
            step = bounded_step(damped, gradient, *room)
            promised = _promised(hessian, gradient, step)
            there = np.clip(z + step, lower, upper)
        for number, basin in enumerate(basins):
            # A step up, to a minimum above this point, is none that would be taken.
            if basin.cost <= cost and basin.cost_at(there) <= basin.cost + joins:
                return Descent(basin.z, basin.cost, True, taken, joined=number)
        if taken >= steps or damping > most_damping:
            break
        value, *derivatives = evaluate(there)
        if value < cost and _finite(*derivatives):
            foretold = (cost - value) / promised
            z, cost, taken = there, value, taken + 1
            gradient, hessian = derivatives
            # Nielsen (1999), IMM-REP-1999-05: by how well the quadratic foretold it.
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * min(foretold, 1.0) - 1.0) ** 3)
            # So little damping is none.
            damping, growth = (damping if damping > no_damping else 0.0), 2.0
        elif left <= 1e-10 * max(cost, 1.0):  # Rounding alone keeps it from falling.
            return Descent(z, cost, True, taken, basin=Basin(z, cost, gradient, hessian))
        else:
            # Then twice, eight, 64 times as much.
            damping, growth = max(growth * damping, least_damping), 2.0 * growth
    return Descent(z, cost, False, taken)


def _finite(*numbers: float | FloatArray) -> bool:
    return all(np.isfinite(array).all() for array in numbers)


def _promised(hessian: FloatArray, gradient: FloatArray, step: FloatArray) -> float:
    """By how much a step lowers the quadratic."""
    return -float(gradient @ step + 0.5 * step @ hessian @ step)


def bounded_step(
    hessian: FloatArray, gradient: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """The step d (n,) that minimises gᵀd + ½ dᵀHd over lower ≤ d ≤ upper, which zero is within.

    By a primal active set: bounds are met one by one, and let go where the gradient leads away
    from them (Nocedal and Wright 2006, section 16.5).
    """
    step = _newton(hessian, gradient)
    if np.all((step >= lower) & (step <= upper)):
        return step
    n, scale = len(gradient), _unit(hessian)
    least = 1e-9 * float(np.linalg.norm(gradient / scale))
    step, held = np.zeros(n), lower >= upper
    for _ in range(10 * n):
        slope = gradient + hessian @ step
        move = np.zeros(n)
        free = np.flatnonzero(~held)
        move[free] = _newton(hessian[np.ix_(free, free)], slope[free])
        room = np.full(n, np.inf)
        up, down = move > 0, move < 0
        room[up] = (upper - step)[up] / move[up]
        room[down] = (lower - step)[down] / move[down]
        first = int(np.argmin(room))
        if room[first] < 1.0:
            step = np.clip(step + room[first] * move, lower, upper)
            step[first] = upper[first] if move[first] > 0 else lower[first]
            held[first] = True
            continue
        step = np.clip(step + move, lower, upper)
        slope = gradient + hessian @ step
        pull = np.where(step >= upper, slope, -slope)
        pull[~held | (lower >= upper)] = 0.0
        # The root of what letting go of it alone would win, but for rounding.
        gain = pull / scale
        most = int(np.argmax(gain))
        if gain[most] <= least:
            break
        held[most] = False
    return step


def _newton(hessian: FloatArray, gradient: FloatArray) -> FloatArray:
    """-H⁺ g, of a positive semidefinite matrix whose diagonal may span many magnitudes."""
    if not len(gradient):
        return np.zeros(0)  # Every bound is met.
    singular = 1e-12  # a squared pivot of the matrix with unit diagonal that is rounding
    scale = _unit(hessian)
    unit, along = hessian / (scale[:, None] * scale), gradient / scale
    try:
        root = np.linalg.cholesky(unit)
        if root.diagonal().min() ** 2 > singular:
            return np.asarray(-np.linalg.solve(unit, along) / scale)
    except np.linalg.LinAlgError:
        pass
    return np.asarray(-np.linalg.lstsq(unit, along, rcond=singular)[0] / scale)


def _unit(hessian: FloatArray) -> FloatArray:
    """(n,) what makes a matrix's diagonal one, and leaves alone what nothing is known of."""
    scale = np.sqrt(np.maximum(hessian.diagonal(), 0.0))
    return np.where(scale > 0.0, scale, 1.0)
