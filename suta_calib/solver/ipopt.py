"""The problem as a nonlinear program: Gauss-Newton steps, and CasADi's IPOPT from where they end.

Both work on x divided by the parameters' scales, within their bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from threading import get_ident
from typing import Any, Final

import casadi as ca
import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.solver.callbacks import ipopt_options, kept_ipopt, run_ipopt
from suta_calib.solver.descent import NEGLIGIBLE, Basin, Descent, descend
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.symbolic import symbolic_cost

# Whitened costs that differ by less are the same minimum.
SAME_COST: Final = 1e-3
# Of that, what a start may lack that leads to a minimum which another one has found.
JOINS: Final = 0.1
# Residuals up to which the cost is minimised as it is.
FULL_SIZE: Final = 2000
# Share by which the costs of two ends that are no minimum differ at most to be the same.
SAME_DEAD_END: Final = 1e-4
STALLED: Final = "User_Requested_Stop"
GOOD: Final = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
# What Gauss-Newton steps come to: a minimum, or one that an earlier start has found.
SETTLED: Final = "Gauss_Newton_Settled"
JOINED: Final = "Joined_Earlier_Start"


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where a start ended.

    Attributes:
        x: the whole parameter vector, fixed entries included.
        cost: robust cost with priors.
        status: `SETTLED`, `JOINED`, or IPOPT's own word where it went on from there.
        iterations: how many it took, of both methods.
    """

    x: FloatArray
    cost: float
    status: str
    iterations: int

    @property
    def solver(self) -> str:
        """Who stopped there."""
        return "Gauss-Newton" if self.status in (SETTLED, JOINED) else "IPOPT"

    @property
    def joined(self) -> bool:
        """Whether it came to an earlier start's minimum, and was not carried on."""
        return self.status == JOINED

    @property
    def converged(self) -> bool:
        """Whether it is a minimum."""
        return self.status in (SETTLED, JOINED, *GOOD)


class RobustNlp:
    """min ½ Σ ρ + ½ Σ ((x - nominal)/prior)² over the free entries of x, within bounds.

    Args:
        problem: what to minimise.
        free: (n,) which entries of x may move; the others keep their value in the start.
        sigmas: noise level of each block.
        options: Hessian and iteration limit.
    """

    def __init__(
        self, problem: Problem, free: IntArray, sigmas: Sequence[float], options: SolverOptions
    ) -> None:
        self._problem, self._free, self._sigmas = problem, free, list(sigmas)
        self._scale = problem.parameters.array("scale")[free]
        lower, upper = (problem.parameters.array(key)[free] for key in ("lower", "upper"))
        self._bounds = lower, upper
        self._lower, self._upper = lower / self._scale, upper / self._scale
        self._precision = problem.prior_precision()
        self._of_free, self._units = np.ix_(free, free), np.outer(self._scale, self._scale)
        self._nominal = problem.parameters.array("nominal")
        self._arm_moves = bool(np.any(free < problem.arm_count))
        self._options = options
        self._base = self._nominal.copy()
        self._symbolic: Any = None

    def cost_gradient_hessian(self, z: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """Cost and derivatives by the scaled free variables."""
        x = self._base.copy()
        x[self._free] = z * self._scale
        cost, gradient, hessian = self._problem.evaluation.cost_gradient_hessian(
            x, self._sigmas, arm_moves=self._arm_moves
        )
        deviation = x - self._nominal
        cost += 0.5 * float(np.sum(self._precision * deviation**2))
        gradient = (gradient + self._precision * deviation)[self._free] * self._scale
        hessian = hessian[self._of_free]
        hessian.flat[:: len(hessian) + 1] += self._precision[self._free]
        return cost, gradient, hessian * self._units

    def minimise(self, start: FloatArray, settled: float = NEGLIGIBLE) -> Minimum:
        """The minimum beside one start (n,), clipped into the bounds.

        Args:
            start: where to begin.
            settled: share of the cost that steps may promise to lose where the next is the last.
        """
        return self._minimise(start, (), settled)[0]

    def descended(self, start: FloatArray) -> Minimum | None:
        """The minimum beside one start (n,) where steps downhill alone come to it; else None."""
        there = self._descend(start)
        if not there.settled:
            return None
        return Minimum(self._filled(start, there.z), there.cost, SETTLED, there.steps)

    def minimise_all(
        self, starts: Sequence[FloatArray], done: Callable[[int], None] = lambda _: None
    ) -> list[Minimum]:
        """What each start (n,) ends in.

        A start that comes to a minimum which one before it has found, or would by its next step,
        has that minimum: what would follow is known. Where two have ended nowhere at the same
        cost, no others are tried.

        Args:
            starts: clipped into the bounds.
            done: called with how many have ended, after each.
        """
        found: list[Minimum] = []
        known: list[tuple[FloatArray, Basin]] = []
        held = np.delete(np.arange(len(self._nominal)), self._free)
        for start in starts:
            # Over other values of what is held it is another cost.
            same = [basin for x, basin in known if np.array_equal(x[held], start[held])]
            minimum, basin = self._minimise(start, same)
            if basin is not None:
                known.append((start, basin))
            found.append(minimum)
            if hopeless(found):
                done(len(starts))
                break
            done(len(found))
        return found

    def minimise_by_ipopt(self, start: FloatArray) -> Minimum:
        """IPOPT alone from one start (n,), clipped into the bounds; with its last digits."""
        # Most refits do without.

        z = np.clip(start[self._free] / self._scale, self._lower, self._upper)
        where = {"x0": z, "lbx": self._lower, "ubx": self._upper}
        if self._options.hessian == "exact":
            answer, stats = run_ipopt(self._exact(start), where)
        else:
            self._base = start.copy()
            solver = kept_ipopt(len(z), self._limits, get_ident())
            answer, stats = solver(self.cost_gradient_hessian, where)
        x = self._filled(start, answer["x"].full().reshape(-1))
        status, iterations = str(stats["return_status"]), int(stats["iter_count"])
        found = Minimum(x, float(answer["f"]), status, iterations)
        if found.converged:
            # IPOPT stops where its line search is still above rounding; without noise there are
            # digits left, and with noise this changes nothing that matters.
            last = self._descend(x)
            if last.cost <= found.cost:
                found = replace(found, x=self._filled(x, last.z), cost=last.cost)
        return found

    def confirmed(self, minimum: Minimum) -> Minimum:
        """The same minimum with IPOPT's word for it, or the lower one that IPOPT went on to.

        Left as it is where it is IPOPT's already, or where rounding alone keeps IPOPT from an
        answer: one that goes on to lower costs without an end says that it was no minimum.
        """
        if not len(self._free) or minimum.status != SETTLED:
            return minimum
        found = self.minimise_by_ipopt(minimum.x)
        if not found.converged and not found.cost < minimum.cost - SAME_COST:
            return minimum
        lower = found if found.cost < minimum.cost else minimum
        steps = minimum.iterations + found.iterations
        return replace(lower, status=found.status, iterations=steps)

    def _minimise(
        self, start: FloatArray, known: Sequence[Basin], settled: float = NEGLIGIBLE
    ) -> tuple[Minimum, Basin | None]:
        if not len(self._free):
            self._base = start.copy()
            cost, *_ = self.cost_gradient_hessian(np.zeros(0))
            return Minimum(start, cost, SETTLED, 0), None
        if self._options.hessian == "exact":
            return self.minimise_by_ipopt(start), None
        there = self._descend(start, known, settled)
        x = self._filled(start, there.z)
        if there.settled:
            status = SETTLED if there.joined is None else JOINED
            return Minimum(x, there.cost, status, there.steps), there.basin
        return self.minimise_by_ipopt(x), None

    def _descend(
        self, start: FloatArray, known: Sequence[Basin] = (), settled: float = NEGLIGIBLE
    ) -> Descent:
        self._base = start.copy()
        return descend(
            self.cost_gradient_hessian,
            start[self._free] / self._scale,
            (self._lower, self._upper),
            settled=settled,
            steps=self._options.max_iterations,
            known=known,
            joins=JOINS * SAME_COST,
        )

    def _filled(self, x: FloatArray, z: FloatArray) -> FloatArray:
        """The vector with other free entries, given in their scales."""
        found = x.copy()
        # A bound in its scale and back again may be off by the last digit.
        found[self._free] = np.clip(z * self._scale, *self._bounds)
        return found

    @property
    def _limits(self) -> tuple[int, float]:
        """Most iterations, and what the cost is scaled with.

        Rounding grows with the cost, so a large problem is scaled down to one of full size.
        """
        rows = sum(len(block) * block.size for block in self._problem.blocks)
        return self._options.max_iterations, min(1.0, FULL_SIZE / rows)

    def _exact(self, start: FloatArray) -> Any:
        """The solver of the symbolic cost, made again where other fixed values are given."""
        fixed = np.delete(np.arange(len(start)), self._free)
        if self._symbolic is None or not np.array_equal(self._base[fixed], start[fixed]):
            self._base = start.copy()
            z: Any = ca.MX.sym("z", len(self._free))
            nlp = {"x": z, "f": self._exact_cost(z)}
            self._symbolic = ca.nlpsol("calibration", "ipopt", nlp, ipopt_options(*self._limits))
        return self._symbolic

    def _exact_cost(self, z: Any) -> Any:
        select = ca.DM(len(self._base), len(self._free))
        for column, row in enumerate(self._free):
            select[int(row), column] = self._scale[column]
        rest = self._base.copy()
        rest[self._free] = 0.0
        x = ca.mtimes(select, z) + ca.DM(rest)
        deviation = x - ca.DM(self._nominal)
        prior = ca.dot(ca.DM(self._precision), deviation**2) / 2
        return symbolic_cost(self._problem, x, self._sigmas) + prior


def hopeless(tried: Sequence[Minimum]) -> bool:
    """Whether all starts, and more than one, have ended nowhere, and there at the same cost."""
    if len(tried) < 2 or any(each.converged for each in tried):
        return False
    least, next_ = sorted(each.cost for each in tried)[:2]
    return next_ - least < SAME_DEAD_END * next_
