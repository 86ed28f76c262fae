"""Joint offsets as YAML, for motor controllers and drivers."""

from __future__ import annotations

from typing import ClassVar

from suta_calib.exchange.option import Given
from suta_calib.exchange.result import CalibratedArm, Result
from suta_calib.exchange.writer import Writer
from suta_calib.measurements.yaml_text import yaml_text
from suta_calib.model.parameters import OFFSET
from suta_calib.units import shown, unit_name


class JointOffsetsWriter(Writer):
    """What is to be added to the reading of each joint, in SI and in degrees or mm."""

    name: ClassVar[str] = "joint-offsets"
    summary: ClassVar[str] = "YAML with what is added to each joint's reading"
    example: ClassVar[str] = "results --format joint-offsets --out joint_offsets.yaml"
    file: ClassVar[str] = "exported_joint_offsets.yaml"

    def content(self, result: Result, given: Given) -> bytes:
        """``joint_offsets: {joint: {offset_rad, offset_deg}, …}``; m and mm for slides."""
        del given
        arm = result.need_arm(self.name)
        offsets = {}
        for joint, unit in arm.model.units.items():
            value = arm.values.get(f"{joint}.{OFFSET}", 0.0)
            offsets[joint] = {
                f"{OFFSET}_{unit}": value,
                f"{OFFSET}_{unit_name(unit)}": shown(value, unit),
            }
        comment = "Added to the reading of each joint: angle = reading + offset."
        return yaml_text({"joint_offsets": offsets}, comment).encode()

    def lost(self, arm: CalibratedArm) -> list[str]:
        """Everything that differs from nominal but the offsets of joints that are read."""
        return lost_beside_offsets(arm)


def lost_beside_offsets(arm: CalibratedArm) -> list[str]:
    """Names of values that differ from nominal and are no offset of a joint that is read."""
    offsets = {f"{joint}.{OFFSET}" for joint in arm.model.joints}
    offered = arm.model.offered
    return [
        name
        for name, value in arm.values.items()
        if name in offered and name not in offsets and value != offered[name].nominal
    ]
