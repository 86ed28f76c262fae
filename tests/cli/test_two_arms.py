"""From one arm's tool to a finger of the other that mimics another finger: every command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli_job import Capture, cli
from simulated import random_readings
from two_arms import ROBOT

from suta_calib.model.arm import ArmModel
from suta_calib.tracking.uncertainty import read_uncertainty

ARM = "arm: {urdf: robot.urdf, tip: f3, base: left}\n"
NOISE = 5e-5
SIMULATION = """\
errors:
  - {select: ["*.offset"], std_deg: 0.5, std_mm: 0.5}
  - {select: [geometric], std_mm: 1}
  - {select: [left_1.gain], value: 0.01}
sets:
  fitted: {kind: tracked_point, samples: 80, noise: {instrument_mm: 0.05}}
  held: {kind: tracked_point, samples: 40, noise: {instrument_mm: 0.05}}
"""
JOB = """\
parameters: [{select: [geometric, "*.offset", left_1.gain]}]
observations: [{kind: tracked_point, samples: fitted/*.csv}]
validation: [{kind: tracked_point, samples: held/*.csv}]
"""


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("two_arms")
    (folder / "robot.urdf").write_text(ROBOT)
    (folder / "simulation.yaml").write_text(ARM + SIMULATION)
    (folder / "calibration.yaml").write_text(ARM + JOB)
    assert cli("simulate", folder / "simulation.yaml", "--out", folder) == 0
    assert cli("calibrate", folder / "calibration.yaml") == 0
    return folder / "calibration.yaml"


def test_held_out_errors_are_the_noise(job: Path) -> None:
    result = json.loads((job.parent / "results" / "result.json").read_text())
    held_out = result["metrics"]["validation"]["after"]["rms_mm"]
    # 120 numbers scatter their root mean square by 6 %; what the parameters are unsure of adds 10.
    assert held_out == pytest.approx(1e3 * NOISE * np.sqrt(3), rel=0.3)
    gain = result["parameters"]["left_1.gain"]
    assert gain["value"] == pytest.approx(0.01, abs=4 * gain["std"])
    assert list(result["external_poses"]) == ["base"]


def test_the_written_urdf_and_the_result_are_the_arm_that_was_found(
    job: Path, capsys: Capture
) -> None:
    results = job.parent / "results"
    metrics = json.loads((results / "result.json").read_text())["metrics"]["validation"]["after"]
    with_result = ("--result", results / "result.json", "--json")
    assert cli("validate", results / "calibrated.urdf", job, *with_result) == 0
    after = json.loads(capsys.readouterr().out)["metrics"]["validation"]["after"]
    assert after["rms_mm"] == pytest.approx(metrics["rms_mm"], rel=1e-6)


def test_the_tip_of_the_written_urdf_is_as_sure_as_the_calibration_was(job: Path) -> None:
    """Errors of a joint that is climbed, and of one that mimics, as errors of its new origin."""
    results = job.parent / "results"
    nominal = ArmModel.from_urdf(job.parent / "robot.urdf", "f3", "left")
    written = ArmModel.from_urdf(results / "calibrated.urdf", "f3", "left")
    known = read_uncertainty(results / "result.json", written)
    q = random_readings(nominal, np.random.default_rng(0), 1)[0]
    names, factor = known.folded(written)
    theta = [known.beside_geometry.get(n, written.offered[n].nominal) for n in names]
    by_written = np.array(written.function(names)(theta, q)[2]).T @ factor
    held = nominal.at(known.values)
    at = [known.values[n] for n in known.names]
    by_nominal = np.array(held.function(known.names)(at, q)[2]).T
    covariance = by_nominal @ known.covariance @ by_nominal.T
    np.testing.assert_allclose(by_written @ by_written.T, covariance, rtol=1e-5, atol=1e-15)
