"""From a problem to a solution: decide what can be told, minimise, decide again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import perf_counter

import numpy as np

from suta_calib.geometry import FloatArray
from suta_calib.model.parameters import Parameter
from suta_calib.solver.identifiability import Identification, identify
from suta_calib.solver.information import (
    noise_levels,
    observed_covariance,
    predicted_information,
)
from suta_calib.solver.ipopt import Minimum, Options, RobustNlp
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution, near_bound
from suta_calib.terms.term import IntArray

MAX_REVISIONS = 4
Progress = Callable[[int, int], None]


def solve(
    problem: Problem, options: Options = Options(), progress: Progress | None = None
) -> Solution:
    """Minimise the problem over what its data can determine.

    Args:
        problem: terms and parameters.
        options: starts, Hessian, iteration limit.
        progress: called with (starts done, starts) as the work goes on.

    Returns:
        A solution that knows whether it may be used; not converging is no exception.
    """
    began = perf_counter()
    sigmas = problem.assumed_sigmas()
    nominal = problem.start()
    before = identify_at(problem, nominal, sigmas)
    checked = perf_counter()
    after, held = before, set(before.held.tolist())
    for revision in range(MAX_REVISIONS):
        starts = start_points(problem, nominal, held, options) if revision == 0 else [minimum.x]
        free = _free(problem, held)
        solver = RobustNlp(problem, free, sigmas, options)
        attempts_now = _attempts(solver, starts, progress)
        attempts = attempts_now if revision == 0 else attempts
        minimum = solver.polish(min(attempts_now, key=lambda m: (not m.converged, m.cost)))
        levels = noise_levels(problem, minimum.x, sigmas)
        after = identify_at(problem, minimum.x, levels)
        found = set(after.held.tolist())
        if found == held:
            break
        # The second time round only ever hold more, so that two verdicts cannot alternate.
        held = found if revision == 0 else held | found
        for k in held:
            minimum.x[k] = nominal[k]
    solved = perf_counter()
    free = _inside(problem, minimum.x, free)
    covariance = observed_covariance(problem, minimum.x, sigmas, free)
    timing = {
        "check": checked - began,
        "solve": solved - checked,
        "covariance": perf_counter() - solved,
    }
    return Solution(
        problem=problem,
        minimum=minimum,
        attempts=tuple(attempts),
        before=before,
        identification=after,
        free=free,
        covariance=covariance,
        sigmas=tuple(sigmas),
        noise=tuple(levels),
        timing=timing,
    )


def identify_at(problem: Problem, x: FloatArray, sigmas: Sequence[float]) -> Identification:
    """What the data can tell at x if every sample scatters with the given noise."""
    information = predicted_information(problem, x, sigmas)
    return identify(problem.parameters, problem.arm_count, information, problem.prior_precision())


def start_points(
    problem: Problem, nominal: FloatArray, held: set[int], options: Options
) -> list[FloatArray]:
    """Nominal first, then seeded uniform draws of the arm's parameters within their bounds."""
    random = np.random.default_rng(options.seed)
    arm = list(problem.parameters.values())[: problem.arm_count]
    points = [nominal]
    for _ in range(options.starts - 1):
        draw = random.uniform(-1.0, 1.0, len(arm))
        values = {
            p.name: p.nominal + (0.0 if k in held or not p.free else d * _reach(p))
            for k, (p, d) in enumerate(zip(arm, draw, strict=True))
        }
        points.append(problem.start(values))
    return points


def _reach(parameter: Parameter) -> float:
    return min(parameter.plausible, parameter.prior or np.inf)


def _attempts(
    solver: RobustNlp, starts: Sequence[FloatArray], progress: Progress | None
) -> list[Minimum]:
    found = []
    for done, start in enumerate(starts):
        found.append(solver.minimise(start))
        if progress is not None:
            progress(done + 1, len(starts))
    return found


def _free(problem: Problem, held: set[int]) -> IntArray:
    wanted = [p.free for p in problem.parameters.values()]
    return np.array([k for k, w in enumerate(wanted) if w and k not in held], dtype=np.intp)


def _inside(problem: Problem, x: FloatArray, free: IntArray) -> IntArray:
    parameters = list(problem.parameters.values())
    return np.array([k for k in free if not near_bound(parameters[k], x[k])], dtype=np.intp)
