"""Time to calibrate the simulated SUTA, ours beside SciPy's, in one run.

Eight starts from the same points for everybody; problem building is included. The cost is Huber's
on the same residuals, so costs compare directly. Ratios are to ours. Run by `make bench`, which
gives everybody one thread.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
from limits import record
from peers import LoopDistances, NumpyDistances
from rich.console import Console
from tables import number_table

from suta_calib import CalibrationJob, PairwiseDistance, Problem, SolverOptions, solve
from suta_calib.solver import RobustNlp, start_points

JOB = Path(__file__).parents[1] / "data" / "suta" / "calibration.yaml"
STARTS = 8
ROUNDS = 3


def timed(work: Callable[[], float], rounds: int = ROUNDS) -> tuple[list[float], float]:
    """Times of a few rounds, s, and the cost reached."""
    times, cost = [], np.nan
    for _ in range(rounds):
        began = perf_counter()
        cost = work()
        times.append(perf_counter() - began)
    return times, cost


def main() -> None:
    """Print the table, and where our time goes."""
    job = CalibrationJob.load(JOB)
    terms = [_plain(job)]
    problem = Problem(terms, job.parameters)
    solution = solve(problem, SolverOptions(starts=STARTS))
    identified = [problem.names[k] for k in solution.free]
    fixed = set(solution.identification.fixed.tolist())
    starts = start_points(problem, problem.start(), fixed, SolverOptions(starts=STARTS))
    sigma = solution.sigmas[0]
    huber = problem.blocks[0].noise.huber

    def ours(hessian: str = "gauss-newton") -> float:
        fresh = Problem(terms, job.parameters)
        return solve(fresh, SolverOptions(starts=STARTS, hessian=hessian)).minimum.cost * sigma**2

    def as_posed() -> float:
        """All 13 given to IPOPT, nothing checked and nothing held."""
        fresh = Problem(terms, job.parameters)
        nlp = RobustNlp(fresh, np.arange(len(fresh.names)), [sigma], SolverOptions())
        return min(nlp.minimise(x).cost for x in starts) * sigma**2

    def scipy(kind: type[NumpyDistances], names: list[str], count: int = STARTS) -> float:
        peer = kind(problem, names)
        index = [problem.names.index(n) for n in names]
        return min(peer.solve(x[index]).cost for x in starts[:count])

    def scipy_exact() -> float:
        peer = NumpyDistances(problem, identified)
        index = solution.free

        def jacobian(x: np.ndarray) -> np.ndarray:
            whole = problem.parameters.array("nominal")
            whole[index] = x
            line = problem.linearise(whole, [1.0])[0]
            arm, _ = problem.evaluation.columns(line, line.by_pose, line.by_own)
            return arm[:, index]

        return min(peer.solve(x[index], jacobian).cost for x in starts)

    everything = list(problem.names)
    rows = [
        ("ours: IPOPT, Gauss-Newton, checks and covariance included", *timed(ours)),
        ("ours: all 13 as posed, nothing checked", *timed(as_posed)),
        ("ours: exact Hessian", *timed(lambda: ours("exact"), 1)),
        ("SciPy TRF, NumPy, all 13 as posed", *timed(lambda: scipy(NumpyDistances, everything))),
        (
            "SciPy TRF, NumPy, the identified 10",
            *timed(lambda: scipy(NumpyDistances, identified)),
        ),
        ("SciPy TRF, the identified 10, our exact Jacobian", *timed(scipy_exact)),
        (
            "SciPy TRF, Python loop, the identified 10, one start",
            *timed(lambda: scipy(LoopDistances, identified, 1), 1),
        ),
    ]
    _print(rows)
    ours_taken = np.array(rows[0][1])
    for key, row in {"trf-posed": 3, "trf-found": 4, "trf-jacobian": 5}.items():
        record(key, np.array(rows[row][1]) / ours_taken)
    _where_time_goes(problem, solution.x, sigma, solution.timing)
    print(f"Huber threshold {huber * 1e3:.2f} mm, {len(problem.blocks[0])} distances")


def _plain(job: CalibrationJob) -> PairwiseDistance:
    """The job's distances without the artefact's certificate, which SciPy's version ignores."""
    term = job.observations[0]
    assert isinstance(term, PairwiseDistance)
    exact = [replace(mark, sigma=0.0) for mark in term.artefact.landmarks.values()]
    artefact = replace(term.artefact, landmarks={mark.name: mark for mark in exact})
    return PairwiseDistance(term.poses, artefact, term.noise)


def _print(rows: list[tuple[str, list[float], float]]) -> None:
    title = f"{STARTS} starts on the simulated SUTA, best of {ROUNDS}"
    table = number_table(title, "who", "time, ms", "ratio to ours", "cost, mm²")
    for who, taken, cost in rows:
        seconds = min(taken)
        ratio = f"{seconds / min(rows[0][1]):.1f}"
        table.add_row(who, f"{seconds * 1e3:.0f}", ratio, f"{cost * 1e6:.6f}")
    Console(width=100).print(table)


def _where_time_goes(
    problem: Problem, x: np.ndarray, sigma: float, timing: dict[str, float]
) -> None:
    """One evaluation in parts, ms, and the phases of a whole solve."""
    evaluation = problem.evaluation

    def per_call(work: Callable[[], object], count: int = 200) -> float:
        began = perf_counter()
        for _ in range(count):
            work()
        return (perf_counter() - began) / count * 1e3

    kinematics = per_call(lambda: evaluation.table.update(x[: evaluation.arm_count]))
    rows = per_call(lambda: evaluation.linearise(x, [sigma]))
    whole = per_call(lambda: evaluation.cost_gradient_hessian(x, [sigma]))
    console = Console(width=100)
    console.print(
        f"one evaluation {whole:.2f} ms: kinematics and their Jacobian {kinematics:.2f}, "
        f"residual rows {rows - kinematics:.2f}, chain rule and Gauss-Newton {whole - rows:.2f}"
    )
    phases = ", ".join(f"{name} {seconds * 1e3:.0f}" for name, seconds in timing.items())
    console.print(f"one solve, ms: {phases}")


if __name__ == "__main__":
    main()
