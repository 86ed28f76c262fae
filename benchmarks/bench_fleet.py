"""Many robots in one command: time and memory, a kill -9 on the way, --resume, checks and plans.

Every robot is a SUTA with errors of its own, seen by a tracker: 40 rows to fit, 15 held out, two
starts. Each size is calibrated by one command; of the largest, the command is killed (``kill -9``)
when half of the results are there, and goes on with ``--resume``. Processor time is that of the
command and its workers: on a computer with nothing else to do, two processes take half of it.
Then 100 robots are checked by ten new rows each, 5 are planned for, and 5 are followed over rows
that are there, which tells how many one core can follow at a row each second.
Writes benchmarks/results/fleet.md (and fleet_checks.md). Arguments are sizes: ``bench_fleet.py 10
100``; ``bench_fleet.py checks`` does the second part alone.
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
CHECKS = PAGE.with_name("fleet_checks.md")
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
        for name, rows in (("calibration", 40), ("validation", 15), ("check", 10), ("rows", 60)):
            q = random.uniform(-1.5, 1.5, (rows, len(arm.joints)))
            _, position = arm.forward(q, truth)
            seen = position @ turn.T + [1.0, -0.5, 0.3] + random.normal(0.0, NOISE, (rows, 3))
            write_samples(robot / f"{name}.csv", Samples.from_arrays(arm.joints, q, position=seen))
        (robot / "calibration.yaml").write_text(JOB)


def command(folder: Path, *options: str) -> list[str]:
    """The command line that calibrates them all."""
    jobs = str(folder / "*" / "calibration.yaml")
    return suta_calib("calibrate", jobs, "--jobs", str(PROCESSES), *options)


def suta_calib(*arguments: str) -> list[str]:
    """A command line."""
    return [sys.executable, "-m", "suta_calib", *arguments, "--json"]


def measured(folder: Path, robots: int, *options: str) -> Cost:
    """Calibrate them all."""
    return run(command(folder, *options), robots)


def run(called: Sequence[str], robots: int) -> Cost:
    """Run a command to its end."""
    began = time.perf_counter()
    process = subprocess.Popen(called, stdout=subprocess.DEVNULL)
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


def write_list(folder: Path, robots: int, rows: str, count: int) -> Path:
    """A list of robots, each with so many rows of one of its files."""
    lines = ["robot,result,samples"]
    for robot in sorted(folder.glob("robot_*"))[:robots]:
        text = (robot / f"{rows}.csv").read_text().splitlines(keepends=True)
        (robot / "new.csv").write_text("".join(text[: count + 1]))
        lines.append(f"{robot.name},{robot}/results,{robot}/new.csv")
    (folder / "fleet.csv").write_text("\n".join([*lines, ""]))
    return folder / "fleet.csv"


def checks(robots: int = 100, few: int = 5) -> None:
    """Check and follow many robots, plan for some, and write the page."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_fleet(folder, robots)
        measured(folder, robots)
        listed = str(write_list(folder, robots, "check", 10))
        costs = {
            f"`check --fleet`, ten rows of each of {robots}": run(
                suta_calib("check", "--fleet", listed, "--jobs", str(PROCESSES)), robots
            )
        }
        jobs = [str(folder / f"robot_{k:04d}" / "calibration.yaml") for k in range(few)]
        costs[f"`plan` for {few}, three measurements each"] = run(
            suta_calib("plan", *jobs, "--jobs", str(PROCESSES)), few
        )
        # Of rows that are there, from the fifth to the sixtieth of each.
        used = list[float]()
        for count in (5, 60):
            listed = str(write_list(folder, few, "rows", count))
            given = ("--follow", "--seconds", "0.1", "--jobs", "1", "--no-history")
            used.append(run(suta_calib("check", "--fleet", listed, *given), few).processor)
        each = (used[1] - used[0]) / (few * 55)
    rows = [
        f"| {name} | {c.seconds:.1f} | {c.processor:.1f} | {1e3 * c.processor / c.robots:.0f} |"
        for name, c in costs.items()
    ]
    lines = [
        *head("Many robots: checks and plans"),
        "| command | on the clock, s | processors, s | for each robot, ms |",
        "|---|--:|--:|--:|",
        *rows,
        "",
        f"`check --fleet --follow` takes {1e3 * each:.0f} ms of a core for each row: one core",
        f"follows {1.0 / each:.0f} robots that give a row each second.",
        "",
    ]
    CHECKS.write_text("\n".join(lines), encoding="utf-8")
    print(CHECKS.read_text())


def head(title: str) -> list[str]:
    """Of a page: what was run, and on what."""
    return [
        f"# {title}",
        "",
        f"Written by `benchmarks/bench_fleet.py`: simulated robots, {PROCESSES} processes. Seconds",
        "of the processors are those of the command and its workers together; with nothing else to",
        "do, a computer of two cores takes half of them.",
        f"Python {platform.python_version()}, {os.cpu_count()} cores, load "
        f"{os.getloadavg()[0]:.1f} (what shares a core with others takes more of it).",
        "",
    ]


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
        *head("Many robots in one command"),
        "| robots | on the clock, s | processors, s | for each, ms | memory, MB |",
        "|--:|--:|--:|--:|--:|",
        *rows,
        "",
        "Memory is that of the largest process.",
        sentence,
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    if sys.argv[1:] != ["checks"]:
        main([int(size) for size in sys.argv[1:]] or SIZES)
    checks()
