"""Cost against the number of samples, 225 to 100,000: time and memory, and a picture.

The simulated SUTA samples are repeated as further placements with fresh encoder noise, so that
every size is the same problem with more data. Writes benchmarks/results/scaling.svg.
"""

from __future__ import annotations

import resource
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from tables import number_table

from suta_calib import ArmPoses, CalibrationJob, PairwiseDistance, Problem, Samples, solve

JOB = Path(__file__).parents[1] / "data" / "suta" / "calibration.yaml"
PICTURE = Path(__file__).parent / "results" / "scaling.svg"
SIZES = (225, 1_000, 3_000, 10_000, 30_000, 100_000)
LIMIT_MB = 2048


def repeated(samples: Samples, count: int, random: np.random.Generator) -> Samples:
    """At least ``count`` samples: the same touches again, under new placement labels."""
    copies = -(-count // len(samples))
    index = np.tile(np.arange(len(samples)), copies)
    more = samples.take(index)
    round_of = np.repeat(np.arange(copies), len(samples))
    placement = np.array(
        [f"{p}-{k}" for p, k in zip(more.labels["placement"], round_of, strict=True)]
    )
    noise = random.normal(0.0, 1e-5, more.q.shape)
    return replace(more, q=more.q + noise, labels={**more.labels, "placement": placement})


def main() -> None:
    """Print the table, draw the picture, and fail if memory passes the limit."""
    job = CalibrationJob.load(JOB)
    term = job.observations[0]
    assert isinstance(term, PairwiseDistance)
    random = np.random.default_rng(0)
    rows = []
    for size in SIZES:
        samples = repeated(term.poses.samples, size, random)
        began = perf_counter()
        poses = ArmPoses(job.arm, samples)
        problem = Problem([PairwiseDistance(poses, term.artefact, term.noise)], job.parameters)
        built = perf_counter()
        solution = solve(problem)
        done = perf_counter()
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        pairs = len(problem.blocks[0])
        rows.append((len(samples), pairs, built - began, done - built, peak))
        if not solution.converged:
            raise SystemExit(f"{len(samples)} samples: {solution.sentence}")
    _print(rows)
    _draw(rows)
    if rows[-1][-1] > LIMIT_MB:
        raise SystemExit(f"peak memory {rows[-1][-1]:.0f} MB is over {LIMIT_MB} MB")


def _print(rows: list[tuple[int, int, float, float, float]]) -> None:
    columns = ("samples", "distances", "build, s", "solve, s", "µs per sample", "peak, MB")
    table = number_table("One start, pairwise distances, simulated SUTA", *columns)
    for n, pairs, build, seconds, peak in rows:
        each = f"{(build + seconds) / n * 1e6:.1f}"
        table.add_row(f"{n:,}", f"{pairs:,}", f"{build:.3f}", f"{seconds:.3f}", each, f"{peak:.0f}")
    Console(width=100).print(table)


def _draw(rows: list[tuple[int, int, float, float, float]]) -> None:
    n = np.array([r[0] for r in rows])
    seconds = np.array([r[2] + r[3] for r in rows])
    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    axes.loglog(n, seconds, "o-", color="#0072B2", label="build and solve")
    axes.loglog(n, seconds[-1] * n / n[-1], "--", color="#555555", label="linear")
    axes.set_xlabel("samples")
    axes.set_ylabel("time, s")
    axes.grid(visible=True, which="both", alpha=0.3)
    axes.legend()
    PICTURE.parent.mkdir(exist_ok=True)
    figure.savefig(PICTURE)
    Console().print(f"picture: benchmarks/results/{PICTURE.name}")


if __name__ == "__main__":
    main()
