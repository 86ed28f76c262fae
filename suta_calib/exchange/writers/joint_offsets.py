"""Joint offsets as YAML, for motor controllers and drivers."""

from __future__ import annotations

from suta_calib.exchange.option import Given
from suta_calib.exchange.result import CalibratedArm, Result
from suta_calib.exchange.writer import Writer
from suta_calib.measurements.yaml_text import yaml_text
from suta_calib.model.parameters import OFFSET
from suta_calib.units import shown, unit_name


class OffsetsWriter(Writer):
    """A format that holds nothing but the offsets of joints that are read."""

    def lost(self, arm: CalibratedArm) -> list[str]:
        """Everything else that differs from nominal."""
        offsets = {f"{joint}.{OFFSET}" for joint in arm.model.joints}
        values = ((n, x) for n, x in arm.values.items() if n in arm.model.offered)
        return [n for n, x in values if n not in offsets and x != arm.model.offered[n].nominal]


class JointOffsetsWriter(OffsetsWriter):
    """What is to be added to the reading of each joint, in SI and in degrees or mm."""

    name = "joint-offsets"
    summary = "YAML with the offset to add to each joint's reading"
    example = "results --format joint-offsets --out joint_offsets.yaml"
    file = "exported_joint_offsets.yaml"

    def content(self, result: Result, _given: Given) -> bytes:
        """``joint_offsets: {joint: {offset_rad, offset_deg}, …}``; m and mm for slides."""
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
