"""Time of the dataset-size study, 10 sizes x 100 trials, and of the same with SciPy, in one run.

Ours: 1,000 calibrations with everything a calibration does (what the data can tell, what is held,
covariance, held-out error), on one process, on two, and on a Dask cluster of two processes where
`distributed` is installed. Starting the workers is counted, starting the cluster is not. SciPy's:
the same subsets, all thirteen unknowns as posed, vectorised NumPy kinematics, TRF with 2-point
differences from nominal, one process; every tenth trial, so its time is ten times what it took. On
a busy computer the CPU time, of this process alone, says more than the clock.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
from limits import record
from peers import NumpyDistances
from rich.console import Console
from rich.table import Table
from tables import number_table

from suta_calib import CalibrationJob, Problem
from suta_calib.analysis.study import Request, StudyPlan, Trial, judge_sizes, plan_study, run_study
from suta_calib.report import rendered, study_document

JOB = Path(__file__).parents[1] / "data" / "suta" / "calibration.yaml"
TRIALS = 100
SIZES = tuple(range(1, 11))
EVERY = 10
Row = tuple[str, float, float | None, str]


def main() -> None:
    """Print the study, the times, and whether everybody got the same numbers."""
    job = CalibrationJob.load(JOB)
    asked = Request("size", TRIALS, SIZES)
    plan = plan_study(job.parameters, job.observations, job.validation, job.options(), asked)
    rows: list[Row] = []
    began, used = perf_counter(), process_time()
    alone = run_study(plan)
    rows.append(("ours, one process", perf_counter() - began, process_time() - used, "reference"))
    record("study", [process_time() - used], f"{len(alone):,} calibrations, once")
    began = perf_counter()
    two = run_study(plan, workers=2)
    waited = perf_counter() - began
    rows.append(("ours, this process and another", waited, None, same(two, alone)))
    record("study-two", [waited], "once, starting the processes included")
    with cluster() as address:
        if address is not None:
            began = perf_counter()
            far = run_study(plan, dask=address)
            row = ("ours, Dask cluster of two processes", perf_counter() - began, None)
            rows.append((*row, same(far, alone)))
    rows.append(scipy(plan, alone))
    console = Console(width=100)
    console.print(rendered(study_document(judge_sizes(plan, alone, 0.05))))
    console.print(table(rows))
    load = os.getloadavg()[0]
    console.print(f"{os.cpu_count()} cores; load of the last minute {load:.1f}")


def same(found: tuple[Trial, ...], alone: tuple[Trial, ...]) -> str:
    """Whether two runs agree to the last bit."""
    return "identical" if found == alone else "DIFFERENT"


@contextmanager
def cluster() -> Iterator[str | None]:
    """Address of a Dask cluster of two processes; None where it is not installed."""
    try:
        from distributed import LocalCluster
    except ImportError:
        yield None
        return
    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50
    ) as running:
        yield running.scheduler_address


def scipy(plan: StudyPlan, ours: tuple[Trial, ...]) -> Row:
    """The same subsets solved by SciPy; what its mean error is beside ours."""
    data = plan.data
    names = list(data.parameters.names)
    nominal = data.parameters.array("nominal")
    held_out = NumpyDistances(Problem(data.validation, data.parameters), names)
    wall, cpu, errors = perf_counter(), process_time(), []
    picked = [k for k in range(len(plan.tasks)) if k % EVERY == 0]
    for k in picked:
        terms = data.sets.take(data.terms, data.chosen(*plan.tasks[k]))
        peer = NumpyDistances(Problem(terms, data.parameters), names)
        residual = held_out.residuals(peer.solve(nominal).x)
        errors.append(np.sqrt(np.mean(residual**2)))
    wall, cpu = EVERY * (perf_counter() - wall), EVERY * (process_time() - cpu)
    mine = np.mean([ours[k].rms for k in picked])
    told = f"held-out error {1e3 * np.mean(errors):.3f} mm, ours {1e3 * mine:.3f} mm"
    return ("SciPy TRF, NumPy, one process", wall, cpu, told)


def table(rows: list[Row]) -> Table:
    """Times, rates and ratios to the first row."""
    title = f"{len(SIZES)} sizes x {TRIALS} trials on the simulated SUTA"
    found = number_table(title, "who", "time, s", "trials/s", "ratio", "CPU, s", "CPU ratio")
    found.add_column("numbers")
    for who, seconds, cpu, told in rows:
        rate, ratio = len(SIZES) * TRIALS / seconds, seconds / rows[0][1]
        used = ("", "") if cpu is None else (f"{cpu:.1f}", f"{cpu / (rows[0][2] or 1):.2f}")
        found.add_row(who, f"{seconds:.1f}", f"{rate:.0f}", f"{ratio:.2f}", *used, told)
    return found


if __name__ == "__main__":
    main()
