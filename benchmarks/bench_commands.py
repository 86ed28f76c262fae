"""What a person waits for: whole commands from the shell, beside the bare imports.

Each command several times, in turns, so that a computer that slows down slows down everybody. See
``limits.py``.
"""

from __future__ import annotations

import tempfile

import numpy as np
from limits import IMPORTS, NEEDED_IMPORTS, processor_time, record, times

JOB = "data/suta/calibration.yaml"
POSES = "data/poses"
ROUNDS = 3
BESIDE_IMPORTS = {
    "calibrate": ("calibrate", JOB, "--out", "{out}"),
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
WITHOUT_REPORT = (*BESIDE_IMPORTS["calibrate"], "--no-report")


def main() -> None:
    """Time every command, in turns, and record the ratios and the seconds."""
    commands = {**BESIDE_IMPORTS, **IN_SECONDS, "no report": WITHOUT_REPORT}
    bare, needed = list[float](), dict[str, list[float]]()
    taken: dict[str, list[float]] = {name: [] for name in commands}
    waited, bare_waited = list[float](), list[float]()
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(ROUNDS):
            processor, elapsed = times(["-c", IMPORTS])
            bare.append(processor)
            bare_waited.append(elapsed)
            for libraries in dict.fromkeys(NEEDED_IMPORTS.values()):
                needed.setdefault(libraries, []).append(processor_time(["-c", libraries]))
            for name, arguments in commands.items():
                told = [each.format(out=folder) for each in arguments]
                processor, elapsed = times(["-m", "suta_calib", *told])
                taken[name].append(processor)
                if name == "calibrate":
                    waited.append(elapsed)
    print(f"bare imports: {', '.join(f'{each:.2f}' for each in sorted(bare))} s")
    for name in BESIDE_IMPORTS:
        floor = np.median(np.divide(needed[NEEDED_IMPORTS[name]], bare))
        peer = f"{np.median(taken[name]):.2f} s; the libraries that it needs alone {floor:.2f}"
        record(name, np.divide(taken[name], bare), peer)
    record("waited", np.divide(waited, bare_waited), f"{np.median(waited):.2f} s")
    for name in IN_SECONDS:
        record(name, taken[name])
    record("report", np.subtract(taken["calibrate"], taken["no report"]))


if __name__ == "__main__":
    main()
