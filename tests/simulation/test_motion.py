"""A simulated arm that moves while it is seen, by an instrument with a clock of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from cli_job import refused

from suta_calib import ArmModel
from suta_calib.simulation import read_simulation, simulate
from suta_calib.simulation.output import truth_text

SET = """
arm: {urdf: URDF, tip: tip}
seed: 4
sets:
  moving:
    {kind: tracked_point, samples: 120,
     motion: {step_ms: 50, speed_deg_per_s: 30, time_offset_ms: -20}}
"""


@pytest.fixture
def file(tmp_path: Path, suta_urdf: Path) -> Path:
    (tmp_path / "simulation.yaml").write_text(SET.replace("URDF", str(suta_urdf)))
    return tmp_path / "simulation.yaml"


def test_rows_are_of_a_smooth_motion_and_observations_of_another_time(
    file: Path, suta_urdf: Path
) -> None:
    simulation = simulate(read_simulation(file))
    (moving,) = simulation.files
    samples = moving.samples
    assert samples.time is not None
    np.testing.assert_allclose(np.diff(samples.time), 0.05, atol=1e-12)
    q = np.unwrap(samples.q, axis=0)
    speed = np.abs(np.diff(q, axis=0)) / 0.05
    assert speed.max() < np.radians(30.5)
    assert speed.max() > np.radians(10)
    # What was seen lies between the rows.
    arm = ArmModel.from_urdf(suta_urdf, "tip")
    late = np.stack([np.interp(samples.time - 0.02, samples.time, c) for c in q.T], axis=1)
    assert samples.position is not None
    off = np.linalg.norm(arm.forward(late)[1] - samples.position, axis=1)[1:]
    unaware = np.linalg.norm(arm.forward(q)[1] - samples.position, axis=1)[1:]
    assert off.max() < 1e-3 < 3e-3 < unaware.max()
    truth = yaml.safe_load(truth_text(simulation))
    assert truth["time_offsets"] == {"moving": {"offset_ms": -20.0}}


def test_an_arm_that_rests_has_no_times(file: Path) -> None:
    text = file.read_text()
    file.write_text(text[: text.index("motion")].rstrip().rstrip(",") + "}\n")
    simulation = simulate(read_simulation(file))
    assert simulation.files[0].samples.time is None
    assert "time_offsets" not in yaml.safe_load(truth_text(simulation))


def test_a_motion_that_cannot_be_is_refused(file: Path) -> None:
    text = file.read_text()
    file.write_text(text.replace("step_ms: 50", "step_ms: 0"))
    assert "sets.moving.motion.step_ms" in refused("simulate", file, "--out", file.parent)
    file.write_text(text.replace("step_ms: 50", "rate: 50"))
    assert "rate" in refused("simulate", file, "--out", file.parent)
