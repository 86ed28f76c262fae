"""Whole commands on much data: processor time and peak memory, each in a process of its own.

Simulated data with known truth, written as a user's files are; every command is asked for its JSON.
Time is that of all its processes, so that another program on the machine matters little. Fails
where a limit is passed. Arguments name the cases to run: ``bench_large.py register hand-eye``.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from tables import number_table

from suta_calib import ArmModel, FixedPoint, HandEye
from suta_calib.arrays import FloatArray
from suta_calib.geometry import quaternion_from_rotation, rotation_from_vector
from suta_calib.terms import PoseNoise
from suta_calib.units import from_deg, from_mm, mm

URDF = Path(__file__).parents[1] / "urdf" / "suta.urdf"
RESULTS = Path(__file__).parent / "results" / "large.md"
NOISE = PoseNoise(from_mm(0.3), from_deg(0.1))
MEGABYTE = 1 << 10  # kilobytes, of which the system counts
QUATERNION = ("x", "y", "z", "qx", "qy", "qz", "qw")


@dataclass(frozen=True)
class Case:
    """One command on ``rows`` rows.

    Attributes:
        name: what a person calls it.
        rows: of its largest file.
        write: puts its files into a folder; answers with the command's arguments.
        seconds, megabytes: limits of processor time and memory, start-up included.
    """

    name: str
    rows: int
    write: Callable[[Path, int], Sequence[str]]
    seconds: float
    megabytes: float


@dataclass(frozen=True)
class Cost:
    """What one process used: processor time, s, peak memory, MB, and its exit code."""

    seconds: float
    megabytes: float
    code: int


def spent(arguments: Sequence[str]) -> Cost:
    """Run ``suta-calib`` with arguments to its end."""
    command = [sys.executable, "-m", "suta_calib", *arguments]
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=said)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode not in (0, 1):
            said.seek(0)
            raise SystemExit(f"{' '.join(command)}:\n{said.read().decode()}")
    return Cost(used.ru_utime + used.ru_stime, used.ru_maxrss / MEGABYTE, process.returncode)


def write_columns(path: Path, names: Sequence[str], *columns: Any) -> Path:
    """A CSV file of columns of numbers, (n,) or (n, k)."""
    np.savetxt(path, np.column_stack(columns), "%.9g", ",", header=",".join(names), comments="")
    return path


def registration(folder: Path, rows: int) -> Sequence[str]:
    """Two sets of points, and 5 % of the second anywhere."""
    random = np.random.default_rng(0)
    points = random.random((rows, 3))
    seen = points @ rotation_from_vector([0.3, -1.2, 0.7]).T + [1.1, -0.4, 0.6]
    seen += random.normal(0.0, NOISE.position, seen.shape)
    seen[: rows // 20] = random.random((rows // 20, 3)) * 2
    a = write_columns(folder / "a.csv", "xyz", points)
    b = write_columns(folder / "b.csv", "xyz", seen)
    return ("register", str(a), str(b), "--json")


def hand_eye(folder: Path, rows: int) -> Sequence[str]:
    """Noise on both; no outliers."""
    data = HandEye.simulate(rows, hand=NOISE, eye=NOISE, seed=0)
    names = [f"{of}_{name}" for of in "ab" for name in QUATERNION]
    path = write_columns(folder / "poses.csv", names, _columns(*data.poses), _columns(*data.seen))
    return ("hand-eye", str(path), "--json")


def pivot(folder: Path, rows: int) -> Sequence[str]:
    """One post."""
    data = FixedPoint.simulate(rows, spread=NOISE, seed=0)
    path = write_columns(folder / "poses.csv", QUATERNION, _columns(*data.poses))
    return ("pivot", str(path), "--json")


def stationary(folder: Path, rows: int) -> Sequence[str]:
    """Six encoders at rest."""
    random = np.random.default_rng(0)
    readings = random.normal(0.0, 1e-5, (rows, 6)) + np.arange(6) / 3
    names = ("time", *(f"joint_{k}" for k in range(1, 7)))
    path = write_columns(folder / "rest.csv", names, np.arange(rows) / 768, readings)
    return ("repeatability", "--stationary", str(path), "--json")


def tracked(folder: Path, rows: int) -> Sequence[str]:
    """A tracker saw the tip of a SUTA with offsets; the offsets and lengths are unknown."""
    random = np.random.default_rng(0)
    arm = ArmModel.from_urdf(URDF, "tip")
    q = random.uniform(-1.2, 1.2, (rows, len(arm.joints)))
    truth = {f"{joint}.offset": random.normal(0.0, 0.01) for joint in arm.joints}
    _, position = arm.forward(q, truth)
    seen = position @ rotation_from_vector([0.3, -1.2, 0.7]).T + [1.1, -0.4, 0.6]
    seen += random.normal(0.0, from_mm(0.1), seen.shape)
    write_columns(folder / "tracked.csv", (*arm.joints, *"xyz"), q, seen)
    job = folder / "calibration.yaml"
    job.write_text(
        f"arm: {{urdf: {URDF}, tip: tip}}\n"
        "parameters:\n"
        '  - {select: ["joint_*.offset"], bound_deg: 15}\n'
        "  - {select: [joint_4.z, joint_6.z, tip.y], bound_mm: 30}\n"
        "observations:\n"
        f"  - {{kind: tracked_point, samples: tracked.csv, huber_mm: {mm(from_mm(0.3)):g}}}\n"
    )
    return ("calibrate", str(job), "--json")


def _columns(rotation: FloatArray, position: FloatArray) -> FloatArray:
    return np.hstack([position, quaternion_from_rotation(rotation)])


CASES = (
    Case("register", 100_000, registration, 2.0, 500),
    Case("hand-eye", 1_000, hand_eye, 1.5, 500),
    Case("hand-eye", 10_000, hand_eye, 3.0, 500),
    Case("pivot", 100_000, pivot, 2.0, 500),
    Case("stationary", 1_000_000, stationary, 8.0, 1000),
    Case("tracked_point", 10_000, tracked, 3.0, 500),
    Case("tracked_point", 100_000, tracked, 6.0, 1000),
    Case("tracked_point", 1_000_000, tracked, 60.0, 8000),
)


def main(chosen: Sequence[str]) -> None:
    """Print the table and fail where a limit is passed."""
    columns = ("rows", "CPU, s", "limit", "peak, MB", "limit", "exit code")
    table, passed = number_table("Much data, one process each", "case", *columns), []
    for case in CASES:
        if chosen and case.name not in chosen and f"{case.name}:{case.rows}" not in chosen:
            continue
        with tempfile.TemporaryDirectory() as folder:
            cost = spent(case.write(Path(folder), case.rows))
        limits = f"{case.seconds:g}", f"{case.megabytes:g}"
        table.add_row(
            case.name,
            f"{case.rows:,}",
            f"{cost.seconds:.2f}",
            limits[0],
            f"{cost.megabytes:.0f}",
            limits[1],
            str(cost.code),
        )
        if cost.seconds > case.seconds or cost.megabytes > case.megabytes:
            passed.append(f"{case.name} of {case.rows:,} rows")
    Console(width=100).print(table)
    if passed:
        raise SystemExit(f"over the limit: {', '.join(passed)}")


if __name__ == "__main__":
    main(sys.argv[1:])
