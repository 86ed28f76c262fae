"""Tracking from Python, without the command line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from simulated import SUTA_URDF

from suta_calib.emulation import (
    EmulatedArm,
    EmulationOptions,
    Faults,
    Still,
    emulated_device,
    posture_of,
)
from suta_calib.measurements.csv_table import read_csv_table
from suta_calib.tracking import Tracking, TrackOptions


def test_an_emulated_arm_is_tracked_by_a_call(tmp_path: Path) -> None:
    made = emulated_device(
        EmulationOptions(
            SUTA_URDF, "tip", posture="joint_2=10", encoder=0.0, faults=Faults.parse("skip=0.1")
        )
    )
    assert isinstance(made.emulation.motion, Still)
    np.testing.assert_array_equal(
        made.emulation.motion.posture, posture_of(made.arm, {"joint_2": np.deg2rad(10)})
    )
    log = tmp_path / "log.csv"
    with EmulatedArm(made.emulation, patient=True) as emulator:
        device = emulator.write_device(tmp_path / "device.yaml")
        options = TrackOptions(SUTA_URDF, "tip", device, csv=log, seconds=0.6, rate=100.0)
        with Tracking(options) as tracking:
            tracking.run()
    session = tracking.session
    assert not tracking.interrupted
    assert tracking.statistics.lost_frames > 0
    assert session.valid == len(read_csv_table(log)) > 10
    assert session.readings > 5 * session.valid
    assert session.last_valid is not None
    _, position = made.arm.forward(made.emulation.motion.posture)
    assert np.abs(session.last_valid.position - position).max() < 1e-5
    assert tracking.as_dict()["poses"] == {"valid": session.valid, "invalid": 0}
