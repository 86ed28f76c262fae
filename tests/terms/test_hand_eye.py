"""Arm and camera in one job: from a simulation's file to joint offsets, lengths and the camera."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cli_job import cli

from suta_calib.geometry.numbers import rotation_from_rpy, rotation_from_vector
from suta_calib.job.calibration import CalibrationJob
from suta_calib.simulation import read_simulation, simulate
from suta_calib.trust.accuracy import Metrics

EYE = ((20.0, -30.0, 40.0), (5.0, 10.0, 90.0))
TARGET = ((500.0, 0.0, 100.0), (0.0, 20.0, 0.0))
SIMULATION = """
arm: {{urdf: {urdf}, tip: tip}}
errors:
  - {{select: ["*.offset"], std_deg: 0.75}}
  - {{select: [joint_4.z, joint_6.z], std_mm: 2}}
  - {{select: [joint_1.offset, joint_6.offset], value_deg: 0}}
noise: {{instrument_mm: {mm}, instrument_deg: {deg}}}
sets:
  calibration: &camera
    kind: hand_eye
    samples: 40
    eye_in_tip: {{position_mm: {eye[0]}, rotation_rpy_deg: {eye[1]}}}
    target_in_base: {{position_mm: {target[0]}, rotation_rpy_deg: {target[1]}}}
  validation: *camera
  touches: {{kind: fixed_point, points: {{F1: {{position_mm: [400, 0, 100]}}}}, directions: 25}}
"""
JOB = """
arm: {{urdf: {urdf}, tip: tip}}
parameters:
  - {{select: ["joint_[2-5].offset"], bound_deg: 15}}
  - {{select: [joint_4.z, joint_6.z], bound_mm: 30}}
observations:
  - {{kind: hand_eye, samples: 'calibration/*.csv', huber_mm: 2, huber_deg: 0.5}}
validation:
  - {{kind: hand_eye, samples: 'validation/*.csv'}}
"""
TOUCHES = "  - {kind: fixed_point, samples: 'touches/*.csv', huber_mm: 2}\nvalidation:"


def folder(path: Path, urdf: Path, mm: float = 0.0, deg: float = 0.0) -> Path:
    path.mkdir(exist_ok=True)
    eye, target = ([list(part) for part in pose] for pose in (EYE, TARGET))
    text = SIMULATION.format(urdf=urdf, mm=mm, deg=deg, eye=eye, target=target)
    (path / "simulation.yaml").write_text(text)
    (path / "calibration.yaml").write_text(JOB.format(urdf=urdf))
    assert cli("simulate", path / "simulation.yaml", "--out", path) == 0
    return path / "calibration.yaml"


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Path:
    return folder(tmp_path_factory.mktemp("hand_eye") / "exact", suta_urdf).parent


@pytest.fixture
def exact(simulated: Path, tmp_path: Path) -> Path:
    """A copy that the test may change."""
    return Path(shutil.copytree(simulated, tmp_path / "exact")) / "calibration.yaml"


def truth(job: Path) -> dict[str, float]:
    return simulate(read_simulation(job.parent / "simulation.yaml")).values


def camera_of(values: dict[str, float], label: str) -> tuple[np.ndarray, np.ndarray]:
    x = np.array([values[f"{label}.{key}"] for key in ("x", "y", "z", "rx", "ry", "rz")])
    return rotation_from_vector(x[3:]), x[:3]


def test_the_camera_sees_the_target_where_the_true_arm_holds_it(exact: Path) -> None:
    samples = CalibrationJob.load(exact).observations[0].poses.samples
    arm = CalibrationJob.load(exact).arm
    R, p = arm.forward(samples.q, truth(exact))
    eye_R, eye_p = rotation_from_rpy(np.radians(EYE[1])), np.array(EYE[0]) * 1e-3
    assert samples.position is not None
    assert samples.rotation is not None
    seen = np.einsum("nij,nj->ni", R @ eye_R, samples.position) + R @ eye_p + p
    np.testing.assert_allclose(seen, np.tile(np.array(TARGET[0]) * 1e-3, (len(R), 1)), atol=1e-9)
    turned = R @ eye_R @ samples.rotation
    expected = np.tile(rotation_from_rpy(np.radians(TARGET[1])), (len(R), 1, 1))
    np.testing.assert_allclose(turned, expected, atol=1e-9)


def test_arm_and_camera_are_found_together(exact: Path) -> None:
    solution = CalibrationJob.load(exact).run().solution
    assert solution.converged
    true = truth(exact)
    for name, estimate in solution.estimates.items():
        if name in true:
            assert estimate.state == "identified"
            assert estimate.value == pytest.approx(true[name], abs=1e-8), name
    for label, pose in (("hand_eye", EYE), ("target", TARGET)):
        R, p = camera_of(solution.values, label)
        np.testing.assert_allclose(p, np.array(pose[0]) * 1e-3, atol=1e-7)
        np.testing.assert_allclose(R, rotation_from_rpy(np.radians(pose[1])), atol=1e-7)


def test_with_noise_it_says_how_sure_it_is(tmp_path: Path, suta_urdf: Path) -> None:
    job = folder(tmp_path / "noisy", suta_urdf, mm=0.3, deg=0.1)
    job.write_text(job.read_text().replace("validation:", TOUCHES, 1))
    result = CalibrationJob.load(job).run()
    assert result.assessment.usable
    true = truth(job) | {f"hand_eye.{k}": 1e-3 * v for k, v in zip("xyz", EYE[0], strict=True)}
    told = [e for e in result.solution.estimates.values() if e.state == "identified"]
    compared = [e for e in told if e.name in true]
    assert len(compared) >= 8
    for estimate in compared:
        assert estimate.std is not None
        assert abs(estimate.value - true[estimate.name]) < 5 * estimate.std, estimate.name
    (held_out,) = result.accuracy.validation
    assert held_out.after.rms < 1e-3 < held_out.before.rms
    assert np.degrees(Metrics.of(held_out.blocks[1].after).rms) < 0.3


def test_what_the_camera_cannot_tell_of_the_tip_is_explained(
    exact: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    everything = exact.read_text().replace("joint_[2-5].offset", "joint_*.offset")
    exact.write_text(everything.replace("joint_6.z]", "joint_6.z, tip.y]"))
    capsys.readouterr()
    assert cli("observe", exact, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found["unidentified"]) == {"joint_1.offset", "joint_6.offset", "tip.y"}
    assert "camera" in json.dumps(found)


def test_a_camera_of_another_label_is_registered_anew(exact: Path) -> None:
    label = "{kind: hand_eye, label: second, samples: 'validation/*.csv'}"
    text = exact.read_text()
    exact.write_text(text.replace("{kind: hand_eye, samples: 'validation/*.csv'}", label))
    result = CalibrationJob.load(exact).run()
    assert result.accuracy.validation[0].after.rms < 1e-7
    assert result.job.validation[0].own_parameters[0].name == "hand_eye[second].x"


def test_the_camera_needs_orientations(exact: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = exact.parent / "calibration" / "samples.csv"
    file.write_text(file.read_text().replace("qw", "other", 1))
    capsys.readouterr()
    assert cli("calibrate", exact) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "samples.csv" in err
    assert "qw" in err
    assert not (exact.parent / "results").exists()
