"""How far the measured UR5 is from where its model says, on poses that were not fitted.

Run after `suta-calib calibrate examples/ur5_laser_tracker/calibration.yaml`: it takes the arm from
the URDF and the tracker's place from the result that were written there.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from suta_calib import ArmModel, CalibrationJob, Metrics, Samples
from suta_calib.arrays import FloatArray
from suta_calib.geometry import rotation_from_vector
from suta_calib.units import mm

FOLDER = Path(__file__).parent
# In the order of the job's validation.
SETS = ("20 random poses", "300 poses of the grid")
# T_tracker_base as the source had it: positions are given in the controller's base frame, which is
# ROS's base_link turned by half a turn about z.
DELIVERED = np.diag([-1.0, -1.0, 1.0]), np.zeros(3)
# On the random poses: reached without compensation, and with theirs (P. Jacobi, Tsinghua
# University 2025).
PUBLISHED_MM = {"as delivered": 2.5664, "compensated": 0.1549}

Base = tuple[FloatArray, FloatArray]


def errors(arm: ArmModel, base: Base, samples: Samples) -> Metrics:
    """Distances between where the tracker saw the reflector and where it should have been."""
    assert samples.position is not None
    _, position = arm.forward(samples.q)
    expected = position @ base[0].T + base[1]
    return Metrics.of(np.linalg.norm(expected - samples.position, axis=1))


def fitted_base(result: Path) -> Base:
    """`T_tracker_base` from a result.json."""
    parameters = json.loads(result.read_text(encoding="utf-8"))["parameters"]
    x, y, z, *turn = (parameters[f"base.{k}"]["value"] for k in ("x", "y", "z", "rx", "ry", "rz"))
    return rotation_from_vector(turn), np.array([x, y, z])


def main() -> int:
    """Print the table; 2 where nothing has been calibrated yet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path, nargs="?", default=FOLDER / "results")
    folder = parser.parse_args().results
    if not (folder / "calibrated.urdf").is_file():
        print(
            f"{folder}: no calibrated.urdf there: run suta-calib calibrate "
            f"{FOLDER}/calibration.yaml before",
            file=sys.stderr,
        )
        return 2
    job = CalibrationJob.load(FOLDER / "calibration.yaml")
    calibrated = ArmModel.from_urdf(folder / "calibrated.urdf", job.arm.tip)
    models = {
        "as delivered": (job.arm, DELIVERED),
        "calibrated": (calibrated, fitted_base(folder / "result.json")),
    }
    print(f"{'A measured UR5, poses it never saw: errors, mm':<49}    mean     RMS     max")
    for title, term in zip(SETS, job.validation, strict=True):
        for state, model in models.items():
            found = errors(*model, term.poses.samples)
            figures = "".join(f"{mm(v):8.3f}" for v in (found.mean, found.rms, found.maximum))
            print(f"{title:<24}{state:<25}{figures}")
    figures = ", ".join(f"{state} {value:.3f}" for state, value in PUBLISHED_MM.items())
    print(f"Published for the random poses, mean: {figures}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
