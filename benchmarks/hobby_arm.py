"""How good a hobby arm's tip and cameras are, and how long its six commands take: simulated.

    python benchmarks/hobby_arm.py                        # seventeen arms with 1.5° of play
    python benchmarks/hobby_arm.py --play 1 1.5 2 --arms 10 --keep arms.jsonl
    python benchmarks/hobby_arm.py --commands             # processor seconds of each command

The protocol is that of docs/tutorials/hobby_arm.md: thirty touches, sixty pictures by each camera,
lenses that are found from them. `tests/support/servo_desk.py` has the desk.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from servo_desk import BESIDE, ServoDesk, camera_in  # noqa: E402

from suta_calib import SolverOptions, solve  # noqa: E402
from suta_calib.job import CalibrationJob  # noqa: E402

WHAT: Final = {
    "tip_mm": "tip",
    "wrist_mm": "place of the camera on the hand",
    "front_mm": "place of the camera beside the arm",
}


def arm(play: float, seed: int) -> dict[str, Any]:
    """Errors of one arm, mm, and those of the camera beside it in standard deviations."""
    with TemporaryDirectory() as folder:
        desk = ServoDesk.made(Path(folder) / "job", seed, zero_deg=1.5, play_deg=play)
        problem = CalibrationJob.load(desk.job).problem()
        began = time.perf_counter()
        solution = solve(problem, SolverOptions(starts=2, confirm=False))
        seconds = time.perf_counter() - began
        errors = desk.errors(solution)
    off = camera_in(solution, "front")[:3, 3] - BESIDE[:3, 3]
    stds = [solution.estimates[f"hand_eye[front].{axis}"].std for axis in "xyz"]
    deviations = (off / np.array(stds, dtype=float)).tolist()
    return {"play": play, "seed": seed, **errors, "deviations": deviations, "seconds": seconds}


def table(arms: list[dict[str, Any]]) -> Iterator[str]:
    """Lines of Markdown."""
    yield "| play, deg | arms | what | RMS, mm | worst arm, mm |"
    yield "|--:|--:|---|--:|--:|"
    for play in sorted({one["play"] for one in arms}):
        some = [one for one in arms if one["play"] == play]
        for key, name in WHAT.items():
            of_arms = np.array([one[key] for one in some])
            rms, worst = np.sqrt(np.mean(of_arms**2)), of_arms.max()
            yield f"| {play:g} | {len(some)} | {name} | {rms:.2f} | {worst:.2f} |"
        off = np.abs([one["deviations"] for one in some])
        yield (
            f"| {play:g} | {len(some)} | camera beside the arm: coordinates within ±, within 2 ± | "
            f"{np.mean(off < 1):.0%} | {np.mean(off < 2):.0%} |"
        )


def commands() -> Iterator[str]:
    """Processor seconds of the commands of the tutorial that compute; the rest is simulated."""
    with TemporaryDirectory() as folder:
        desk = ServoDesk.made(Path(folder) / "job", 0, zero_deg=1.5)
        # As `init` writes it.
        desk.job.write_text(desk.job.read_text().replace("starts: 2", "starts: 8"))
        job, results = str(desk.job), str(desk.job.parent / "results")
        today = Path(folder) / "today.csv"
        desk.touch("table", today, ("A1", "A5", "B3", "C1", "C5"), "2")
        for words in (
            ("calibrate", job),
            ("export", results, "--format", "urdf", "--without-offsets", "--cameras"),
            ("export", results, "--format", "ros-tf"),
            ("check", results, str(today)),
        ):
            out = ["--out", str(Path(folder) / f"{words[0]}.out")] if words[0] == "export" else []
            began = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
            subprocess.run([sys.executable, "-m", "suta_calib", *words, *out], check=True)
            took = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - began
            yield f"{words[0]}: {took:.0f} s"


def main() -> None:
    """Print the table, or the times."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--play", type=float, nargs="+", default=[1.5], help="total play, deg")
    parser.add_argument("--arms", type=int, default=17, help="arms with each play")
    parser.add_argument("--keep", type=Path, help="file of arms that are done; it is gone on with")
    parser.add_argument("--commands", action="store_true", help="how long the commands take")
    given = parser.parse_args()
    if given.commands:
        for line in commands():
            print(line, flush=True)
        return
    kept = given.keep.read_text().splitlines() if given.keep and given.keep.exists() else []
    arms = [json.loads(line) for line in kept]
    done = {(one["play"], one["seed"]) for one in arms}
    for play in given.play:
        for seed in range(given.arms):
            if (play, seed) in done:
                continue
            arms.append(arm(play, seed))
            if given.keep:
                with given.keep.open("a") as stream:
                    stream.write(json.dumps(arms[-1]) + "\n")
    print("\n".join(table(arms)))


if __name__ == "__main__":
    main()
