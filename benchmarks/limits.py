"""What may take how long: each limit once, and the page that holds our figures beside them.

What much data may take stands with its cases in ``bench_large.py``, whose page is ``large.md``.

A benchmark measures a limit several times and calls ``record``. The figures stay in
``results/limits.json``, so that every script can run alone, and ``results/limits.md`` is written
anew from all of them. Commands are processes of their own, timed from the shell; processor time is
user and system, children included, so that a busy machine changes it little.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Final

ROOT: Final = Path(__file__).parents[1]
RESULTS: Final = Path(__file__).parent / "results"
FIGURES: Final = RESULTS / "limits.json"
PAGE: Final = RESULTS / "limits.md"

# What any program that calibrates an arm with these libraries imports.
IMPORTS: Final = "import pinocchio, casadi, scipy.optimize, scipy.spatial"


@dataclass(frozen=True)
class Limit:
    """How much something may take.

    Attributes:
        key: names it in ``record``.
        what: what is measured, as the page says it.
        bound: the limit, in ``unit``.
        unit: of the bound and of every figure.
        script: the benchmark that measures it.
        least: whether more is better, and the bound is the least.
    """

    key: str
    what: str
    bound: float
    unit: str
    script: str
    least: bool = False

    def kept(self, figure: float) -> bool:
        """Whether a figure keeps the limit."""
        return figure >= self.bound if self.least else figure <= self.bound

    def __str__(self) -> str:
        return f"{'≥' if self.least else '≤'} {self.bound:g} {self.unit}"


_STARTUP: Final = "× bare imports"

LIMITS: Final = (
    Limit("help", "`--help`", 0.15, "s", "bench_commands.py"),
    # The answer is printed before Matplotlib is imported and the report's pictures are drawn.
    Limit("calibrate", "`calibrate --no-report`, shipped job", 2.0, _STARTUP, "bench_commands.py"),
    Limit("waited", "`calibrate` until it prints, wall time", 2.0, _STARTUP, "bench_commands.py"),
    Limit("observe", "`observe`, shipped job", 1.6, _STARTUP, "bench_commands.py"),
    Limit("validate", "`validate`, shipped job", 1.6, _STARTUP, "bench_commands.py"),
    Limit("pivot", "`pivot`, shipped poses", 1.6, _STARTUP, "bench_commands.py"),
    Limit("hand-eye", "`hand-eye`, shipped poses", 1.6, _STARTUP, "bench_commands.py"),
    Limit("register", "`register`, shipped points", 1.6, _STARTUP, "bench_commands.py"),
    Limit("report", "report of the shipped job", 1.2, "s", "bench_commands.py"),
    Limit("outliers", "`outliers`, shipped job", 2.0, "s", "bench_commands.py"),
    Limit("budget", "`budget`, shipped job", 3.0, "s", "bench_commands.py"),
    Limit("plan", "`plan -n 4`, shipped job", 4.0, "s", "bench_commands.py"),
    Limit("tip-map", "`tip-map`, shipped job", 4.0, "s", "bench_commands.py"),
    Limit("study", "1,000 calibrations of a study, one process", 10, "s", "bench_study.py"),
    Limit("study-two", "the same on two processes, wall time", 5, "s", "bench_study.py"),
    Limit("trf-posed", "SciPy's TRF, 13 unknowns", 20, "× ours", "bench_solver.py", least=True),
    Limit("trf-found", "SciPy's TRF, 10 unknowns", 8, "× ours", "bench_solver.py", least=True),
    Limit("trf-nine-posed", "SciPy's TRF, 9 unknowns", 10, "× ours", "bench_solver.py", least=True),
    Limit(
        "trf-nine-found",
        "SciPy's TRF, those of the 9 that can be found",
        5,
        "× ours",
        "bench_solver.py",
        least=True,
    ),
    Limit("trf-jacobian", "TRF, our Jacobian", 1, "× ours", "bench_solver.py", least=True),
    Limit("live", "frame to published pose, p99, 768 Hz", 1, "ms", "bench_tracking.py"),
    Limit(
        "bulk",
        "readings decoded in bulk, the slowest format",
        20,
        "× 768 Hz",
        "bench_device.py",
        least=True,
    ),
)
BY_KEY: Final = {limit.key: limit for limit in LIMITS}


def record(key: str, figures: Sequence[float], peer: str = "") -> None:
    """Keep what was measured of one limit, print it, and write the page anew.

    Args:
        key: of a ``Limit``.
        figures: of several runs, in the limit's unit.
        peer: what others take for the same, in words.
    """
    limit = BY_KEY[key]
    known = json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.exists() else {}
    known[key] = {"figures": [round(float(each), 4) for each in figures], "peer": peer}
    known = {name: known[name] for name in BY_KEY if name in known}
    FIGURES.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(_page(known), encoding="utf-8")
    print("  ".join(_cells(limit, known[key])))


def processor_time(command: Sequence[str]) -> float:
    """User and system time of one process and its children, s; what it says is dropped."""
    return times(command)[0]


def until_printed(command: Sequence[str]) -> float:
    """Wall time until a process prints its first line, s; it ends before this returns."""
    begin = time.perf_counter()
    with subprocess.Popen(
        [sys.executable, *command], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as run:
        assert run.stdout is not None
        run.stdout.readline()
        waited = time.perf_counter() - begin
        run.stdout.read()
    if run.returncode:
        raise subprocess.CalledProcessError(run.returncode, run.args)
    return waited


def times(command: Sequence[str]) -> tuple[float, float]:
    """The same, and its wall time, s."""
    before = os.times()
    subprocess.run(
        [sys.executable, *command],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=True,
    )
    after = os.times()
    processor = (after.children_user + after.children_system) - (
        before.children_user + before.children_system
    )
    return processor, after.elapsed - before.elapsed


def _cells(limit: Limit, found: dict[str, list[float] | str]) -> tuple[str, ...]:
    figures = [float(each) for each in found["figures"]]
    middle = median(figures)
    return (
        limit.what,
        str(limit),
        *(f"{each:.3g}" for each in (min(figures), middle, max(figures))),
        "yes" if limit.kept(middle) else "**no**",
        str(found["peer"]),
    )


def _busy() -> list[str]:
    """A line for a page that was written while others worked on the same computer."""
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    if load <= cores:
        return []
    return [
        f"**The computer was busy** (load {load:.0f} on {cores} cores): processor times are then up"
        " to twice as long, and latencies say nothing."
    ]


def _page(known: dict[str, dict[str, list[float] | str]]) -> str:
    rows = [(limit, known.get(limit.key)) for limit in LIMITS]
    lines = [
        "# What may take how long",
        "",
        "Written by `make bench`: each limit beside its figure, several runs each, one thread of",
        "linear algebra. Seconds are processor time, user and system; wall time is that of a quiet",
        "computer. *Bare imports* are",
        f"`{IMPORTS}` just before it. Whether a limit is kept goes by the median.",
        f"Python {platform.python_version()}, {os.cpu_count()} cores. Much data: `large.md`.",
        *_busy(),
        "",
        "| what | limit | min | median | max | kept | peer |",
        "|---|--:|--:|--:|--:|---|---|",
    ]
    for limit, found in rows:
        if found is None:
            cells: tuple[str, ...] = (limit.what, str(limit), "", "", "", "not measured", "")
        else:
            cells = _cells(limit, found)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([*lines, ""])
