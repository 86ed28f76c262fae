"""Whole commands on much data: processor time and peak memory, each in a process of its own.

Simulated data with known truth, written as a user's files are; every command is asked for its JSON.
Time is processor time of all its processes, so that another program on the machine matters less.
A limit is for what the rows cost: what the same command takes for a few rows, which is start-up, is
measured in the same run and subtracted. Writes benchmarks/results/large.md and the picture of the
guide, docs/figures/many_rows.svg, and fails where a limit is passed. Arguments name the cases to
run: ``bench_large.py register hand-eye``, ``bench_large.py tracked_point:100000``; the page keeps
the figures of the others.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter
from typing import Any

import cv2
import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from rich.console import Console
from tables import number_table

from suta_calib import ArmModel, CalibrationJob, FixedPoint, HandEye
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.geometry import quaternion_from_rotation, rotation_from_vector
from suta_calib.measurements import (
    Camera,
    Chessboard,
    Samples,
    read_camera,
    read_corners,
    write_board,
    write_samples,
)
from suta_calib.simulation import read_simulation, simulate, write_simulation
from suta_calib.terms import PoseNoise
from suta_calib.units import from_deg, from_mm, mm
from suta_calib.vision import RenderOptions, rendered

ROOT = Path(__file__).parents[1]
URDF = ROOT / "urdf" / "suta.urdf"
DISTANCES = ROOT / "data" / "suta"
CAMERA = ROOT / "examples" / "camera_on_arm"
PICTURES = 100
COARSE = 8
# A camera is calibrated from six pictures at least with a choice of its lens.
FEW_POSES = 8
PAGE = Path(__file__).parent / "results" / "large.md"
FIGURES = PAGE.with_suffix(".json")
PICTURE = Path(__file__).parents[1] / "docs" / "figures" / "many_rows.svg"
# What the picture shows of growth, with its colour.
GROWTH = {
    "tracked_point": "#0072B2",
    "tracked_point, 54 unknowns": "#D55E00",
    "pairwise_distance": "#009E73",
    "corners in 100 pictures": "#CC79A7",
}
NOISE = PoseNoise(from_mm(0.3), from_deg(0.1))
MEGABYTE = 1 << 10  # kilobytes, of which the system counts
COMMAND = ("-m", "suta_calib")
READING = """
import pathlib, sys
from suta_calib.measurements import JointRange, SampleColumns, read_samples
joints = [JointRange(f"joint_{k}", "rad", -3.0, 3.0) for k in range(1, 7)]
assert len(read_samples([pathlib.Path(sys.argv[1])], joints, SampleColumns(position=True)))
"""
ASSEMBLING = """
import pathlib, sys
import numpy as np
from suta_calib import ArmModel, Problem, Samples, Selection, solve
from suta_calib.measurements import read_artefact
from suta_calib.terms import ArmPoses, PairwiseDistance
urdf, artefact, touches = map(pathlib.Path, sys.argv[1:])
arm, stored = ArmModel.from_urdf(urdf, "tip"), np.load(touches)
labels = {name: stored[name] for name in stored.files if name != "q"}
poses = ArmPoses(arm, Samples.from_arrays(arm.joints, stored["q"], labels=labels))
unknown = arm.select(
    Selection(("joint_*.offset",), bound_rad=0.26),
    Selection(("joint_4.z", "joint_6.z", "tip.y"), bound_m=0.03),
)
assert solve(Problem([PairwiseDistance(poses, read_artefact(artefact))], unknown)).converged
"""
QUATERNION = ("x", "y", "z", "qx", "qy", "qz", "qw")


@dataclass(frozen=True)
class Case:
    """One command on ``rows`` rows.

    Attributes:
        name: what a person calls it.
        rows: of its largest file; or how much there is of what it is about.
        write: puts its files into a folder; answers with Python's arguments.
        seconds: limit of processor time, beyond what a few rows take.
        megabytes: limit of memory, with all that is loaded.
        few: rows that only show what starting takes.
    """

    name: str
    rows: int
    write: Callable[[Path, int], Sequence[str]]
    seconds: float
    megabytes: float
    few: int = 30

    @property
    def key(self) -> str:
        """Names it among the figures and on the command line."""
        return f"{self.name}:{self.rows}"

    def measured(self, starts: dict[tuple[str, int], float]) -> Cost:
        """What it takes, and what starting it takes, unless that is among those known by now."""
        if (self.name, self.few) not in starts:
            starts[self.name, self.few], _ = self._spent(self.few)
        return Cost(starts[self.name, self.few], *self._spent(self.rows))

    def _spent(self, rows: int) -> tuple[float, float]:
        with tempfile.TemporaryDirectory() as folder:
            # By a process of its own: the memory of the one that starts a command counts as its.
            with ProcessPoolExecutor(1, get_context("spawn")) as beside:
                arguments = beside.submit(self.write, Path(folder), rows).result()
            return spent(arguments)

    def cells(self, cost: Cost) -> tuple[str, ...]:
        """What the page says of it."""
        return (
            self.name,
            f"{self.rows:,}",
            f"{cost.start:.2f}",
            f"{cost.seconds - cost.start:.2f}",
            f"{self.seconds:g}",
            f"{cost.megabytes:.0f}",
            f"{self.megabytes:g}",
            "yes" if self.kept(cost) else "no",
        )

    def kept(self, cost: Cost) -> bool:
        """Whether both limits are."""
        return cost.seconds - cost.start <= self.seconds and cost.megabytes <= self.megabytes


@dataclass(frozen=True)
class Cost:
    """Processor time, s, of a few rows and of all; peak memory of all, MB."""

    start: float
    seconds: float
    megabytes: float


def spent(arguments: Sequence[str]) -> tuple[float, float]:
    """Run Python with arguments to its end: processor time, s, and peak memory, MB."""
    command = [sys.executable, *arguments]
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=said)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        error = said.read().decode()
        # An answer to be used with care, and what has failed in Python, both end with one.
        if process.returncode not in (0, 1) or "Traceback" in error:
            raise SystemExit(f"{' '.join(command)}:\n{error}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / MEGABYTE


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
    return (*COMMAND, "register", str(a), str(b), "--json")


def hand_eye(folder: Path, rows: int) -> Sequence[str]:
    """Noise on both; no outliers."""
    data = HandEye.simulate(rows, hand=NOISE, eye=NOISE, seed=0)
    names = [f"{of}_{name}" for of in "ab" for name in QUATERNION]
    path = write_columns(folder / "poses.csv", names, _columns(*data.poses), _columns(*data.seen))
    return (*COMMAND, "hand-eye", str(path), "--json")


def pivot(folder: Path, rows: int) -> Sequence[str]:
    """One post."""
    data = FixedPoint.simulate(rows, spread=NOISE, seed=0)
    path = write_columns(folder / "poses.csv", QUATERNION, _columns(*data.poses))
    return (*COMMAND, "pivot", str(path), "--json")


def stationary(folder: Path, rows: int) -> Sequence[str]:
    """Six encoders at rest."""
    random = np.random.default_rng(0)
    readings = random.normal(0.0, 1e-5, (rows, 6)) + np.arange(6) / 3
    names = ("time", *(f"joint_{k}" for k in range(1, 7)))
    path = write_columns(folder / "rest.csv", names, np.arange(rows) / 768, readings)
    return (*COMMAND, "repeatability", "--stationary", str(path), "--json")


FEW_UNKNOWNS = """\
  - {select: ["joint_*.offset"], bound_deg: 15}
  - {select: [joint_4.z, joint_6.z, tip.y], bound_mm: 30}
"""
ALL_UNKNOWNS = """\
  - {select: ["joint_*.offset"], bound_deg: 15}
  - {select: [geometric], bound_mm: 30, bound_deg: 15}
"""


def tracked_whole(folder: Path, rows: int) -> Sequence[str]:
    """The same with the geometry of every joint unknown: 54 unknowns."""
    return tracked(folder, rows, ALL_UNKNOWNS)


def tracked(folder: Path, rows: int, unknowns: str = FEW_UNKNOWNS) -> Sequence[str]:
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
        f"parameters:\n{unknowns}"
        "observations:\n"
        f"  - {{kind: tracked_point, samples: tracked.csv, huber_mm: {mm(from_mm(0.3)):g}}}\n"
    )
    return (*COMMAND, "calibrate", str(job), "--json")


def reading(folder: Path, rows: int) -> Sequence[str]:
    """Samples alone: six joints and what a tracker saw."""
    tracked(folder, rows)
    return ("-c", READING, str(folder / "tracked.csv"))


def touches(rows: int) -> Samples:
    """The shipped touches again and again, the artefact each time elsewhere around joint 1."""
    random, job = np.random.default_rng(0), CalibrationJob.load(DISTANCES / "calibration.yaml")
    samples = job.observations[0].poses.samples
    times = -(-rows // len(samples))
    q = np.tile(samples.q, (times, 1))
    # All of them alike, which changes no distance.
    q[:, 0] += np.repeat(random.uniform(-1.0, 1.0, times), len(samples))
    labels = {name: np.tile(values, times) for name, values in samples.labels.items()}
    number = np.repeat(np.arange(times), len(samples)).astype(np.str_)
    labels["placement"] = np.char.add(np.char.add(labels["placement"], "-"), number)
    return Samples.from_arrays(samples.joints, q, labels=labels).take(slice(rows))


def in_memory(folder: Path, rows: int) -> Sequence[str]:
    """The same touches as arrays: the problem and its solution alone, no file but these."""
    taken, path = touches(rows), folder / "touches.npz"
    np.savez(path, q=taken.q, **taken.labels)
    return ("-c", ASSEMBLING, str(URDF), str(DISTANCES / "artefact.yaml"), str(path))


def distances(folder: Path, rows: int) -> Sequence[str]:
    """The touches as a job."""
    write_samples(folder / "touches.csv", touches(rows))
    shutil.copy(DISTANCES / "artefact.yaml", folder)
    job_file = folder / "calibration.yaml"
    job_file.write_text(
        f"arm: {{urdf: {URDF}, tip: tip}}\n"
        "parameters:\n"
        '  - {select: ["joint_*.offset"], bound_deg: 15}\n'
        "  - {select: [joint_4.z, joint_6.z, tip.y], bound_mm: 30}\n"
        "observations:\n"
        "  - {kind: pairwise_distance, artefact: artefact.yaml, samples: touches.csv}\n"
    )
    return (*COMMAND, "calibrate", str(job_file), "--json")


def corners(folder: Path, rows: int) -> Sequence[str]:
    """Some hundred whole pictures of a board by the camera on an arm's hand.

    Simulated with a coarse board without noise of corners, and those of a fine one put between:
    whether a board of thousands is in sight takes longer to find out than to calibrate with it.
    """
    side, noise = math.isqrt(rows // PICTURES), "corner_px: 0.1"
    for name in ("arm.urdf", "camera.yaml"):
        shutil.copy(CAMERA / name, folder)
    _chessboard(folder, COARSE)
    spec = (
        (CAMERA / "simulation.yaml").read_text().replace("samples: 25", f"samples: {2 * PICTURES}")
    )
    assert noise in spec
    (folder / "simulation.yaml").write_text(spec.replace(noise, "corner_px: 1.0e-6"))
    write_simulation(simulate(read_simulation(folder / "simulation.yaml")), folder / "simulated")
    _chessboard(folder, side)
    for path in sorted((folder / "simulated" / "corners").glob("*.csv")):
        _refine(path, side)
    shutil.copy(CAMERA / "calibration.yaml", folder)
    return (*COMMAND, "calibrate", str(folder / "calibration.yaml"), "--json")


def _chessboard(folder: Path, side: int) -> None:
    square = 125 / (side - 1)
    board = f"type: chessboard\ncorners: [{side}, {side}]\nsquare_mm: {square}\n"
    (folder / "board.yaml").write_text(board)


def _refine(path: Path, side: int) -> None:
    """Corners of a fine board from those of the coarse one, by polynomials of each picture."""
    found, random = read_corners(path), np.random.default_rng(0)
    fine, room = np.arange(side**2), read_camera(CAMERA / "camera.yaml")
    lines = ["image,point,u,v"]
    for image in dict.fromkeys(found.image.tolist()):
        mine = found.image == image
        if mine.sum() < COARSE**2:
            continue  # partly out of the picture, as half of them are
        known = np.linalg.lstsq(_powers(found.point[mine], COARSE), found.pixel[mine], rcond=None)
        pixel = _powers(fine, side) @ known[0] + random.normal(0.0, 0.1, (side**2, 2))
        inside = np.flatnonzero(room.inside(pixel[None])[0])
        lines += [f"{image},{k},{pixel[k, 0]:.4f},{pixel[k, 1]:.4f}" for k in inside.tolist()]
    path.write_text("\n".join([*lines, ""]))


def _powers(point: IntArray, side: int) -> FloatArray:
    """Products of Chebyshev polynomials in both coordinates on the board."""
    row, column = np.divmod(point, side)
    scaled = (2.0 * each / (side - 1) - 1.0 for each in (row, column))
    return np.polynomial.chebyshev.chebvander2d(*scaled, [5, 5])


def searched(folder: Path, rows: int) -> Sequence[str]:
    """Pictures of 3840 x 2160 px with a chessboard: a few poses, and noise of its own in each."""
    board, random = Chessboard(9, 6, 0.03), np.random.default_rng(0)
    write_board(folder / "board.yaml", board)
    lens = np.array([2900.0, 2905, 1920, 1075, -0.1, 0.03, 4e-4, -3e-4, 0.0])
    taken_by, taken = Camera(3840, 2160, lens), []
    for _ in range(FEW_POSES):
        pose = np.eye(4)
        pose[:3, :3] = rotation_from_vector(random.uniform(-0.5, 0.5, 3))
        ahead = np.append(random.uniform(-0.08, 0.08, 2), random.uniform(0.5, 0.7))
        pose[:3, 3] = ahead - pose[:3, :3] @ np.mean(list(board.points.values()), axis=0)
        how = RenderOptions(samples=1, blur=1.5, noise=0.0)
        taken.append(rendered(board, taken_by, pose, random, how))
    noise = cv2.randn(np.zeros((2160, 3840), dtype=np.int16), 0, 4)
    (folder / "pictures").mkdir()
    for k in range(rows):
        # Each picture has other noise at each pixel.
        shifted = np.roll(noise, random.integers(1000, size=2), axis=(0, 1))
        grey = cv2.add(taken[k % len(taken)], shifted, dtype=cv2.CV_8U)
        cv2.imwrite(str(folder / "pictures" / f"{k:03d}.jpg"), grey)
    found = ("--out", str(folder / "corners.csv"), "--camera-out", str(folder / "camera.yaml"))
    files = (str(folder / "pictures"), "--board", str(folder / "board.yaml"), *found)
    return (*COMMAND, "detect", *files, "--json")


def joints(folder: Path, count: int) -> Sequence[str]:
    """A tracker saw the tip of an arm of many joints; their offsets and lengths are unknown."""
    random, rows = np.random.default_rng(0), 1000
    axes = itertools.cycle(("0 0 1", "0 1 0", "1 0 0"))
    inside = "".join(
        f'<link name="link_{k}"/><joint name="joint_{k}" type="revolute">'
        f'<parent link="link_{k - 1}"/><child link="link_{k}"/><origin xyz="0.01 0 0.06"/>'
        f'<axis xyz="{next(axes)}"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        for k in range(1, count + 1)
    )
    urdf = folder / "arm.urdf"
    urdf.write_text(f'<robot name="long"><link name="link_0"/>{inside}</robot>')
    arm = ArmModel.from_urdf(urdf, f"link_{count}")
    q = random.uniform(-1.2, 1.2, (rows, count))
    _, seen = arm.forward(q, {f"{joint}.offset": random.normal(0.0, 0.01) for joint in arm.joints})
    seen = seen + random.normal(0.0, from_mm(0.1), seen.shape)
    write_columns(folder / "tracked.csv", (*arm.joints, *"xyz"), q, seen)
    job = folder / "calibration.yaml"
    job.write_text(
        f"arm: {{urdf: arm.urdf, tip: link_{count}}}\n"
        "parameters:\n"
        '  - {select: ["joint_*.offset"], bound_deg: 5}\n'
        '  - {select: ["joint_*.z"], bound_mm: 5}\n'
        "observations:\n"
        "  - {kind: tracked_point, samples: tracked.csv, huber_mm: 0.3}\n"
        "solver: {starts: 1}\n"
    )
    return (*COMMAND, "calibrate", str(job), "--json")


def _columns(rotation: FloatArray, position: FloatArray) -> FloatArray:
    return np.hstack([position, quaternion_from_rotation(rotation)])


CASES = (
    Case("register", 100_000, registration, 2.0, 500),
    Case("hand-eye", 1_000, hand_eye, 0.3, 500),
    Case("hand-eye", 10_000, hand_eye, 2.0, 500),
    Case("pivot", 100_000, pivot, 0.5, 500),
    Case("stationary", 1_000_000, stationary, 6.0, 1000, few=200),
    Case("tracked_point", 1_000, tracked, 0.5, 500),
    Case("tracked_point", 10_000, tracked, 1.0, 500),
    Case("tracked_point", 100_000, tracked, 6.0, 1000),
    Case("tracked_point", 1_000_000, tracked, 60.0, 8000),
    Case("tracked_point, 54 unknowns", 1_000, tracked_whole, 0.5, 500, few=200),
    Case("tracked_point, 54 unknowns", 10_000, tracked_whole, 2.0, 500, few=200),
    Case("tracked_point, 54 unknowns", 100_000, tracked_whole, 8.0, 1000, few=200),
    Case("tracked_point, 54 unknowns", 1_000_000, tracked_whole, 80.0, 8000, few=200),
    Case("CSV read", 1_000_000, reading, 2.0, 1000),
    Case("pairwise_distance", 10_000, distances, 1.0, 500, few=225),
    Case("pairwise_distance", 100_000, distances, 12.0, 1200, few=225),
    Case("pairwise_distance, arrays", 10_000, in_memory, 0.3, 500, few=225),
    Case("pairwise_distance, arrays", 100_000, in_memory, 3.0, 1200, few=225),
    Case("corners in 100 pictures", 100_000, corners, 6.0, 1000, few=3600),
    Case("corners in 100 pictures", 1_000_000, corners, 60.0, 8000, few=3600),
    # 60 s on two cores, which it uses both.
    Case("detect, pictures of 4k", 100, searched, 120.0, 2000, few=FEW_POSES),
    Case("joints of an arm", 60, joints, 6.0, 1000, few=6),
)
HEADS = ("case", "rows", "start, s", "rows, s", "limit, s", "peak, MB", "limit, MB", "kept")


def main(chosen: Sequence[str]) -> None:
    """Measure, write the page after every case, and fail where a limit is passed."""
    known = json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.exists() else {}
    passed, rows = [], _rows(known)
    began, starts = perf_counter(), dict[tuple[str, int], float]()
    for case in CASES:
        if chosen and not {case.name, case.key} & set(chosen):
            continue
        cost = case.measured(starts)
        known[case.key] = {name: round(value, 2) for name, value in asdict(cost).items()}
        rows = _rows(known)
        _write(known, rows)
        print(f"{case.key}: {cost.seconds - cost.start:.2f} s, {cost.megabytes:.0f} MB", flush=True)
        if not case.kept(cost):
            passed.append(case.key)
    table = number_table("Much data, one process each", *HEADS)
    for row in rows:
        table.add_row(*row)
    Console(width=100).print(table)
    print(f"{(perf_counter() - began) / 60:.1f} min")
    if passed:
        raise SystemExit(f"over the limit: {', '.join(passed)}")


def _rows(known: Mapping[str, Mapping[str, float]]) -> list[tuple[str, ...]]:
    return [case.cells(Cost(**known[case.key])) for case in CASES if case.key in known]


def _write(known: Mapping[str, Mapping[str, float]], rows: Sequence[tuple[str, ...]]) -> None:
    """What is known so far: a run that is stopped loses nothing."""
    kept = {case.key: known[case.key] for case in CASES if case.key in known}
    FIGURES.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(_page(rows), encoding="utf-8")
    draw(kept)


def draw(known: Mapping[str, Mapping[str, float]]) -> None:
    """How time and memory of whole commands grow with the rows."""
    figure = Figure(figsize=(8, 3.4), layout="constrained")
    panels = dict(zip(("seconds", "megabytes"), figure.subplots(1, 2), strict=True))
    for name, colour in GROWTH.items():
        found = [(c.rows, known[c.key]) for c in CASES if c.name == name and c.key in known]
        if not found:
            continue
        for what, axes in panels.items():
            points = [(rows, cost[what]) for rows, cost in found]
            axes.loglog(*zip(*points, strict=True), "o-", color=colour, label=name)
    ticks = {"time, s": (1, 3, 10, 30, 100), "memory, MB": (300, 1000, 3000, 10000)}
    for axes, (title, values) in zip(panels.values(), ticks.items(), strict=True):
        axes.set_xlabel("rows")
        axes.set_title(title, fontsize=10)
        axes.set_yticks(values, [f"{value:,}" for value in values])
        axes.set_ylim(0.8 * values[0], values[-1])
        axes.minorticks_off()
        axes.grid(visible=True, alpha=0.3)
    panels["seconds"].legend(fontsize=8)
    with rc_context({"svg.hashsalt": "rows"}):
        figure.savefig(PICTURE, metadata={"Date": None})


def _page(rows: Sequence[tuple[str, ...]]) -> str:
    lines = [
        "# Much data",
        "",
        "Written by `benchmarks/bench_large.py`: simulated data in files, whole commands, each in",
        "a process of its own. Seconds are processor time, user and system: *start* is what the",
        "same command takes for a few rows, *rows* what the others add, to which the limit",
        "applies. Peak memory is that of the whole process.",
        f"Python {platform.python_version()}, {os.cpu_count()} cores, "
        f"load {os.getloadavg()[0]:.1f} (what shares a core with others takes more of it).",
        "",
        f"| {' | '.join(HEADS)} |",
        f"|---|{'--:|' * (len(HEADS) - 2)}---|",
        *(f"| {' | '.join(row)} |" for row in rows),
    ]
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main(sys.argv[1:])
