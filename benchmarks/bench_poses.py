"""Hand-eye and pivot calibration beside OpenCV and scikit-surgerycalibration, in one run.

Simulated poses with known truth, the same for everybody: accuracy (median error), failures and
time. Noise is 0.3 mm and 0.1° per axis (scikit-surgerycalibration's own tests run on one recorded
set and state none). The nature of the outliers changes from trial to trial: poses that are
anything, slips of 5 to 30 mm, swapped rows. Writes benchmarks/results/poses.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, get_args

import numpy as np
from pose_peers import hand_eye_peers, pivot_peers
from rich.console import Console
from tables import number_table

from suta_calib import FixedPoint, HandEye, calibrate_hand_eye, calibrate_pivot
from suta_calib.arrays import FloatArray
from suta_calib.geometry import vector_from_rotation
from suta_calib.terms import EXACT, OutlierKind, OutlierModel, PoseNoise, Poses, Simulated
from suta_calib.units import deg, from_deg, from_mm, mm, ms

RESULTS = Path(__file__).parent / "results" / "poses.md"
NOISE = PoseNoise(from_mm(0.3), from_deg(0.1))
NATURES = get_args(OutlierKind)
# A median of 40 trials scatters by 15 %, as much as methods differ where there are no outliers: the
# scene in which they are compared most closely gets more.
TRIALS = 24
MANY_TRIALS = 120
SHARES = (0.0, 0.2, 0.3)
PIVOT_POSES = 200
PIVOT_TURNS = (45, 90)
# Errors beyond which an answer is a failure: degrees and mm of X, mm of a tip.
FAILED_HAND_EYE = np.array([1.0, 5.0])
FAILED_PIVOT = np.array([1.0])
# Nobody can do better than this, and nobody knows them.
KNOWN = "ours, least squares, outliers known"
# Error of exact data beyond which a peer was called by the wrong convention.
EXACTLY = 1e-3

Answer = Callable[[Simulated[Any]], FloatArray]


@dataclass(frozen=True)
class Scene:
    """One heading of a table: a name, how to simulate trial k, what is a failure, how many."""

    name: str
    make: Callable[[int], Simulated[Any]]
    failed: FloatArray
    trials: int = TRIALS


@dataclass(frozen=True)
class Row:
    """One method in one scene: median errors, failures, median time in ms."""

    scene: str
    method: str
    error: FloatArray
    failures: str
    milliseconds: float


def hand_eye_scenes() -> list[Scene]:
    """Both noisy with more and more outliers; then one of them exact."""

    def scene(count: int, share: float, hand: PoseNoise, eye: PoseNoise, whose: str) -> Scene:
        def make(trial: int) -> Simulated[HandEye]:
            gross = OutlierModel(share, NATURES[trial % 3])
            return HandEye.simulate(count, hand=hand, eye=eye, seed=trial, gross=gross)

        name = f"{count} poses, {share:.0%} outliers, noise on {whose}"
        close = count == 100 and share == 0.0 and hand == eye
        return Scene(name, make, FAILED_HAND_EYE, MANY_TRIALS if close else TRIALS)

    scenes = [scene(n, s, NOISE, NOISE, "hand and eye") for n in (30, 100) for s in SHARES]
    scenes.append(scene(100, 0.0, NOISE, EXACT, "the hand alone"))
    scenes.append(scene(100, 0.0, EXACT, NOISE, "the eye alone"))
    return scenes


def pivot_scenes() -> list[Scene]:
    """A tip 152 mm away, turned to every side by as much as is said."""

    def scene(degrees: int, share: float) -> Scene:
        def make(trial: int) -> Simulated[FixedPoint]:
            gross, turn = OutlierModel(share, NATURES[trial % 3]), from_deg(degrees)
            return FixedPoint.simulate(
                PIVOT_POSES, spread=NOISE, seed=trial, turn=turn, gross=gross
            )

        name = f"{PIVOT_POSES} poses, turns up to {degrees}°, {share:.0%} outliers"
        return Scene(name, make, FAILED_PIVOT)

    return [scene(degrees, share) for degrees in PIVOT_TURNS for share in SHARES]


def hand_eye_answers() -> tuple[dict[str, Answer], str]:
    """Errors of X by method: degrees and mm."""

    def error(data: Simulated[HandEye], R: FloatArray, p: FloatArray) -> FloatArray:
        R_true, p_true = data.true_pose("hand_eye")
        turn = deg(np.linalg.norm(vector_from_rotation(R_true.T @ R)))
        return np.array([turn, mm(np.linalg.norm(p - p_true))])

    def ours(data: Simulated[HandEye], rows: Sequence[int] | None = None) -> FloatArray:
        rows = np.arange(len(data.term.poses)) if rows is None else rows
        robust = len(rows) == len(data.term.poses)
        X = calibrate_hand_eye(_rows(data.poses, rows), _rows(data.seen, rows), robust=robust).X
        return error(data, X[:3, :3], X[:3, 3])

    peers, version = hand_eye_peers()
    answers: dict[str, Answer] = {
        "ours": ours,
        KNOWN: lambda data: ours(data, data.inliers),
    }
    for name, solve in peers.items():
        answers[name] = lambda data, solve=solve: error(data, *solve(data.poses, data.seen))
        assert (answers[name](HandEye.simulate(10)) < EXACTLY).all(), f"{name}: convention"
    return answers, version


def pivot_answers() -> tuple[dict[str, Answer], str]:
    """Errors of the tip by method: mm."""

    def error(data: Simulated[FixedPoint], tip: FloatArray) -> FloatArray:
        return np.array([mm(np.linalg.norm(tip - data.true_point("tip")))])

    def known(data: Simulated[FixedPoint]) -> FloatArray:
        return error(data, calibrate_pivot(*_rows(data.poses, data.inliers), robust=False).tip)

    peers, version = pivot_peers()
    answers: dict[str, Answer] = {
        "ours": lambda data: error(data, calibrate_pivot(*data.poses).tip),
        KNOWN: known,
    }
    for name, solve in peers.items():
        answers[name] = lambda data, solve=solve: error(data, solve(data.poses))
        assert (answers[name](FixedPoint.simulate(20)) < EXACTLY).all(), f"{name}: convention"
    return answers, version


def _rows(poses: Poses, rows: Sequence[int]) -> Poses:
    return poses[0][rows], poses[1][rows]


def measure(scene: Scene, answers: dict[str, Answer]) -> list[Row]:
    """Every method on the same trials."""
    trials = [scene.make(k) for k in range(scene.trials)]
    rows = []
    for method, answer in answers.items():
        if method == KNOWN and not trials[0].outliers:
            continue
        errors, times = [], []
        for data in trials:
            began = perf_counter()
            errors.append(_attempt(answer, data, len(scene.failed)))
            times.append(perf_counter() - began)
        failures = int(np.sum(np.any(~(np.array(errors) <= scene.failed), axis=1)))
        median = np.median(np.nan_to_num(errors, nan=np.inf), axis=0)
        failed, milliseconds = f"{failures} of {len(trials)}", ms(float(np.median(times)))
        rows.append(Row(scene.name, method, median, failed, milliseconds))
    return rows


def _attempt(answer: Answer, data: Simulated[Any], size: int) -> FloatArray:
    """The error, or infinite where a method gives up: that is a result too."""
    try:
        return answer(data)
    except Exception:  # noqa: BLE001 (peers raise what they like)
        return np.full(size, np.inf)


def report(title: str, units: Sequence[str], rows: list[Row]) -> str:
    """Print a table; the same as Markdown."""
    heads = ["method", *(f"median error, {u}" for u in units), "failures", "ms"]
    lines = [f"## {title}", ""]
    for name in dict.fromkeys(row.scene for row in rows):
        table = number_table(name, *heads)
        lines += [
            f"### {name}",
            "",
            f"| {' | '.join(heads)} |",
            "|---" + "|--:" * (len(heads) - 1) + "|",
        ]
        for row in (r for r in rows if r.scene == name):
            cells = [row.method, *(f"{e:.3f}" for e in row.error)]
            cells += [row.failures, f"{row.milliseconds:.1f}"]
            table.add_row(*cells)
            lines.append(f"| {' | '.join(cells)} |")
        lines.append("")
        Console(width=100).print(table)
    return "\n".join(lines)


def main() -> None:
    """Print the tables and write them down."""
    parts = ["# Hand-eye and pivot calibration: accuracy, failures, time", "", *_preface(), ""]
    for title, units, scenes, (answers, version) in (
        ("Hand-eye", ("°", "mm"), hand_eye_scenes(), hand_eye_answers()),
        ("Pivot", ("mm",), pivot_scenes(), pivot_answers()),
    ):
        print(f"{title}: {version}")
        rows = [row for scene in scenes for row in measure(scene, answers)]
        parts.append(report(f"{title} ({version})", units, rows))
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text("\n".join(parts), encoding="utf-8")
    print(f"tables: benchmarks/results/{RESULTS.name}")


def _preface() -> list[str]:
    return [
        "Written by `benchmarks/bench_poses.py` (`make bench`). Simulated poses, the same for",
        "everybody, seeds from 0 on, one thread. Noise 0.3 mm and 0.1° per axis. Outliers: poses",
        "that are anything, slips of 5 to 30 mm, swapped rows, by turns. A failure is more than 1°",
        "or 5 mm (hand-eye), 1 mm (tip), or no answer. 'Outliers known' is least squares over the",
        f"inliers alone, which nobody can know. Medians of {TRIALS} trials scatter by 20 %: less",
        f"says nothing, and 100 poses without outliers got {MANY_TRIALS} trials.",
    ]


if __name__ == "__main__":
    main()
