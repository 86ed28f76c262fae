"""From a problem to a solution: find the identifiable parameters, minimise, check again."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from types import MappingProxyType
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import ParameterError, SamplesError
from suta_calib.solver.covariance import Spread
from suta_calib.solver.fitted import Fitted
from suta_calib.solver.identifiability import Identification, identify
from suta_calib.solver.information import noise_levels, predicted_information
from suta_calib.solver.interface import Minimum
from suta_calib.solver.mount_start import FreeMount
from suta_calib.solver.nlp import RobustNlp
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution, near_bound
from suta_calib.solver.weights import Weights, learn_weights
from suta_calib.threads import single_threaded

MORE_DATA: Final = "measure more, select fewer parameters, or give priors"
Progress = Callable[[int, int], None]


@single_threaded
def solve(
    problem: Problem,
    options: SolverOptions = SolverOptions(),
    progress: Progress | None = None,
    *,
    spread: bool = True,
) -> Solution:
    """Minimise the problem over the parameters that its data determine.

    Args:
        problem: terms and parameters.
        options: starts, Hessian, iteration limit.
        progress: called with (starts done, starts) as the work goes on.
        spread: compute the covariance now, and not when it is asked for.

    Returns:
        A solution that knows whether it may be used; not converging is no exception.

    Raises:
        ParameterError: something else than a problem, or nothing is to be estimated.
        SamplesError: too few samples for a term, or for the unknowns.
    """
    if not isinstance(problem, Problem):
        raise ParameterError(repr(problem), "a problem: Problem(terms, parameters)")
    began = perf_counter()
    for term in problem.terms:
        term.check_enough()
    sigmas = problem.assumed_sigmas()
    nominal = problem.start()
    before = identify_at(problem, _first(problem, nominal), sigmas)
    _check_determined(problem, before)
    checked = perf_counter()
    starts = start_points(problem, nominal, set(before.fixed.tolist()), options)
    # What is held is held at nominal; where things stand follows from where the tip begins.
    nominal = np.concatenate([nominal[: problem.arm_count], starts[0][problem.arm_count :]])
    minimum, attempts, identification, estimated, noise = _fit(
        problem, nominal, starts, before, sigmas, options, progress
    )
    weights = None
    # One block without priors is weighed against nothing.
    weighed = len(problem.blocks) > 1 or problem.prior_precision()[estimated].any()
    if options.weights is not None and minimum.converged and weighed:
        inside = _inside(problem, minimum.x, estimated)
        weights = learn_weights(problem, minimum.x, sigmas, inside, options.weights)
        problem = weights.applied_to(problem)
        sigmas = list(weights.sigmas)
        minimum, _, identification, estimated, _ = _fit(
            problem, nominal, [minimum.x], identification, sigmas, options, None
        )
        noise = [level.value for level in weights.noise]
    # With hardly any redundancy the residuals vanish, and what was held seems to be determined.
    _check_redundant(problem, estimated)
    verdicts = before, identification
    solution = _solution(problem, sigmas, minimum, attempts, *verdicts, estimated, noise, weights)
    solution.timing.update(check=checked - began, solve=perf_counter() - checked)
    if spread:
        ended = perf_counter()
        _ = solution.covariance
        solution.timing["covariance"] = perf_counter() - ended
    return solution


@single_threaded
def solve_again(
    problem: Problem, like: Solution, options: SolverOptions = SolverOptions()
) -> Solution:
    """Minimise nearly the same problem from where its solution was.

    What was held there is held again, and `solve` decides anew where these data tell otherwise, or
    where there are other unknowns. Noise levels are taken as given; the covariance is computed when
    it is asked for.
    """
    solution = _from_there(problem, like, options)
    return (solution and judged(solution)) or solve(problem, options)


@single_threaded
def solve_unjudged(
    problem: Problem, like: Solution, options: SolverOptions = SolverOptions()
) -> Solution:
    """`solve_again` with the verdict and the noise of the solution before, taken over unasked.

    What is solved again and again until nothing changes is `judged` once, at the end.
    """
    return _from_there(problem, like, options) or solve(problem, options, spread=False)


@single_threaded
def judged(solution: Solution) -> Solution | None:
    """A solution with what its data tell, and with the noise that its residuals show.

    None where they tell of other parameters than those that were estimated.
    """
    problem, fixed = solution.problem, solution.identification.fixed
    levels = noise_levels(problem, solution.x, solution.sigmas)
    identification = identify_at(problem, solution.x, levels, robust=True)
    if {*identification.fixed.tolist()} != {*fixed.tolist()}:
        return None
    _check_redundant(problem, _asked(problem, identification.fixed))
    return replace(solution, identification=identification, noise=tuple(levels))


def _asked(problem: Problem, held: Iterable[int] = ()) -> IntArray:
    """Indices of what is asked for, less what is to be held."""
    free, held = [p.free for p in problem.parameters.values()], {*held}
    return np.flatnonzero([asked and k not in held for k, asked in enumerate(free)])


def _from_there(problem: Problem, like: Solution, options: SolverOptions) -> Solution | None:
    """The minimum beside a solution with all that is known of it; None where there is none."""
    if problem.names != like.problem.names:
        return None
    for term in problem.terms:
        term.check_enough()
    began, sigmas = perf_counter(), problem.assumed_sigmas()
    free = _asked(problem, like.identification.fixed)
    # Where steps downhill do not come to it, what can be found is another than before.
    minimum = options.build_solver().nearby(RobustNlp(problem, free, sigmas), like.x)
    if minimum is None:
        return None
    verdicts = like.before, like.identification
    solution = _solution(problem, sigmas, minimum, (minimum,), *verdicts, free, like.noise, None)
    solution.timing.update(check=0.0, solve=perf_counter() - began)
    return solution


def _solution(
    problem: Problem,
    sigmas: Sequence[float],
    minimum: Minimum,
    attempts: tuple[Minimum, ...],
    before: Identification,
    identification: Identification,
    estimated: IntArray,
    noise: Sequence[float],
    weights: Weights | None,
) -> Solution:
    """The minimum with what is known of it."""
    x = minimum.x
    free = _inside(problem, x, estimated)
    unsure = np.zeros((len(x), len(x))) if weights is None else weights.covariance
    return Solution(
        problem=problem,
        minimum=minimum,
        attempts=attempts,
        before=before,
        identification=identification,
        free=free,
        spread=Spread(Fitted(problem, x, tuple(sigmas), free), unsure),
        sigmas=tuple(sigmas),
        noise=tuple(noise),
        weights=weights,
        timing={},
    )


def _check_determined(problem: Problem, verdict: Identification) -> None:
    """Refuse problems without unknowns, and data that determine nothing or fit any values."""
    asked = _asked(problem)
    if not len(asked):
        raise ParameterError("no unknowns", "at least one parameter to estimate")
    free = _asked(problem, verdict.fixed)
    if np.any(asked < problem.arm_count) and not np.any(free < problem.arm_count):
        equations = sum(term.equations() for term in problem.terms)
        raise SamplesError(
            f"{equations} independent equations, which determine no unknown of the arm",
            "data that determine at least one of them",
            where="observations",
            hint=f"{MORE_DATA}; suta-calib observe shows what is missing",
        )
    _check_redundant(problem, free)


def _check_redundant(problem: Problem, free: IntArray) -> None:
    """Refuse as many unknowns as equations: any values would fit, and nothing tell how well."""
    equations = sum(term.equations() for term in problem.terms)
    priors = int(np.count_nonzero(problem.prior_precision()[free]))
    if equations + priors <= len(free):
        raise SamplesError(
            f"{equations} independent equations for {len(free)} unknowns",
            "more equations than unknowns",
            where="observations",
            hint=MORE_DATA,
        )


def _fit(
    problem: Problem,
    nominal: FloatArray,
    starts: Sequence[FloatArray],
    identification: Identification,
    sigmas: Sequence[float],
    options: SolverOptions,
    progress: Progress | None,
) -> tuple[Minimum, tuple[Minimum, ...], Identification, IntArray, list[float]]:
    """Minimise from all starts, then again from the best for as long as the verdict changes.

    Returns:
        The best minimum, what each start ended in, the last verdict, what was free, and the noise
        that residuals show at the minimum.
    """
    fixed = set(identification.fixed.tolist())
    attempts: tuple[Minimum, ...] = ()
    solver = options.build_solver()
    levels = [math.inf] * len(sigmas)

    def tell(done: int) -> None:
        if progress is not None:
            progress(done, len(starts))

    max_revisions = 4
    for revision in range(max_revisions):
        free = _asked(problem, fixed)
        nlp = RobustNlp(problem, free, sigmas)
        tried = solver.minimise_all(nlp, starts, tell if revision == 0 else lambda _: None)
        attempts = attempts or tuple(tried)
        minimum = solver.confirmed(nlp, _best(tried))
        # What is held adds misfit, which is not noise: the freest fit tells the noise best.
        noise = noise_levels(problem, minimum.x, sigmas)
        levels = list(np.minimum(levels, noise))
        if len(_inside(problem, minimum.x, free)) < len(free):
            # Nor is the misfit noise that a bound too tight makes.
            levels = list(np.minimum(levels, sigmas))
        identification = identify_at(problem, minimum.x, levels, robust=True)
        held = set(identification.fixed.tolist())
        if held == fixed:
            break
        # The second time round only ever hold more, so that two verdicts cannot alternate.
        fixed = held if revision == 0 else fixed | held
        again = minimum.x.copy()
        again[list(fixed)] = nominal[list(fixed)]
        starts = [again]
    return minimum, attempts, identification, free, noise


def _best(tried: Sequence[Minimum]) -> Minimum:
    """The lowest that was gone down to; of those that are as low but for rounding the first."""
    ends = [m for m in tried if not m.joined]
    lowest = min(ends, key=lambda m: (not m.converged, math.isnan(m.cost), m.cost))
    # A difference between ends of starts that is rounding.
    same = lowest.cost + 1e-9 * max(lowest.cost, 1.0)
    equally_low = (m for m in ends if m.converged == lowest.converged and m.cost <= same)
    # No cost is as low as one that is no number.
    return next(equally_low, lowest)


def identify_at(
    problem: Problem, x: FloatArray, sigmas: Sequence[float], *, robust: bool = False
) -> Identification:
    """Identifiable parameters at x, if every sample has the given noise."""
    information = predicted_information(problem, x, sigmas, robust=robust)
    return identify(problem.parameters, problem.arm_count, information, problem.prior_precision())


def start_points(
    problem: Problem, nominal: FloatArray, fixed: set[int], options: SolverOptions
) -> list[FloatArray]:
    """Nominal first, then seeded uniform draws of the arm's parameters within their bounds.

    A mount that is wide open follows from the other parameters that were drawn (`FreeMount`).
    """
    random = np.random.default_rng(options.seed)
    arm = problem.arm_parameters.values()
    reach = [
        0.0 if k in fixed or not p.free else min(p.plausible, p.prior or math.inf)
        for k, p in enumerate(arm)
    ]
    points, mounts = [_first(problem, nominal, fixed)], FreeMount.of(problem, fixed)
    for _ in range(options.starts - 1):
        draw = random.uniform(-1.0, 1.0, len(reach)) * reach
        values = {p.name: p.nominal + float(d) for p, d in zip(arm, draw, strict=True)}
        drawn = [problem.start(values)]
        drawn += _mounted(problem, mounts, values)
        points.append(_lowest(problem, drawn))
    return points


def _first(problem: Problem, nominal: FloatArray, fixed: Collection[int] = ()) -> FloatArray:
    """Where the first start begins: at nominal but for a mount that is wide open."""
    mounts = FreeMount.of(problem, fixed)
    return _lowest(problem, [nominal, *_mounted(problem, mounts)])


def _mounted(
    problem: Problem,
    mounts: Sequence[FreeMount],
    values: Mapping[str, float] = MappingProxyType({}),
) -> list[FloatArray]:
    """Starts whose tip is where each instrument sees it; of several chains all tips at once."""
    if len(mounts) == 1:
        return [problem.start(arm_values) for arm_values in mounts[0].starts(values)]
    together = dict(values)
    for mount in mounts:
        for start in mount.starts(together)[:1]:
            together |= {name: start[name] for name in mount.names}
    return [problem.start(together)] if mounts else []


def _lowest(problem: Problem, points: Sequence[FloatArray]) -> FloatArray:
    """Of several starts that with the least squared residuals, in units of the assumed noise."""
    if len(points) == 1:
        return points[0]
    sigmas = problem.assumed_sigmas()
    costs = []
    for x in points:
        lines = zip(problem.linearise(x, sigmas), sigmas, strict=True)
        costs.append(sum(float(np.sum((line.residual / sigma) ** 2)) for line, sigma in lines))
    return points[int(np.argmin(costs))]


def _inside(problem: Problem, x: FloatArray, free: IntArray) -> IntArray:
    parameters = list(problem.parameters.values())
    return np.array([k for k in free if not near_bound(parameters[k], x[k])], dtype=np.intp)
