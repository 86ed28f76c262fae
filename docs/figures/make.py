"""The picture of the README and of the site's first page: `python docs/figures/make.py`.

Calibrates the measured UR5 of `examples/ur5_laser_tracker`, and draws how far it is from where its
model says on poses that were not fitted.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")

from matplotlib import pyplot as plt

from suta_calib import CalibrationJob
from suta_calib.geometry import register_points, rotation_from_vector
from suta_calib.units import mm

FOLDER = Path(__file__).resolve().parent
JOB = FOLDER.parents[1] / "examples" / "ur5_laser_tracker" / "calibration.yaml"
# Arrows are that many times as long as the errors they show.
MAGNIFIED = 100
BEFORE, AFTER = "#d1661f", "#1f5fa8"


def main() -> None:
    """Draw it."""
    job = CalibrationJob.load(JOB)
    result = job.run()
    _, grid = (term.poses.samples for term in job.validation)
    seen = grid.position
    assert seen is not None
    # As delivered, with the instrument where it fits best.
    _, position = job.arm.forward(grid.q)
    turned, moved = register_points(position, seen)
    nominal = position @ turned.T + moved - seen
    values = result.solution.values
    _, position = job.arm.forward(grid.q, values)
    x, y, z, *turn = (values[f"base.{k}"] for k in ("x", "y", "z", "rx", "ry", "rz"))
    calibrated = position @ rotation_from_vector(turn).T + np.array([x, y, z]) - seen

    figure, (above, share) = plt.subplots(1, 2, figsize=(7.8, 4.0), layout="constrained")
    # One arrow in four, so that single ones can be followed.
    some = np.arange(0, len(seen), 4)
    ends = [seen[some, :2] + MAGNIFIED * error[some, :2] for error in (nominal, calibrated)]
    corners = np.vstack([seen[some, :2], *ends])
    above.set(
        xlim=(corners[:, 0].min() - 0.03, corners[:, 0].max() + 0.03),
        ylim=(corners[:, 1].min() - 0.03, corners[:, 1].max() + 0.03),
    )
    for error, colour, label in (
        (nominal, BEFORE, "as delivered"),
        (calibrated, AFTER, "calibrated"),
    ):
        arrows = {"angles": "xy", "scale_units": "xy", "scale": 1 / MAGNIFIED, "width": 0.005}
        above.quiver(*seen[some, :2].T, *error[some, :2].T, color=colour, label=label, **arrows)
    above.legend(loc="lower left", fontsize=9)
    above.set(aspect="equal", xlabel="x, m", ylabel="y, m")
    above.set_title(f"Errors from above, magnified {MAGNIFIED} times")
    for error, colour, label, side in (
        (calibrated, AFTER, "calibrated", "right"),
        (nominal, BEFORE, "as delivered", "left"),
    ):
        sizes = np.sort(mm(np.linalg.norm(error, axis=1)))
        rms = float(np.sqrt(np.mean(sizes**2)))
        share.plot(sizes, 100 * np.arange(1, len(sizes) + 1) / len(sizes), color=colour)
        beside = float(np.median(sizes)) * (0.75 if side == "right" else 1.6)
        share.text(beside, 50, f"{label}\n{rms:.2f} mm RMS", color=colour, ha=side, va="center")
    share.set(xscale="log", xlim=(0.01, 12), xlabel="error, mm", ylabel="share of poses, %")
    share.xaxis.set_major_formatter("{x:g}")
    share.set_title(f"{len(seen)} poses of a measured UR5, never fitted")
    share.grid(alpha=0.3)
    figure.savefig(FOLDER / "ur5.png", dpi=140)


if __name__ == "__main__":
    main()
