"""The pictures of the tutorials: `python docs/figures/tutorials.py`.

Every tutorial about an arm ends with the errors of data that were not fitted, as delivered and
calibrated; those about poses with the residuals of their answer.
"""

from __future__ import annotations

import csv
import io
import sys
import tempfile
from contextlib import redirect_stdout
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")

from matplotlib import pyplot as plt

from suta_calib import ArmModel, TrackedPoint, calibrate, residual_map
from suta_calib.cli._app import run
from suta_calib.geometry import register_points, rotation_from_vector
from suta_calib.measurements import write_text
from suta_calib.units import mm

FOLDER = Path(__file__).resolve().parent
ROOT = FOLDER.parents[1]
BEFORE, AFTER = "#d1661f", "#1f5fa8"
# The pages' jobs: what was measured, and the job's file.
JOBS = {
    "measurement_arm": ("The simulated SUTA: distances on an artefact", "data/suta"),
    "hobby_arm": (
        "A simulated hobby arm: crosses on a printed sheet",
        "examples/so101_printed_sheet",
    ),
    "camera_on_robot": ("A simulated arm with a camera on its hand", "examples/camera_on_arm"),
}
STYLUS = "examples/stylus_polaris/track.csv"
# Those of poses: the command.
POSES = {
    "ros_hand_eye": ("hand-eye", ROOT / "examples/ros_hand_eye/samples.yaml"),
    "surgical_navigation": ("pivot", ROOT / "examples/pivot_tool/poses.csv"),
}
HEIGHTS = """\
arm: {urdf: my_arm.urdf, tip: tip}
errors:
  - {select: ["*.offset"], std_deg: 0.5}
  - {select: geometric, std_mm: 0.5, std_deg: 0.1}
noise: {instrument_mm: 0.02}
sets:
  calibration: {kind: height, samples: 80}
  validation: {kind: height, samples: 20}
"""


def main() -> None:
    """Draw them all."""
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        # First: kinds of other packages are looked for once.
        draw_heights(scratch)
        for page, (title, job) in JOBS.items():
            draw_job(page, title, ROOT / job / "calibration.yaml", scratch / page)
        draw_arrays()
        draw_residual_map()
        stylus = scratch / "stylus.csv"
        tools = "--body", "8700340", "--reference", "8700339"
        said("import", ROOT / STYLUS, *tools, "--out", stylus)
        for page, command in (*POSES.items(), ("stylus", ("pivot", stylus))):
            said(*command, "--out", scratch / page)
            picture = next((scratch / page).glob("*.svg"))
            write_text(FOLDER / f"{page}.svg", picture.read_text(encoding="utf-8"))


def said(*words: object) -> None:
    """Run a command of `suta-calib`, which must succeed."""
    with redirect_stdout(io.StringIO()):
        code = run([*map(str, words)])
    if code:
        raise SystemExit(f"{words} ended with {code}")


def draw_job(page: str, title: str, job: Path, out: Path) -> None:
    """What a job's validation data say, before and after."""
    said("calibrate", job, "--out", out)
    with (out / "residuals.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["set"].startswith("validation")]
    rows = [row for row in rows if row["unit"] == rows[0]["unit"]]
    before, after = (
        np.array([float(row[f"error_{k}"]) for row in rows]) for k in ("before", "after")
    )
    draw(page, title, before, after, rows[0]["unit"])


def draw(page: str, title: str, before: np.ndarray, after: np.ndarray, unit: str) -> None:
    """The share of data that were not fitted with at most such an error."""
    figure, axes = plt.subplots(figsize=(6.4, 3.4), layout="constrained")
    both = (
        (before, BEFORE, "as delivered", 1.15, "left"),
        (after, AFTER, "calibrated", 0.85, "right"),
    )
    for errors, colour, label, beside, side in both:
        sizes = np.sort(np.abs(errors))
        axes.plot(sizes, 100 * np.arange(1, len(sizes) + 1) / len(sizes), color=colour)
        text = f"{label}\n{np.sqrt(np.mean(sizes**2)):.2g} {unit} RMS"
        place = float(np.quantile(sizes, 0.45 if side == "left" else 0.55)) * beside
        axes.text(place, 50, text, color=colour, ha=side, va="center")
    least = max(float(np.min(np.abs(after))), float(np.max(np.abs(after))) / 30)
    axes.set(xscale="log", xlim=(least / 4, float(np.max(np.abs(before))) * 4))
    axes.set(xlabel=f"error, {unit}", ylabel="share, %")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_title(f"{title}\n{len(before)} measurements that were not fitted", fontsize=10)
    axes.grid(alpha=0.3)
    figure.savefig(FOLDER / f"{page}.png", dpi=90)
    plt.close(figure)


def draw_arrays() -> None:
    """What `docs/tutorials/arrays.md` calibrates."""
    folder = ROOT / "examples/ur5_laser_tracker"
    arm = ArmModel.from_urdf(folder / "arm.urdf", tip="reflector")
    tables = [
        np.loadtxt(folder / f"{each}/grid.csv", delimiter=",", skiprows=1)
        for each in ("calibration", "validation")
    ]
    terms = [TrackedPoint.from_arrays(arm, t[:, 3:], position=t[:, :3]) for t in tables]
    values = calibrate(arm, terms[0], validation=terms[1:]).solution.values
    q, seen = tables[1][:, 3:], tables[1][:, :3]
    # As delivered, with the instrument where it fits best.
    position = arm.forward(q)[1]
    turned, moved = register_points(position, seen)
    before = position @ turned.T + moved - seen
    x, y, z, *turn = (values[f"base.{k}"] for k in ("x", "y", "z", "rx", "ry", "rz"))
    position = arm.forward(q, values)[1]
    after = position @ rotation_from_vector(turn).T + np.array([x, y, z]) - seen
    sizes = [mm(np.linalg.norm(each, axis=1)) for each in (before, after)]
    draw("arrays", "A measured UR5 and a laser tracker", sizes[0], sizes[1], "mm")


def draw_residual_map() -> None:
    """What the calibration of the measured UR5 leaves."""
    job = ROOT / "examples/ur5_laser_tracker/calibration_eccentric.yaml"
    left = residual_map(calibrate(job))
    figure = plt.figure(figsize=(9.7, 8.4), layout="constrained")
    left.plot(figure)
    figure.savefig(FOLDER / "residual_map.png", dpi=80)


def draw_heights(scratch: Path) -> None:
    """What `docs/tutorials/own_kind.md` simulates, with the kind as `pip install` adds it."""
    package = ROOT / "examples/height_gauge"
    entry = scratch / "suta_calib_height-1.0.dist-info"
    entry.mkdir()
    (entry / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: suta-calib-height\nVersion: 1.0\n"
    )
    (entry / "entry_points.txt").write_text(
        "[suta_calib.kinds]\nheight = suta_calib_height:Height\n"
    )
    sys.path += [str(package), str(scratch)]
    (scratch / "my_arm.urdf").write_bytes((ROOT / "urdf/suta.urdf").read_bytes())
    (scratch / "simulation.yaml").write_text(HEIGHTS)
    job = scratch / "heights"
    said("init", scratch / "my_arm.urdf", "--tip", "tip", "--kind", "height", "--out", job)
    said("simulate", scratch / "simulation.yaml", "--out", job)
    title = "A simulated arm and a height gauge"
    draw_job("own_kind", title, job / "calibration.yaml", job / "results")


if __name__ == "__main__":
    main()
