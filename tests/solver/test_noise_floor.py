"""With noise nobody beats the true arm on held-out samples: how near does a calibration come?"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from suta_calib.job.calibration import CalibrationJob
from suta_calib.simulation import read_simulation, simulate, write_simulation
from suta_calib.solver.problem import Problem

COPIED = ("simulation.yaml", "artefact.yaml", "calibration_full.yaml")


@pytest.mark.parametrize(
    ("outliers", "within"), [pytest.param(0.0, 1.05, marks=pytest.mark.slow), (0.1, 1.10)]
)
def test_held_out_errors_are_near_those_of_the_true_arm(
    repository: Path, tmp_path: Path, outliers: float, within: float
) -> None:
    """The shipped simulation again, with another seed and a share of gross outliers."""
    folder = tmp_path / "data" / "suta"
    folder.mkdir(parents=True)
    (tmp_path / "urdf").mkdir()
    (tmp_path / "urdf" / "suta.urdf").write_bytes((repository / "urdf/suta.urdf").read_bytes())
    for name in COPIED:
        text = (repository / "data" / "suta" / name).read_text()
        (folder / name).write_text(text.replace("fraction: 0.015", f"fraction: {outliers}"))
    simulation = simulate(read_simulation(folder / "simulation.yaml"), seed=1)
    write_simulation(simulation, folder)
    job = CalibrationJob.load(folder / "calibration_full.yaml")
    reached = job.run().accuracy.validation[0].after.rms
    whole = Problem(job.validation, job.arm.select("geometric", "*.offset"))
    errors = whole.linearise(whole.start(simulation.values), [1.0])[0].residual
    floor = float(np.sqrt(np.mean(errors**2)))
    assert reached < within * floor
