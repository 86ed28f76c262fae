"""Time to calibrate the simulated SUTA, ours beside SciPy's, in one run.

Eight starts from the same points for everybody; problem building is included. The cost is Huber's
on the same residuals, so costs compare directly. Ratios are to ours, of processor times, which a
busy computer changes little. Run by `make bench`, which gives everybody one thread.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
from limits import record
from peers import LoopDistances, NumpyDistances
from rich.console import Console
from tables import number_table

from suta_calib import CalibrationJob, PairwiseDistance, Problem, SolverOptions, solve
from suta_calib.model import ParameterSet
from suta_calib.solver import GaussNewton, RobustNlp, start_points

JOB = Path(__file__).parents[1] / "data" / "suta" / "calibration.yaml"
STARTS = 8
ROUNDS = 3
NINE = (*(f"joint_{k}.offset" for k in range(1, 7)), "joint_3.z", "joint_4.z", "joint_6.z")


def timed(work: Callable[[], float], rounds: int = ROUNDS) -> tuple[list[float], float]:
    """Processor times of a few rounds, s, and the cost reached."""
    times, cost = [], np.nan
    for _ in range(rounds):
        began = process_time()
        cost = work()
        times.append(process_time() - began)
    return times, cost


class Race:
    """One problem, and everybody's way to its minimum from the same starts."""

    def __init__(self, job: CalibrationJob, names: Sequence[str]) -> None:
        self.terms = [_plain(job)]
        self.parameters = ParameterSet([job.parameters[name] for name in names])
        self.problem = Problem(self.terms, self.parameters)
        self.solution = solve(self.problem, SolverOptions(starts=STARTS))
        self.posed = list(self.problem.names)
        self.found = [self.problem.names[k] for k in self.solution.free]
        fixed = set(self.solution.identification.fixed.tolist())
        options = SolverOptions(starts=STARTS)
        self.starts = start_points(self.problem, self.problem.start(), fixed, options)
        self.sigma = self.solution.sigmas[0]

    def ours(self, hessian: str = "gauss-newton") -> float:
        """Checks and covariance included."""
        fresh = Problem(self.terms, self.parameters)
        found = solve(fresh, SolverOptions(starts=STARTS, hessian=hessian))
        return found.minimum.cost * self.sigma**2

    def as_posed(self) -> float:
        """Everything let free, nothing checked and nothing held."""
        fresh = Problem(self.terms, self.parameters)
        nlp = RobustNlp(fresh, np.arange(len(fresh.names)), [self.sigma])
        ends = GaussNewton().minimise_all(nlp, self.starts)
        return min(end.cost for end in ends) * self.sigma**2

    def scipy(self, kind: type[NumpyDistances], names: list[str], count: int = STARTS) -> float:
        """SciPy's TRF with 2-point differences."""
        peer = kind(self.problem, names)
        index = [self.problem.names.index(n) for n in names]
        return min(peer.solve(x[index]).cost for x in self.starts[:count])

    def scipy_exact(self) -> float:
        """SciPy's TRF with our Jacobian."""
        peer = NumpyDistances(self.problem, self.found)
        index = self.solution.free

        def jacobian(x: np.ndarray) -> np.ndarray:
            whole = self.problem.parameters.array("nominal")
            whole[index] = x
            line = self.problem.linearise(whole, [1.0])[0]
            arm, _ = self.problem.evaluation.columns(line, line.by_pose, line.by_own)
            return arm[:, index]

        return min(peer.solve(x[index], jacobian).cost for x in self.starts)


def main() -> None:
    """Print the tables, and where our time goes."""
    job = CalibrationJob.load(JOB)
    race = Race(job, job.parameters.names)
    taken = timed(race.ours)
    posed = timed(lambda: race.scipy(NumpyDistances, race.posed))
    found = timed(lambda: race.scipy(NumpyDistances, race.found))
    exact = timed(race.scipy_exact)
    rows = [
        ("ours, checks and covariance included", *taken),
        ("ours: all 13 as posed, nothing checked", *timed(race.as_posed)),
        ("ours: IPOPT, exact Hessian", *timed(lambda: race.ours("exact"), 1)),
        ("SciPy TRF, NumPy, all 13 as posed", *posed),
        ("SciPy TRF, NumPy, the identified 10", *found),
        ("SciPy TRF, the identified 10, our exact Jacobian", *exact),
        (
            "SciPy TRF, Python loop, the identified 10, one start",
            *timed(lambda: race.scipy(LoopDistances, race.found, 1), 1),
        ),
    ]
    _print(f"{STARTS} starts on the simulated SUTA, best of {ROUNDS}", rows)
    for key, (times, _) in {"trf-posed": posed, "trf-found": found, "trf-jacobian": exact}.items():
        record(key, np.divide(times, taken[0]))
    _nine(job)
    _where_time_goes(race.problem, race.solution.x, race.sigma, race.solution.timing)
    huber, distances = race.problem.blocks[0].noise.huber, len(race.problem.blocks[0])
    print(f"Huber threshold {huber * 1e3:.2f} mm, {distances} distances")


def _nine(job: CalibrationJob) -> None:
    """Six offsets and three lengths: the fewer the unknowns, the less a difference costs SciPy."""
    race = Race(job, NINE)
    taken = timed(race.ours)
    posed = timed(lambda: race.scipy(NumpyDistances, race.posed))
    found = timed(lambda: race.scipy(NumpyDistances, race.found))
    rows = [
        ("ours, checks and covariance included", *taken),
        ("SciPy TRF, NumPy, all 9 as posed", *posed),
        (f"SciPy TRF, NumPy, the identified {len(race.found)}", *found),
    ]
    _print(f"The same with six offsets and three lengths, best of {ROUNDS}", rows)
    for key, (times, _) in {"trf-nine-posed": posed, "trf-nine-found": found}.items():
        record(key, np.divide(times, taken[0]))


def _plain(job: CalibrationJob) -> PairwiseDistance:
    """The job's distances without the artefact's certificate, which SciPy's version ignores."""
    term = job.observations[0]
    assert isinstance(term, PairwiseDistance)
    exact = [replace(mark, sigma=0.0) for mark in term.artefact.landmarks.values()]
    artefact = replace(term.artefact, landmarks={mark.name: mark for mark in exact})
    return PairwiseDistance(term.poses, artefact, term.noise)


def _print(title: str, rows: list[tuple[str, list[float], float]]) -> None:
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
        began = process_time()
        for _ in range(count):
            work()
        return (process_time() - began) / count * 1e3

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
