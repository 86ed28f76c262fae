"""A ROS 2 launch file that publishes the static transforms."""

from __future__ import annotations

from typing import ClassVar

from suta_calib.exchange.option import Given
from suta_calib.exchange.result import Result
from suta_calib.exchange.writer import Writer
from suta_calib.geometry.numbers import quaternion_from_rotation

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


class RosLaunchWriter(Writer):
    """A Python launch file with one ``static_transform_publisher`` for each pose."""

    name: ClassVar[str] = "ros-launch"
    summary: ClassVar[str] = "ROS 2 launch file with a static_transform_publisher per pose"
    example: ClassVar[str] = "results --format ros-launch --out static_transforms.launch.py"
    file: ClassVar[str] = "exported_static_transforms.launch.py"

    def content(self, result: Result, given: Given) -> bytes:
        """The launch file."""
        del given
        rows = []
        for transform in result.need_transforms(self.name):
            place = tuple(map(float, transform.matrix[:3, 3]))
            turn = tuple(map(float, quaternion_from_rotation(transform.matrix[:3, :3])))
            rows.append(f"    ({transform.parent!r}, {transform.child!r}, {place!r}, {turn!r}),\n")
        return "".join([_HEAD, *rows, _TAIL]).encode()
