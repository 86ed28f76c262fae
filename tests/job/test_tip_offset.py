"""``tip_offset_mm``: a probe at the tip that the URDF does not know."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli_job import TRUTH, cli, simulated, write_simulated_job

from suta_calib.job.calibration import CalibrationJob
from suta_calib.measurements import write_samples
from suta_calib.model.arm import ArmModel

PROBE = np.array([0.03, -0.02, 0.11])


@pytest.fixture
def job(tmp_path: Path, suta_urdf: Path) -> Path:
    """A job whose instrument sees the end of a probe; the URDF ends where it is mounted."""
    path = write_simulated_job(tmp_path / "job", suta_urdf)
    arm = ArmModel.from_urdf(suta_urdf, "tip")
    tip = arm.segments[-1]
    moved = dict(zip(tip.names(*"xyz"), tip.position + tip.rotation @ PROBE, strict=True))
    for name, n, seed in (("calibration", 40, 1), ("validation", 15, 2)):
        samples = simulated(arm, n, seed, TRUTH | moved)
        write_samples(path.parent / name / "a.csv", samples)
    return path


def with_offset(job: Path, offset: str) -> Path:
    text = job.read_text().replace("tip: tip}", f"tip: tip, tip_offset_mm: {offset}}}", 1)
    job.write_text(text)
    return job


def test_it_moves_the_tip_along_its_own_axes(job: Path) -> None:
    plain = CalibrationJob.load(job).arm
    arm = CalibrationJob.load(with_offset(job, "[30, -20, 110]")).arm
    q = np.random.default_rng(0).uniform(-1, 1, (5, len(arm.joints)))
    R, p = plain.forward(q)
    turned, moved = arm.forward(q)
    np.testing.assert_allclose(turned, R, atol=1e-12)
    np.testing.assert_allclose(moved, p + R @ PROBE, atol=1e-12)


@pytest.mark.parametrize(
    ("offset", "state"),
    [
        ("[30, -20, 110]", "fixed"),
        ("{position_mm: [25, -25, 100], bound_mm: 40}", "identified"),
        ("{position_mm: [29, -19, 110], prior_mm: 2}", "identified"),
    ],
)
def test_it_is_given_or_found(
    job: Path, offset: str, state: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The calibrated URDF holds it, and is what a job without it validates."""
    folder = with_offset(job, offset).parent
    assert cli("calibrate", job, "--out", folder / "results", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["parameters"]["tip.z"]["state"] == state
    assert found["metrics"]["validation"]["after"]["rms_mm"] < 0.15
    calibrated = ArmModel.from_urdf(folder / "results" / "calibrated.urdf", "tip").segments[-1]
    nominal = ArmModel.from_urdf(folder / "arm.urdf", "tip").segments[-1]
    probe = nominal.rotation.T @ (calibrated.position - nominal.position)
    if state == "fixed":
        np.testing.assert_allclose(probe, PROBE, atol=1e-9)
    # Across the last joint's axis it goes together with that joint's offset, which is free.
    np.testing.assert_allclose(probe[1:], PROBE[1:], atol=1e-3)
    again = ("validate", folder / "results" / "calibrated.urdf", job, "--json")
    assert cli(*again) == 0
    held_out = json.loads(capsys.readouterr().out)["metrics"]["validation"]
    assert held_out["after"]["rms_mm"] == pytest.approx(
        found["metrics"]["validation"]["after"]["rms_mm"], rel=1e-3
    )


def test_a_result_knows_the_arm_it_was_made_from(job: Path) -> None:
    folder = with_offset(job, "[30, -20, 110]").parent
    assert cli("calibrate", job, "--out", folder / "results") == 0
    made = ("--urdf", folder / "arm.urdf", "--tip", "tip", "--out", folder / "map")
    region = ("--region", "200,400,-100,100,0,200", "--grid", 5)
    assert cli("tip-map", folder / "results" / "result.json", *made, *region) == 0


@pytest.mark.parametrize(
    ("offset", "message"),
    [
        ("[30, -20]", "tip_offset_mm: found"),
        ("120", "tip_offset_mm: found 120"),
        ("{position_mm: [0, 0, 1]}", "without bound_mm or prior_mm"),
        ("{position_mm: [0, 0, 1], bound: 3}", "did you mean 'bound_mm'"),
        ("{position_mm: [0, 0, 1], bound_mm: -3}", "bound_mm: found -3"),
        ("{bound_mm: 3}", "position_mm"),
    ],
)
def test_what_makes_no_sense_is_refused(
    job: Path, offset: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli("observe", with_offset(job, offset)) == 2
    error = capsys.readouterr().err
    assert message in error
    assert f"{job}:1" in error


def test_a_link_that_moves_has_no_place_for_it(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = with_offset(job, "[0, 0, 120]").read_text().replace("tip: tip,", "tip: joint_6,", 1)
    job.write_text(text)
    assert cli("observe", job) == 2
    error = capsys.readouterr().err
    assert "a tip on a fixed joint, because calibrated.urdf stores" in error
    assert "a column 'target'" in error
    assert f"{job}:1" in error
