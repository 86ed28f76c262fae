"""How well the measured Panda returns to one point, at places of the sockets that were not fitted.

Run after `suta-calib calibrate examples/panda_sockets/calibration.yaml`: it takes the arm from the
URDF that was written there, and nothing else.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from suta_calib import ArmModel, CalibrationJob
from suta_calib.units import mm

FOLDER = Path(__file__).parent
# Mean deviations before and after (arXiv:2503.12584).
PUBLISHED_MM = 7.79, 0.347


def mean_deviation(arm: ArmModel, job: CalibrationJob) -> float:
    """Mean distance of the ball from its mean over all postures in one socket, m."""
    found = []
    for term in job.validation:
        samples = term.poses.samples
        _, position = arm.forward(samples.q)
        places = zip(samples.labels["placement"], samples.labels["landmark"], strict=True)
        sockets = np.array([f"{place}/{socket}" for place, socket in places])
        for socket in np.unique(sockets):
            balls = position[sockets == socket]
            found.append(np.linalg.norm(balls - balls.mean(axis=0), axis=1))
    return float(np.mean(np.concatenate(found)))


def main() -> int:
    """Print both figures; 2 where nothing has been calibrated yet."""
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
    before, after = (mm(mean_deviation(arm, job)) for arm in (job.arm, calibrated))
    print("A measured Panda, seven places it never saw: mean deviation from each socket's mean, mm")
    print(f"as delivered {before:.2f}, calibrated {after:.3f}")
    print("published:   {:.2f},            {:.3f}".format(*PUBLISHED_MM))
    return 0


if __name__ == "__main__":
    sys.exit(main())
