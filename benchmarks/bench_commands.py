"""What a person waits for: whole commands from the shell, beside the bare imports.

`make bench` runs this; each command several times, in turns, so that a computer that slows down
slows down everybody. See ``limits.py``.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from limits import IMPORTS, processor_time, record

from suta_calib.geometry import quaternion_from_rotation, rotation_from_vector

JOB = "data/suta/calibration.yaml"
ROUNDS = 5


def pose_cells(rotation: np.ndarray, position: np.ndarray) -> str:
    """Cells x … qw of one pose."""
    return ",".join(f"{each:.9f}" for each in (*position, *quaternion_from_rotation(rotation)))


def write_scenes(folder: Path) -> None:
    """A tool that pivots, a camera on a hand, and two clouds of points; 0.1 mm of noise."""
    rng = np.random.default_rng(0)
    noise = 1e-4

    def random_rotations(count: int) -> list[np.ndarray]:
        return [rotation_from_vector(rng.normal(size=3) * 0.4) for _ in range(count)]

    tip, post = np.array([0.01, 0.02, 0.15]), np.array([0.3, 0.1, 1.2])
    rows = [
        pose_cells(R, post - R @ tip + noise * rng.normal(size=3)) for R in random_rotations(200)
    ]
    (folder / "pivot.csv").write_text("\n".join(["x,y,z,qx,qy,qz,qw", *rows]) + "\n")

    hand_eye, at = rotation_from_vector(np.array([0.1, 0.2, 1.5])), np.array([0.05, 0.0, 0.1])
    target, there = rotation_from_vector(np.array([3.0, 0.1, 0.2])), np.array([0.8, 0.1, 0.0])
    rows = []
    for R in random_rotations(60):
        position = np.array([0.4, 0.0, 0.5]) + 0.2 * rng.normal(size=3)
        eye, eye_at = R @ hand_eye, R @ at + position
        seen = eye.T @ (there - eye_at) + noise * rng.normal(size=3)
        rows.append(f"{pose_cells(R, position)},{pose_cells(eye.T @ target, seen)}")
    names = ("x", "y", "z", "qx", "qy", "qz", "qw")
    header = ",".join(f"{who}_{name}" for who in "ab" for name in names)
    (folder / "hand_eye.csv").write_text("\n".join([header, *rows]) + "\n")

    points = rng.normal(size=(30, 3)) * 0.3
    moved = points @ hand_eye.T + at + noise * rng.normal(size=points.shape)
    for name, cloud in (("a.csv", points), ("b.csv", moved)):
        np.savetxt(folder / name, cloud, delimiter=",", header="x,y,z", comments="")


def main() -> None:
    """Time every command, in turns, and record the ratios and the seconds."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write_scenes(folder)
        out = ("--out", str(folder / "results"))
        beside_imports = {
            "calibrate": ("calibrate", JOB, *out),
            "observe": ("observe", JOB),
            "validate": ("validate", "urdf/suta.urdf", JOB),
            "pivot": ("pivot", str(folder / "pivot.csv")),
            "hand-eye": ("hand-eye", str(folder / "hand_eye.csv")),
            "register": ("register", str(folder / "a.csv"), str(folder / "b.csv")),
        }
        in_seconds = {
            "help": ("--help",),
            "outliers": ("outliers", JOB),
            "budget": ("budget", JOB),
            "plan": ("plan", JOB, "-n", "4", *out),
            "tip-map": ("tip-map", JOB, *out),
        }
        commands = {**beside_imports, **in_seconds}
        bare: list[float] = []
        taken: dict[str, list[float]] = {name: [] for name in commands}
        without_report: list[float] = []
        for _ in range(ROUNDS):
            bare.append(processor_time(["-c", IMPORTS]))
            for name, arguments in commands.items():
                taken[name].append(processor_time(["-m", "suta_calib", *arguments]))
            without_report.append(
                processor_time(["-m", "suta_calib", *commands["calibrate"], "--no-report"])
            )
    print(f"bare imports: {', '.join(f'{each:.2f}' for each in sorted(bare))} s")
    for name in beside_imports:
        record(name, np.divide(taken[name], bare), f"{np.median(taken[name]):.2f} s")
    for name in in_seconds:
        record(name, taken[name])
    record("report", np.subtract(taken["calibrate"], without_report))


if __name__ == "__main__":
    main()
