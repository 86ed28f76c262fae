"""ROS kinematics YAML, in the manner of ``default_kinematics.yaml`` of UR's description."""

from __future__ import annotations

import hashlib
from typing import ClassVar

from suta_calib.exchange.option import Given
from suta_calib.exchange.result import Result
from suta_calib.exchange.writer import Writer
from suta_calib.exchange.yaml_text import yaml_bytes


class XacroYamlWriter(Writer):
    """Origins of the chain's joints by name, which a xacro loads with ``xacro.load_yaml``."""

    name: ClassVar[str] = "xacro-yaml"
    summary: ClassVar[str] = "origins by joint as ROS kinematics YAML (default_kinematics.yaml)"
    example: ClassVar[str] = "results --format xacro-yaml --out calibrated_kinematics.yaml"
    file: ClassVar[str] = "exported_kinematics.yaml"

    def content(self, result: Result, given: Given) -> bytes:
        """``kinematics: {joint: {x, y, z, roll, pitch, yaw}, …, hash}``, m and rad."""
        del given
        arm = result.need_arm(self.name)
        joints = {
            name: dict(
                zip(
                    ("x", "y", "z", "roll", "pitch", "yaw"),
                    (*map(float, xyz), *map(float, rpy)),
                    strict=True,
                )
            )
            for name, (xyz, rpy) in arm.model.origins(arm.values).items()
        }
        # Drivers tell by it that a description and a controller speak of one calibration.
        told = hashlib.sha256(yaml_bytes(joints)).hexdigest()[:20]
        return yaml_bytes({"kinematics": {**joints, "hash": f"calib_{told}"}})
