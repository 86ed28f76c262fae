"""ROS static transforms as YAML: of the tool, cameras, instruments and artefacts."""

from __future__ import annotations

from typing import Any, ClassVar

from suta_calib.exchange.option import Given
from suta_calib.exchange.result import Result, Transform
from suta_calib.exchange.writer import Writer
from suta_calib.geometry.numbers import quaternion_from_rotation
from suta_calib.measurements.yaml_text import yaml_text


def stamped(transform: Transform) -> dict[str, Any]:
    """A pose as ``geometry_msgs/TransformStamped`` has it, without its stamp."""
    return {
        "header": {"frame_id": transform.parent},
        "child_frame_id": transform.child,
        "transform": {
            "translation": _named("xyz", transform.matrix[:3, 3]),
            "rotation": _named("xyzw", quaternion_from_rotation(transform.matrix[:3, :3])),
        },
    }


def _named(letters: str, numbers: Any) -> dict[str, float]:
    return dict(zip(letters, map(float, numbers), strict=True))


class RosTfWriter(Writer):
    """Static transforms, as a list of TransformStamped."""

    name: ClassVar[str] = "ros-tf"
    summary: ClassVar[str] = "static transforms as YAML (geometry_msgs/TransformStamped)"
    example: ClassVar[str] = "results --format ros-tf --out static_transforms.yaml"
    file: ClassVar[str] = "exported_static_transforms.yaml"

    def content(self, result: Result, given: Given) -> bytes:
        """``transforms: [{header, child_frame_id, transform}, …]``, m and x y z w."""
        del given
        transforms = result.need_transforms(self.name)
        return yaml_text({"transforms": [stamped(transform) for transform in transforms]}).encode()
