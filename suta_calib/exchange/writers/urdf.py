"""URDF: the user's own file with the calibrated origins, nothing else changed."""

from __future__ import annotations

from typing import Final
from xml.sax.saxutils import quoteattr

from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.result import Result, Transform
from suta_calib.exchange.writer import Writer
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.model.parameters import OFFSET
from suta_calib.model.urdf_tree import read_tree

CAMERAS: Final = Option(
    "cameras",
    "Add a link for each camera, on the link that carries it; z points out of the camera.",
    flag=True,
)
WITHOUT_OFFSETS: Final = Option(
    "without_offsets",
    "Leave the offsets of the joints out: for a robot whose encoders were corrected by them "
    "(lerobot, joint-offsets).",
    flag=True,
)
_END: Final = b"</robot>"


class UrdfWriter(Writer):
    """The nominal URDF, byte for byte but for the numbers of its origins."""

    name = "urdf"
    summary = "the job's URDF with calibrated <origin>s; --cameras adds links for cameras"
    example = "results --format urdf --cameras --out arm.urdf"
    options = (CAMERAS, WITHOUT_OFFSETS)
    file = "exported.urdf"

    def content(self, result: Result, given: Given) -> bytes:
        """The file's bytes."""
        arm = result.need_arm(self.name)
        values = dict(arm.values)
        if WITHOUT_OFFSETS in given:
            values |= dict.fromkeys((f"{joint}.{OFFSET}" for joint in arm.model.joints), 0.0)
        urdf = arm.model.calibrated_urdf(values)
        if CAMERAS not in given:
            return urdf
        links = read_tree(urdf.decode()).links
        cameras = [pose for pose in result.transforms if pose.child.startswith("camera")]
        if not cameras:
            problem = "a result without a camera"
            raise given.refuse(CAMERAS, problem, "one of a job that calibrated a camera")
        start, end, rest = urdf.rpartition(_END)
        added = "".join(_link(pose) for pose in cameras if pose.parent in links)
        return start + added.encode() + end + rest


def _link(pose: Transform) -> str:
    """A link at a pose that does not move in another."""
    xyz, rpy = (
        " ".join(f"{number:.9g}" for number in numbers)
        for numbers in (pose.matrix[:3, 3], rpy_from_rotation(pose.matrix[:3, :3]))
    )
    parent, child = quoteattr(pose.parent), quoteattr(pose.child)
    return (
        f"  <link name={child}/>\n"
        f'  <joint name={quoteattr(pose.child + "_joint")} type="fixed">\n'
        f'    <origin xyz="{xyz}" rpy="{rpy}"/>\n'
        f"    <parent link={parent}/>\n    <child link={child}/>\n  </joint>\n"
    )
