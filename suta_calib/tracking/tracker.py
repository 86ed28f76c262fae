"""From readings of a device to poses of an arm."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from suta_calib.device.description import misnamed
from suta_calib.errors import InputError
from suta_calib.model.arm import ArmModel
from suta_calib.tracking.pose import TrackedPose
from suta_calib.tracking.tip_kinematics import TipKinematics, quaternion

if TYPE_CHECKING:
    from pathlib import Path

    from suta_calib.device.reading import Reading

_NO_ROTATION = np.full((3, 3), np.nan)
_NO_POSITION = np.full(3, np.nan)
_NO_QUATERNION = np.full(4, np.nan)


class Tracker:
    """Turns every reading into a pose.

    Joints are matched by name: the device may have more joints than the chain, in any order. A
    reading in which an encoder of the chain raises its error flag gives a pose that is not valid
    and carries no numbers.

    Args:
        arm: the calibrated arm.
        device_joints: names in the order of the readings' angles.
        kinematics: of the same arm.
        device: the device's file, for messages.

    Raises:
        InputError: the device lacks a joint of the chain.
    """

    def __init__(
        self,
        arm: ArmModel,
        device_joints: Sequence[str],
        kinematics: TipKinematics,
        device: Path | None = None,
    ) -> None:
        self.joints = arm.joints
        self.kinematics = kinematics
        self._columns = np.array(matched_joints(arm, device_joints, device), dtype=np.intp)
        self._since_1970 = time.time() - time.perf_counter()

    def pose(self, reading: Reading) -> TrackedPose:
        """The tip's pose at this reading."""
        angles = reading.angles[self._columns]
        errors, warnings = self._flagged(reading.error), self._flagged(reading.warning)
        if errors:
            rotation, position, turn, std = _NO_ROTATION, _NO_POSITION, _NO_QUATERNION, None
        else:
            rotation, position, std = self.kinematics(angles)
            turn = quaternion(rotation)
        return TrackedPose(
            reading.sequence,
            reading.time,
            reading.arrival,
            reading.arrival + self._since_1970,
            angles,
            rotation,
            position,
            turn,
            std,
            errors,
            warnings,
        )

    def _flagged(self, flags: np.typing.NDArray[np.bool_]) -> tuple[str, ...]:
        if not flags.any():
            return ()
        mine = flags[self._columns]
        return tuple(name for name, raised in zip(self.joints, mine, strict=True) if raised)


def matched_joints(
    arm: ArmModel, device_joints: Sequence[str], device: Path | None = None
) -> list[int]:
    """For each joint of the chain, its place among the device's.

    Raises:
        InputError: the device lacks one; names it and what the device has.
    """
    order = {name: k for k, name in enumerate(device_joints)}
    missing = [name for name in arm.joints if name not in order]
    if missing:
        raise InputError(
            f"the joints {', '.join(device_joints)}",
            f"those of the chain {arm.chain.base} → {arm.tip}: {', '.join(arm.joints)}",
            file=device,
            where="joints",
            hint=misnamed(device_joints, arm.joints) or f"add {', '.join(missing)}",
        )
    return [order[name] for name in arm.joints]
