"""What the true arm gives on the simulated SUTA's held-out samples: nobody can do better."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from suta_calib import CalibrationJob, Metrics, Problem
from suta_calib.units import from_deg, from_mm, mm

FOLDER = Path(__file__).parents[1] / "data" / "suta"


def main() -> None:
    """Print the held-out distance errors with the true geometry."""
    job = CalibrationJob.load(FOLDER / "calibration_full.yaml")
    listed = yaml.safe_load((FOLDER / "truth.yaml").read_text(encoding="utf-8"))["parameters"]
    truth = {
        name: from_mm(entry["value_mm"]) if "value_mm" in entry else from_deg(entry["value_deg"])
        for name, entry in listed.items()
    }
    problem = Problem(job.validation, job.arm.select("geometric", "*.offset"))
    line = problem.linearise(problem.start(truth), [1.0])[0]
    found = Metrics.of(np.abs(line.residual[:, 0]))
    print(f"true arm, held-out distances: RMS {mm(found.rms):.3f} mm of {found.count}")


if __name__ == "__main__":
    main()
