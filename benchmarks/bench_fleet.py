"""Many robots in one command: time and memory from 10 to 1,000, a kill -9 on the way, and --resume.

Every robot is a SUTA with errors of its own, seen by a tracker: 40 rows to fit, 15 held out, two
starts. Each size is calibrated by one command; of the largest, the command is killed (``kill -9``)
when half of the results are there, and goes on with ``--resume``. Processor time is that of the
command and its workers: on a computer with nothing else to do, two processes take half of it.
Writes benchmarks/results/fleet.md. Arguments are sizes: ``bench_fleet.py 10 100``.
"""

from __future__ import annotations

import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from suta_calib import ArmModel, Samples
from suta_calib.geometry import rotation_from_vector
from suta_calib.measurements import write_samples
from suta_calib.units import from_mm

ROOT = Path(__file__).parents[1]
URDF = ROOT / "urdf" / "suta.urdf"
PAGE = Path(__file__).parent / "results" / "fleet.md"
SIZES = (10, 100, 1000)
PROCESSES = 2
# Of 1,000 robots, of one of two cores, s: three minutes on both.
LIMIT = 360.0
NOISE = from_mm(0.05)
JOB = """\
arm: {urdf: ../arm.urdf, tip: tip}
parameters:
  - {select: ["joint_*.offset"], bound_deg: 15}
  - {select: [joint_4.z, joint_6.z], bound_mm: 30}
observations:
  - {kind: tracked_point, samples: calibration.csv, sigma_mm: 0.05}
validation:
  - {kind: tracked_point, samples: validation.csv}
solver: {starts: 2, seed: 0}
"""


@dataclass(frozen=True)
class Cost:
    """Of one size: on the clock and of the processors, s; of the largest process, MB."""

    robots: int
    seconds: float
    processor: float
    megabytes: float


def write_fleet(folder: Path, robots: int) -> None:
    """So many robots, each with errors of its own."""
    arm = ArmModel.from_urdf(URDF, "tip")
    shutil.copy(URDF, folder / "arm.urdf")
    turn = rotation_from_vector([0.1, -0.4, 1.2])
    for k in range(robots):
        random, robot = np.random.default_rng(k), folder / f"robot_{k:04d}"
        robot.mkdir()
        truth = {f"{joint}.offset": random.normal(0.0, 0.01) for joint in arm.joints}
        for name, rows in (("calibration", 40), ("validation", 15)):
            q = random.uniform(-1.5, 1.5, (rows, len(arm.joints)))
            _, position = arm.forward(q, truth)
            seen = position @ turn.T + [1.0, -0.5, 0.3] + random.normal(0.0, NOISE, (rows, 3))
            write_samples(robot / f"{name}.csv", Samples.from_arrays(arm.joints, q, position=seen))
        (robot / "calibration.yaml").write_text(JOB)


def command(folder: Path, *options: str) -> list[str]:
    """The command line that calibrates them all."""
    jobs = str(folder / "*" / "calibration.yaml")
    called = [sys.executable, "-m", "suta_calib", "calibrate", jobs, "--jobs", str(PROCESSES)]
    return [*called, "--json", *options]


def measured(folder: Path, robots: int, *options: str) -> Cost:
    """Run the command to its end."""
    began = time.perf_counter()
    process = subprocess.Popen(command(folder, *options), stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, 1):
        raise SystemExit(f"{robots} robots: exit code {process.returncode}")
    seconds = time.perf_counter() - began
    return Cost(robots, seconds, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)


def killed(folder: Path, robots: int) -> int:
    """Kill the command when half of the results are there; how many are."""
    nowhere = subprocess.DEVNULL
    process = subprocess.Popen(command(folder), stdout=nowhere, stderr=nowhere)

    def there() -> int:
        return len([*folder.glob("*/results/result.json")])

    while process.poll() is None and there() < robots // 2:
        time.sleep(0.2)
    process.send_signal(signal.SIGKILL)
    process.wait()
    # Workers end within a second of it.
    time.sleep(3.0)
    return there()


def main(sizes: Sequence[int]) -> None:
    """Measure every size, write the page, and fail where the limit is passed."""
    costs, sentence = [], ""
    for robots in sizes:
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            write_fleet(folder, robots)
            costs.append(measured(folder, robots))
            print(costs[-1], flush=True)
            if robots == max(sizes):
                for results in folder.glob("*/results"):
                    shutil.rmtree(results)
                there = killed(folder, robots)
                again = measured(folder, robots, "--resume")
                sentence = (
                    f"Killed (`kill -9`) when {there:,} of {robots:,} results were there; "
                    f"`--resume` did the others in {again.seconds:.0f} s "
                    f"({again.processor:.0f} s of the processors)."
                )
    PAGE.write_text(page(costs, sentence), encoding="utf-8")
    print(page(costs, sentence))
    if any(cost.processor > LIMIT * max(cost.robots / 1000, 0.1) for cost in costs):
        raise SystemExit(f"over the limit of {LIMIT:g} s of the processors for 1,000 robots")


def page(costs: Sequence[Cost], sentence: str) -> str:
    """The table as Markdown."""
    rows = [
        f"| {c.robots:,} | {c.seconds:.1f} | {c.processor:.1f} "
        f"| {1e3 * c.processor / c.robots:.0f} | {c.megabytes:.0f} |"
        for c in costs
    ]
    lines = [
        "# Many robots in one command",
        "",
        f"Written by `benchmarks/bench_fleet.py`: simulated robots, {PROCESSES} processes. Seconds",
        "of the processors are those of the command and its workers together; with nothing else to",
        "do, a computer of two cores takes half of them. Memory is that of the largest process.",
        f"Python {platform.python_version()}, {os.cpu_count()} cores, load "
        f"{os.getloadavg()[0]:.1f} (what shares a core with others takes more of it).",
        "",
        "| robots | on the clock, s | processors, s | for each, ms | memory, MB |",
        "|--:|--:|--:|--:|--:|",
        *rows,
        "",
        sentence,
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main([int(size) for size in sys.argv[1:]] or SIZES)
