"""The SUTA on a cable, all joints swinging; simulated."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from simulated import SUTA_URDF

from suta_calib import ArmModel
from suta_calib.device import DeviceSpec, JointSpec
from suta_calib.emulation import Emulation, sweep


def emulated(**options: Any) -> Emulation:
    """Nominal, with what an `Emulation` takes beside the motion, such as faults."""
    arm = ArmModel.from_urdf(SUTA_URDF, "tip")
    joints = tuple(JointSpec(name, -1 if k == 2 else 1) for k, name in enumerate(arm.joints))
    device = DeviceSpec(Path("device.yaml"), "", 921600, "frames", "counts", 1 << 22, joints)
    return Emulation(device, sweep(arm, slowest=0.3), **options)
