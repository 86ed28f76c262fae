"""From encoders to calibrated poses without hardware: emulate, measure, calibrate, track.

The emulated arm has errors that are known. It rests on an artefact's landmarks one after the other
behind a real pseudo-terminal; the commands a laboratory would type are all that is used.
"""

from __future__ import annotations

import json
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from cli_job import cli
from simulated import SUTA_URDF

from suta_calib.arrays import FloatArray
from suta_calib.device import DeviceSpec
from suta_calib.emulation import (
    EmulatedArm,
    Emulation,
    Timing,
    artefact_set,
    device_of,
    stops,
    sweep,
)
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import NoiseLevels, PoseSpec
from suta_calib.tracking.trajectory import Trajectory, read_trajectory

# Where the arm's base is said to be is what the first joint's offset and height mean: they are
# what no artefact can tell, and here they are right.
TRUTH = {
    "joint_2.offset": 0.020,
    "joint_3.offset": -0.015,
    "joint_4.offset": 0.012,
    "joint_5.offset": -0.010,
    "joint_6.offset": 0.025,
    "joint_4.z": 0.573,
    "joint_6.z": 0.3695,
    "tip.y": -0.2515,
}
SEATING = 2e-5
# Pillars that lean differently, or no distance would tell how long the tool is.
ARTEFACT = """\
name: simulated artefact with leaning pillars
landmarks:
  O: {position_mm: [0, 0, 40], rotation_rpy_deg: [180, 0, 0]}
  A: {position_mm: [70, 20, 60], rotation_rpy_deg: [165, 10, 60]}
  B: {position_mm: [-60, 50, 30], rotation_rpy_deg: [190, -15, 20]}
  C: {position_mm: [-40, -70, 20], rotation_rpy_deg: [200, 5, -40]}
  D: {position_mm: [50, -60, 80], rotation_rpy_deg: [170, -20, 100]}
  E: {position_mm: [10, 75, 50], rotation_rpy_deg: [185, 15, -90]}
"""
JOB = """\
arm: {urdf: arm.urdf, tip: tip}
parameters:
  - {select: ["joint_*.offset"], bound_deg: 15}
  - {select: [joint_2.z, joint_4.z, joint_6.z, tip.y], bound_mm: 30}
observations:
  - {kind: pairwise_distance, artefact: artefact.yaml, samples: 'calibration/*.csv'}
solver: {starts: 2, seed: 0}
"""
PLACES = {
    "P1": (-105, [0.4375, 0.0125, 0.0]),
    "P2": (30, [0.4125, 0.0375, 0.0]),
    "P3": (-60, [0.42, -0.05, 0.05]),
    "P4": (0, [0.45, 0.06, 0.03]),
    "P5": (75, [0.43, -0.03, 0.08]),
}


@dataclass(frozen=True)
class Laboratory:
    """A job without samples, the arm it is about, and the arm as it truly is."""

    job: Path
    arm: ArmModel
    device: DeviceSpec

    @property
    def folder(self) -> Path:
        return self.job.parent

    @property
    def device_file(self) -> Path:
        return self.folder / "device.yaml"

    def true_position(self, q: FloatArray) -> FloatArray:
        return self.arm.forward(q, TRUTH)[1]


@pytest.fixture
def laboratory(tmp_path: Path) -> Laboratory:
    shutil.copy(SUTA_URDF, tmp_path / "arm.urdf")
    (tmp_path / "artefact.yaml").write_text(ARTEFACT, encoding="utf-8")
    (tmp_path / "calibration.yaml").write_text(JOB, encoding="utf-8")
    arm = ArmModel.from_urdf(tmp_path / "arm.urdf", "tip")
    return Laboratory(tmp_path / "calibration.yaml", arm, device_of(arm))


def upright(yaw_deg: float, position: list[float]) -> PoseSpec:
    return PoseSpec(rotation_from_rpy(np.deg2rad([0, 0, yaw_deg])), np.array(position))


def measure(laboratory: Laboratory, places: list[str], seconds: float, timing: Timing) -> None:
    """``suta-calib measure --yes`` for each placement, one after the other, on one emulated arm."""
    poses = {name: upright(*PLACES[name]) for name in places}
    plan = artefact_set(laboratory.folder / "artefact.yaml", poses, 1, NoiseLevels(seating=SEATING))
    motion = stops(laboratory.arm, TRUTH, plan, timing=timing)
    with EmulatedArm(Emulation(laboratory.device, motion), patient=True) as emulator:
        device = emulator.write_device(laboratory.device_file)
        for done, name in enumerate(places, 1):
            options = ("--placement", name, "--device", device, "--seconds", seconds, "--yes")
            assert cli("measure", laboratory.job, *options) == 0
            # In one process the next command comes before the arm could notice.
            while (
                sum("end of the round" in event for event in emulator.events) < done < len(places)
            ):
                time.sleep(0.01)


def track(
    laboratory: Laboratory, urdf: Path, *options: object
) -> tuple[Trajectory, FloatArray, int]:
    """``suta-calib track`` while all joints swing.

    Returns:
        What it recorded, where the tip was, and how many frames the port did not take.
    """
    log = laboratory.folder / "track.csv"
    motion = sweep(laboratory.arm, slowest=0.2, fastest=0.4)
    with EmulatedArm(Emulation(laboratory.device, motion)) as emulator:
        device = emulator.write_device(laboratory.device_file)
        command = ("track", urdf, "--tip", "tip", "--device", device, "--csv", log)
        assert cli(*command, *options, "--json") == 0
    found = read_trajectory(log, laboratory.arm)
    truth = emulator.trajectory
    rows = np.searchsorted(truth.time, found.time - 1e-5)
    return found, laboratory.true_position(truth.q[rows]), emulator.played.unheard


SIZES = {
    "small": (["P1"], 0.12, Timing(0.45, 0.15), 0.5),
    "full": (list(PLACES), 1.0, Timing(1.6, 0.8), 5.0),
}


@pytest.mark.parametrize(
    ("size", "worst"), [("small", 0.5e-3), pytest.param("full", 0.15e-3, marks=pytest.mark.slow)]
)
def test_the_tracked_tip_agrees_with_the_truth(
    laboratory: Laboratory, capsys: pytest.CaptureFixture[str], size: str, worst: float
):
    places, seconds, timing, lasts = SIZES[size]
    measure(laboratory, places, seconds, timing)
    assert cli("calibrate", laboratory.job) == 0
    results = laboratory.folder / "results"
    result = json.loads((results / "result.json").read_text())
    assert result["unidentified"] == ["joint_1.offset", "joint_2.z"]
    known = result["covariance"]
    assert set(known["parameters"]) == set(TRUTH)
    told = [result["parameters"][name]["std"] for name in known["parameters"]]
    np.testing.assert_allclose(np.sqrt(np.diag(known["matrix"])), told)
    capsys.readouterr()

    options = ("--seconds", lasts, "--result", results / "result.json", "--stats")
    found, true, unheard = track(laboratory, results / "calibrated.urdf", *options)
    answer = json.loads(capsys.readouterr().out)
    assert answer["stream"]["lost_frames"] <= unheard
    assert answer["uncertainty"]["held"] == result["unidentified"]
    assert len(found.time) == answer["poses"]["valid"] > 10 * lasts
    error = found.position - true
    nominal = laboratory.arm.forward(found.angles)[1] - true
    assert np.linalg.norm(nominal, axis=1).mean() > 10e-3
    assert np.linalg.norm(error, axis=1).max() < worst
    # And the uncertainty that is told is of that size.
    std = np.linalg.norm(answer["last"]["std"])
    assert np.linalg.norm(error[-1]) < 4 * std < 4 * worst
