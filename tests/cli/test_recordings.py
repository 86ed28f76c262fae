"""Joints that lag by where they came from, from a simulation to the job that `extend` makes."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_job import answer, cli, refused

SIMULATION = """\
arm: {urdf: URDF, tip: tip, gear_ratios: {joint_2: 100}}
seed: 1
errors:
  - {select: ["joint_*.offset"], std_deg: 0.5}
  - {select: [joint_5.hysteresis], value_deg: 2}
  - {select: [joint_5.hysteresis_decay], value_deg: 2}
noise: {instrument_mm: 0.1, instrument_deg: 0.02}
sets:
  calibration: {kind: tracked_point, samples: 200, orientation: true, motion: {step_ms: 100}}
  validation: {kind: tracked_point, samples: 100, orientation: true, motion: {step_ms: 100}}
"""
JOB = """\
arm: {urdf: arm.urdf, tip: tip, gear_ratios: {joint_2: 100}}
parameters:
  - {select: ["joint_*.offset"], bound_deg: 5}
observations: [{kind: tracked_point, samples: calibration/*.csv}]
validation: [{kind: tracked_point, samples: validation/*.csv}]
solver: {starts: 1}
"""
ROW = "  - {select: [joint_5.hysteresis, joint_5.hysteresis_decay], bound_deg: 5}\n"


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Path:
    """Two recordings of a moving arm whose fifth joint lags by 2°, on ways of 5°."""
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "simulation.yaml").write_text(SIMULATION.replace("URDF", str(suta_urdf)))
    assert cli("simulate", folder / "simulation.yaml", "--out", folder) == 0
    (folder / "arm.urdf").write_text(suta_urdf.read_text())
    (folder / "calibration.yaml").write_text(JOB)
    return folder / "calibration.yaml"


def test_extend_finds_the_joint_that_lags(job: Path) -> None:
    found = answer("extend", job, "--quick")
    assert {"joint_5.hysteresis", "joint_5.hysteresis_decay"} <= {*found["added"]}
    assert found["folds"][0] == "stretch 1 of the recordings"
    assert found["validation"]["chosen_rms_mm"] < 0.5 * found["validation"]["job_rms_mm"]


def test_its_size_and_its_way_are_calibrated(job: Path) -> None:
    text = job.read_text().replace("observations:", f"{ROW}observations:")
    more = job.parent / "more.yaml"
    more.write_text(text)
    found = answer("calibrate", more, "--out", job.parent / "more")
    for key, size in (("hysteresis", 2.0), ("hysteresis_decay", 5.0)):
        estimate = found["parameters"][f"joint_5.{key}"]
        assert abs(estimate["value"] - size * 0.0174533) < 4 * estimate["std"]
    ratio = found["parameters"]["joint_2.gear_ratio"]
    assert (ratio["value"], ratio["state"]) == (100.0, "fixed")
    plain = answer("calibrate", job, "--out", job.parent / "plain", code=1)
    after, before = (each["metrics"]["validation"]["after"]["rms_mm"] for each in (found, plain))
    assert after < 0.5 * before
    urdf, result = (job.parent / "more" / name for name in ("calibrated.urdf", "result.json"))
    validated = answer("validate", urdf, more, "--result", result)
    assert validated["metrics"]["validation"]["after"]["rms_mm"] == pytest.approx(after, rel=1e-3)


def test_a_gear_of_no_joint_is_refused(job: Path) -> None:
    wrong = job.parent / "wrong.yaml"
    wrong.write_text(job.read_text().replace("{joint_2: 100}", "{joint_9: 100}"))
    assert "found the joint joint_9; expected a joint of the chain that turns" in refused(
        "observe", wrong
    )
