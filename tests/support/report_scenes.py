"""A calibration to report on."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console, RenderableType

from suta_calib.job.calibration import Calibration, CalibrationJob
from suta_calib.model.arm import ArmModel
from suta_calib.trust.accuracy import Accuracy

TRUTH = {"joint_4.offset": 0.02, "joint_4.z": 0.5730, "tip.z": 0.0015}
NOISE = 2e-4
# A label no file name, page, plot or terminal may take for anything but text.
AWKWARD = "<b>&'$x$[red]"
JOB = """\
arm: {{urdf: {urdf}, tip: tip}}   # <script>alert(1)</script>
parameters:
  - {{select: ["joint_*.offset"], bound_deg: 15}}
  - {{select: [joint_4.z, tip.y, tip.z], bound_mm: 30}}
  - {{select: [joint_6.z], prior_mm: 0.001}}
  - {{select: [joint_5.z], fixed: true}}
observations:
  - {{kind: tracked_point, samples: calibration.csv, sigma_mm: 0.2, label: "{label}"}}
  - {{kind: fixed_point, samples: fixed.csv}}
validation:
  - {{kind: tracked_point, samples: validation.csv, label: "{label}"}}
solver: {{starts: 2, seed: 0, max_iterations: {iterations}}}
"""


def write_csv(path: Path, header: list[str], rows: list[list[object]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([header, *rows])


def tracked_samples(arm: ArmModel, path: Path, count: int, seed: int) -> None:
    """Simulated: random readings, seen by an instrument that stands elsewhere and looks turned."""
    random = np.random.default_rng(seed)
    q = random.uniform(-1.2, 1.2, (count, len(arm.joints)))
    _, position = arm.forward(q, TRUTH)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    seen = position @ turn.T + [0.3, -0.2, 0.1] + random.normal(0, NOISE, position.shape)
    rows = [[*r, *s] for r, s in zip(q.tolist(), seen.tolist(), strict=True)]
    write_csv(path, [*arm.joints, "x", "y", "z"], rows)


def fixed_samples(arm: ArmModel, path: Path) -> None:
    """Simulated: the same reading again and again with encoder noise, at two points."""
    random = np.random.default_rng(9)
    rows: list[list[object]] = []
    for point in (AWKWARD, "F2"):
        q = random.uniform(-1, 1, len(arm.joints))
        for _ in range(6):
            rows.append([*(q + random.normal(0, 1e-4, len(q))).tolist(), point])
    write_csv(path, [*arm.joints, "point"], rows)


def make_job(folder: Path, urdf: Path, iterations: int = 200) -> CalibrationJob:
    arm = ArmModel.from_urdf(urdf, "tip")
    tracked_samples(arm, folder / "calibration.csv", 40, 1)
    tracked_samples(arm, folder / "validation.csv", 15, 2)
    fixed_samples(arm, folder / "fixed.csv")
    job = folder / "calibration.yaml"
    text = JOB.format(urdf=urdf, label="rig", iterations=iterations)
    job.write_text(text, encoding="utf-8")
    return CalibrationJob.load(job)


def console_text(shown: RenderableType) -> str:
    console = Console(width=100, file=io.StringIO(), color_system=None)
    console.print(shown)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def with_accuracy(result: Calibration, accuracy: Accuracy) -> Calibration:
    """The same, of which nothing is computed yet but these errors."""
    examined = replace(result.examined)
    # Where a cached property keeps its value.
    vars(examined)["accuracy"] = accuracy
    return replace(result, examined=examined)
