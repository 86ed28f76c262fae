"""IPOPT, by CasADi, with the Gauss-Newton matrix or with exact second derivatives.

With the former it is made once for each number of variables, and asks for cost, gradient and
matrix by three CasADi callbacks that share one evaluation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from threading import get_ident
from typing import Any, ClassVar, Final, final

import casadi as ca
import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import SolverError
from suta_calib.solver.descent import NEGLIGIBLE, Evaluate
from suta_calib.solver.interface import SETTLED, Answer, Minimum, Solver
from suta_calib.solver.nlp import RobustNlp

STALLED: Final = "User_Requested_Stop"
_INTERRUPTED: Final = "NonIpopt_Exception_Thrown"
_GOOD: Final = ("Solve_Succeeded", "Solved_To_Acceptable_Level")


@final
@dataclass(frozen=True)
class Ipopt(Solver):
    """IPOPT (Wächter and Biegler 2006, doi:10.1007/s10107-004-0559-y) from every start.

    Attributes:
        exact: whether the Hessian is exact, by automatic differentiation of the whole cost, in
            place of the Gauss-Newton matrix.
        max_iterations: per start.
    """

    name: ClassVar[str] = "IPOPT"
    checks_itself: ClassVar[bool] = True

    exact: bool = False
    max_iterations: int = 200

    def search(self, nlp: RobustNlp, z: FloatArray) -> Answer:
        """IPOPT's minimum, with its last digits."""
        rows = sum(len(block) * block.size for block in nlp.problem.blocks)
        # Rounding grows with the cost: a large problem is scaled down to one of 2000 residuals.
        limits = self.max_iterations, min(1.0, 2000 / rows)
        if self.exact and nlp.in_time:
            # Readings between rows are one polynomial near where the clock is.
            z = nlp.descend(z, settled=NEGLIGIBLE, steps=self.max_iterations).z
        where = {"x0": z, "lbx": nlp.lower, "ubx": nlp.upper}
        try:
            if self.exact:
                answer, stats = _run(_exact(nlp, limits, z), where)
            else:
                solver = cached_ipopt(len(z), limits, get_ident())
                answer, stats = solver(nlp.cost_gradient_hessian, where)
        except RuntimeError as problem:
            reason = str(problem).strip().splitlines()[-1]
            raise SolverError(f"an error of CasADi ({reason})", where=self.name) from problem
        status, count = str(stats["return_status"]), int(stats["iter_count"])
        there, cost = answer["x"].full().reshape(-1), float(answer["f"])
        converged = status in _GOOD
        if converged:
            # IPOPT stops where its line search is still above rounding; without noise there are
            # digits left, and with noise this changes nothing that matters.
            last = nlp.descend(there, settled=NEGLIGIBLE, steps=self.max_iterations)
            if last.cost <= cost:
                there, cost = last.z, last.cost
        return Answer(there, converged, status, count, self.name, cost)

    def nearby(self, nlp: RobustNlp, start: FloatArray) -> Minimum | None:
        """Where Gauss-Newton steps alone come to; None where they do not settle."""
        z = nlp.begin(start)
        there = nlp.descend(z, settled=NEGLIGIBLE, steps=self.max_iterations)
        if not there.settled:
            return None
        x = nlp.unscaled(there.z)
        return Minimum(x, there.cost, SETTLED, there.steps, True, "Gauss-Newton")


def _exact(nlp: RobustNlp, limits: tuple[int, float], near: FloatArray) -> Any:
    """IPOPT over the symbolic cost, made again where other values are held."""
    key = nlp.held.tobytes() + (near.tobytes() if nlp.in_time else b"")
    if key not in nlp.compiled:
        z: Any = ca.MX.sym("z", len(nlp.free))
        cost = {"x": z, "f": nlp.symbolic_cost(z, near)}
        nlp.compiled[key] = ca.nlpsol("calibration", "ipopt", cost, _options(*limits))
    return nlp.compiled[key]


def _options(max_iterations: int, scaling: float) -> dict[str, Any]:
    """CasADi's and IPOPT's, of every solve."""
    return {
        "print_time": False,
        "show_eval_warnings": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.max_iter": max_iterations,
        # In units of the whitened cost per scaled parameter: a thousandth of a standard
        # deviation, and still above rounding, where a line search would go on for nothing.
        "ipopt.nlp_scaling_method": "none",
        "ipopt.obj_scaling_factor": scaling,
        "ipopt.tol": 1e-2,
        "ipopt.acceptable_tol": 1e-1,
        # The nominal geometry is feasible and a good start: do not push it off its bounds,
        # and do not begin with a barrier that outweighs the data.
        "ipopt.bound_push": 1e-8,
        "ipopt.bound_frac": 1e-8,
        "ipopt.mu_init": 1e-6,
        # Nor with multipliers of one, which no bound asks for: at a minimum it would go on until
        # they have vanished, and its line search would look for what rounding leaves of the cost.
        "ipopt.bound_mult_init_method": "mu-based",
        "ipopt.bound_relax_factor": 0.0,
    }


def _run(
    solver: Any, where: Mapping[str, FloatArray], shared: _Shared | None = None
) -> tuple[dict[str, Any], dict[str, Any]]:
    """What IPOPT answers and how it went."""
    answer, odd = dict[str, Any](), None
    try:
        answer = solver(**where)
    except SystemError as error:
        # CasADi 3.7.0 answers with an error of its own still set after an interrupt.
        odd = error
    stats = solver.stats()
    if str(stats["return_status"]) == _INTERRUPTED:
        # CasADi swallows what is raised inside a solve, Ctrl-C among it.
        raise (shared and shared.error) or KeyboardInterrupt
    if odd is not None:
        raise odd
    return answer, stats


class AnyIpopt:
    """IPOPT over ``n`` variables, whatever they are: what is minimised is said solve by solve."""

    def __init__(self, n: int, limits: tuple[int, float]) -> None:
        self._shared: Any = None
        z: Any = ca.MX.sym("z", n)
        arguments = ("x", "f", "g", "lam_x", "lam_g", "lam_p")
        cost = _Callback("cost", n, ("x",), ("f",), lambda z: [self._shared(z)[0]])
        gradient = _Callback(
            *("nlp_grad_f", n, ("x", "p"), ("f", "grad_f_x")),
            lambda z, _: [*self._shared(z)[:2]],
        )
        hessian = _Callback(
            *("nlp_hess_l", n, ("x", "p", "lam_f", "lam_g"), ("triu_hess_gamma_x_x",)),
            lambda z, _, factor, __: [ca.triu(ca.DM(float(factor) * self._shared(z)[2]))],
        )
        progress = _Callback(
            "progress", n, arguments, ("stop",), lambda _, f, *__: [self._shared.stalled(float(f))]
        )
        # CasADi does not keep Python callbacks alive: the solver must.
        self._callbacks = (cost, gradient, hessian, progress)
        options = {
            "grad_f": gradient,
            "hess_lag": hessian,
            "no_nlp_grad": True,
            "iteration_callback": progress,
        }
        nlp = {"x": z, "f": cost(z)}
        self._solver = ca.nlpsol("calibration", "ipopt", nlp, _options(*limits) | options)

    def __call__(
        self, evaluate: Evaluate, where: Mapping[str, FloatArray]
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Minimise this; the start and the bounds are ``x0``, ``lbx`` and ``ubx``."""
        self._shared = _Shared(evaluate)
        try:
            return _run(self._solver, where, self._shared)
        finally:
            self._shared = None


@lru_cache(maxsize=32)
def cached_ipopt(n: int, limits: tuple[int, float], thread: int) -> AnyIpopt:
    """One that is made already: that takes as long as many a solve. Each thread has its own."""
    del thread
    return AnyIpopt(n, limits)


class _Shared:
    """Remembers the last point, because IPOPT asks for the same one three times."""

    def __init__(self, evaluate: Evaluate) -> None:
        self._evaluate = evaluate
        self._key = b""
        self.error: BaseException | None = None
        self._least, self._idle = math.inf, 0
        self._value: tuple[float, FloatArray, FloatArray]

    def __call__(self, z: Any) -> tuple[float, FloatArray, FloatArray]:
        point = np.array(z).reshape(-1)
        key = point.tobytes()
        if key != self._key:
            try:
                self._value = self._evaluate(point)
            except BaseException as error:
                self.error = error
                raise
            self._key = key
        return self._value

    def stalled(self, cost: float) -> bool:
        """Whether no iteration has lowered the cost for long; told the cost of each."""
        # Iterations that lower the cost by no more than this share in all are for nothing: what a
        # robust cost has for a slope at a fold never vanishes, and a line search there takes fifty
        # evaluations.
        idle = 20
        lowered = 1e-8
        if cost < self._least - lowered * abs(self._least) or math.isinf(self._least):
            self._least, self._idle = cost, 0
        else:
            self._idle += 1
        return self._idle >= idle


class _Callback(ca.Callback):
    """One of IPOPT's questions, answered from the shared evaluation."""

    def __init__(
        self,
        name: str,
        n: int,
        inputs: tuple[str, ...],
        outputs: tuple[str, ...],
        answer: Callable[..., list[Any]],
    ) -> None:
        ca.Callback.__init__(self)
        self._n, self._inputs, self._outputs, self._answer = n, inputs, outputs, answer
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._inputs)

    def get_n_out(self) -> int:
        return len(self._outputs)

    def get_name_in(self, i: int) -> str:
        return self._inputs[i]

    def get_name_out(self, i: int) -> str:
        return self._outputs[i]

    def get_sparsity_in(self, i: int) -> Any:
        one, vector = ca.Sparsity.dense(1, 1), ca.Sparsity.dense(self._n, 1)
        sizes = {"x": vector, "lam_x": vector, "f": one, "lam_f": one}
        return sizes.get(self._inputs[i], ca.Sparsity(0, 0))

    def get_sparsity_out(self, i: int) -> Any:
        return {
            "f": ca.Sparsity.dense(1, 1),
            "stop": ca.Sparsity.dense(1, 1),
            "grad_f_x": ca.Sparsity.dense(self._n, 1),
            "triu_hess_gamma_x_x": ca.Sparsity.upper(self._n),
        }[self._outputs[i]]

    def eval(self, arg: Any) -> list[Any]:
        return self._answer(*arg)
