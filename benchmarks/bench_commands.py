"""What a person waits for: whole commands from the shell, beside the bare imports.

Each command several times, in turns, and each beside imports of the same second: a computer that
slows down slows down both. See ``limits.py``.
"""

from __future__ import annotations

import tempfile

import numpy as np
from limits import IMPORTS, processor_time, record, times, until_printed

JOB = "data/suta/calibration.yaml"
POSES = "data/poses"
ROUNDS = 3
PAIRS = 9
BESIDE_IMPORTS = {
    "calibrate": ("calibrate", JOB, "--out", "{out}", "--no-report"),
    "observe": ("observe", JOB),
    "validate": ("validate", "urdf/suta.urdf", JOB),
    "pivot": ("pivot", f"{POSES}/pivot.csv"),
    "hand-eye": ("hand-eye", f"{POSES}/hand_eye.csv"),
    "register": ("register", f"{POSES}/register_a.csv", f"{POSES}/register_b.csv"),
}
IN_SECONDS = {
    "help": ("--help",),
    "outliers": ("outliers", JOB, "--out", "{out}"),
    "budget": ("budget", JOB, "--out", "{out}"),
    "plan": ("plan", JOB, "-n", "4", "--out", "{out}"),
    "tip-map": ("tip-map", JOB, "--out", "{out}"),
}


def beside_imports(folder: str) -> None:
    """Time each short command right after the imports, and record the ratios.

    What a report takes is what `calibrate` takes more than without one just before.
    """
    ratios: dict[str, list[tuple[float, ...]]] = {name: [] for name in BESIDE_IMPORTS}
    report: list[float] = []
    waited: list[float] = []
    for _ in range(PAIRS):
        for name, arguments in BESIDE_IMPORTS.items():
            bare, bare_waited = times(["-c", IMPORTS])
            command = ["-m", "suta_calib", *(word.format(out=folder) for word in arguments)]
            taken = processor_time(command)
            ratios[name].append((taken / bare, taken))
            if name == "calibrate":
                with_report = command[:-1]
                waited.append(until_printed(with_report) / bare_waited)
                report.append(processor_time(with_report) - taken)
    record("report", report)
    record("waited", waited)
    for name, rows in ratios.items():
        ratio, taken = np.transpose(rows)
        record(name, ratio, f"{np.median(taken):.2f} s")


def in_seconds(folder: str) -> None:
    """Time what takes seconds, in turns."""
    taken: dict[str, list[float]] = {name: [] for name in IN_SECONDS}
    for _ in range(ROUNDS):
        for name, arguments in IN_SECONDS.items():
            told = [each.format(out=folder) for each in arguments]
            taken[name].append(processor_time(["-m", "suta_calib", *told]))
    for name in IN_SECONDS:
        record(name, taken[name])


def main() -> None:
    """Time every command, in turns, and record the ratios and the seconds."""
    with tempfile.TemporaryDirectory() as folder:
        beside_imports(folder)
        in_seconds(folder)


if __name__ == "__main__":
    main()
