"""Static transforms for ROS, of the tool, cameras, instruments and artefacts: YAML, or launch."""

from __future__ import annotations

from typing import Any

from suta_calib.exchange.chosen_poses import POSE_OPTIONS, chosen_poses
from suta_calib.exchange.option import Given
from suta_calib.exchange.result import Result, Transform
from suta_calib.exchange.writer import Writer
from suta_calib.geometry.numbers import quaternion_from_rotation
from suta_calib.measurements.yaml_text import yaml_text

_HEAD = """\
\"\"\"Static transforms that a calibration found.\"\"\"

from launch import LaunchDescription
from launch_ros.actions import Node

# Parent, child, x y z in m, quaternion x y z w.
TRANSFORMS = [
"""
_TAIL = """\
]


def generate_launch_description():
    nodes = []
    for parent, child, (x, y, z), (qx, qy, qz, qw) in TRANSFORMS:
        numbers = {"x": x, "y": y, "z": z, "qx": qx, "qy": qy, "qz": qz, "qw": qw}
        words = [word for name, value in numbers.items() for word in (f"--{name}", repr(value))]
        words += ["--frame-id", parent, "--child-frame-id", child]
        nodes.append(
            Node(package="tf2_ros", executable="static_transform_publisher", arguments=words)
        )
    return LaunchDescription(nodes)
"""


class RosTfWriter(Writer):
    """Static transforms, as a list of TransformStamped."""

    name = "ros-tf"
    summary = "static transforms as YAML (geometry_msgs/TransformStamped)"
    example = "results --format ros-tf --frame hand=tool0 --frame eye=camera_link"
    options = POSE_OPTIONS
    file = "exported_static_transforms.yaml"

    def content(self, result: Result, given: Given) -> bytes:
        """``transforms: [{header, child_frame_id, transform}, …]``, m and x y z w."""
        transforms = chosen_poses(result, self.name, given)
        return yaml_text({"transforms": [_stamped(transform) for transform in transforms]}).encode()


class RosLaunchWriter(Writer):
    """A Python launch file with one ``static_transform_publisher`` for each pose."""

    name = "ros-launch"
    summary = "ROS 2 launch file with a static_transform_publisher per pose"
    example = "results --format ros-launch --frame hand=tool0 --frame eye=camera_link"
    options = POSE_OPTIONS
    file = "exported_static_transforms.launch.py"

    def content(self, result: Result, given: Given) -> bytes:
        """The launch file."""
        rows = []
        for transform in chosen_poses(result, self.name, given):
            place = tuple(map(float, transform.matrix[:3, 3]))
            turn = tuple(map(float, quaternion_from_rotation(transform.matrix[:3, :3])))
            rows.append(f"    ({transform.parent!r}, {transform.child!r}, {place!r}, {turn!r}),\n")
        return "".join([_HEAD, *rows, _TAIL]).encode()


def _stamped(transform: Transform) -> dict[str, Any]:
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
