"""``couplings``: joints that a job says the readings of others move too."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli_job import TRUTH, cli, simulated, write_simulated_job

from suta_calib.job.calibration import CalibrationJob
from suta_calib.measurements import write_samples
from suta_calib.model.arm import ArmModel

NAME = "joint_3.coupling[joint_2]"
GIVEN = "{joint_3: {joint_2: -1}}"


@pytest.fixture
def job(tmp_path: Path, suta_urdf: Path) -> Path:
    """A job over an arm whose second motor drags the third joint back."""
    path = write_simulated_job(tmp_path / "job", suta_urdf)
    arm = ArmModel.from_urdf(suta_urdf, "tip")
    for name, n, seed in (("calibration", 40, 1), ("validation", 15, 2)):
        samples = simulated(arm, n, seed, TRUTH | {NAME: -0.98})
        write_samples(path.parent / name / "a.csv", samples)
    return path


def coupled(job: Path, couplings: str, *, free: bool = False) -> Path:
    text = job.read_text().replace("tip: tip}", f"tip: tip, couplings: {couplings}}}", 1)
    if free:
        row = f'  - {{select: ["{NAME}"], bound: 0.1}}\n'
        text = text.replace("parameters:\n", f"parameters:\n{row}", 1)
    job.write_text(text)
    return job


def test_it_is_nominal_and_named(job: Path) -> None:
    loaded = CalibrationJob.load(coupled(job, GIVEN))
    held = loaded.parameters[NAME]
    assert (held.nominal, held.free) == (-1.0, False)
    q = np.random.default_rng(0).uniform(-1, 1, (5, 6))
    angles = q.copy()
    angles[:, 2] -= q[:, 1]
    plain = ArmModel.from_urdf(loaded.spec.arm.urdf, "tip")
    for one, other in zip(loaded.arm.forward(q), plain.forward(angles), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)


def test_it_is_found_and_read_back(job: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The calibrated URDF does not hold it, which is said; the result does."""
    folder = coupled(job, GIVEN, free=True).parent
    assert cli("calibrate", job, "--out", folder / "results", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    row = found["parameters"][NAME]
    assert (row["nominal"], row["state"], row["unit"]) == (-1.0, "identified", "1")
    assert abs(row["value"] + 0.98) < 4 * row["std"] < 4e-3
    assert found["metrics"]["validation"]["after"]["rms_mm"] < 0.15
    assert any(f"cannot hold {NAME}" in note for note in found["verdict"]["notes"])
    urdf, result = folder / "results" / "calibrated.urdf", folder / "results" / "result.json"
    assert cli("validate", urdf, job, "--result", result, "--json") == 0
    held_out = json.loads(capsys.readouterr().out)["metrics"]["validation"]["after"]
    assert held_out["rms_mm"] == pytest.approx(
        found["metrics"]["validation"]["after"]["rms_mm"], rel=1e-3
    )


def test_one_that_is_given_is_kept_for_any_urdf_and_in_the_result(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = coupled(job, "{joint_3: {joint_2: -0.98}}").parent
    assert cli("calibrate", job, "--out", folder / "results", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["parameters"][NAME]["state"] == "fixed"
    after = found["metrics"]["validation"]["after"]["rms_mm"]
    assert after < 0.15
    urdf, result = folder / "results" / "calibrated.urdf", folder / "results" / "result.json"
    for more in ((), ("--result", result)):
        assert cli("validate", urdf, job, *more, "--json") == 0
        held_out = json.loads(capsys.readouterr().out)["metrics"]["validation"]["after"]
        assert held_out["rms_mm"] == pytest.approx(after, rel=1e-3)


@pytest.mark.parametrize(
    ("couplings", "message"),
    [
        ("[joint_3, joint_2]", "arm.couplings: found"),
        ("{joint_3: joint_2}", "arm.couplings.joint_3: found 'joint_2'"),
        ("{joint_3: {joint_2: much}}", "arm.couplings.joint_3.joint_2: found 'much'"),
        ("{elbow: {joint_2: -1}}", "arm.couplings.elbow: found no joint that can be coupled"),
        (
            "{joint_3: {joint_3: -1}}",
            "whose reading can also move joint_3; expected one of joint_1",
        ),
        ("{joint_3: {shoulder: -1}}", "arm.couplings.joint_3.shoulder: found no joint"),
    ],
)
def test_what_makes_no_sense_is_refused(
    job: Path, couplings: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli("observe", coupled(job, couplings)) == 2
    error = capsys.readouterr().err
    assert message in error
    assert f"{job}:1" in error
