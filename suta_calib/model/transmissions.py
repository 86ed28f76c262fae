"""Joints that a URDF's ``<transmission>`` couples: belts and bars by which one moves another.

As ros_control writes them below ``<robot>`` (http://wiki.ros.org/urdf/XML/Transmission), and
ros2_control below ``<ros2_control>``. Readings of joints mostly have the coupling taken out of them
already; what is wrong with it is what remains to be estimated, so that these joints are offered for
that and nothing is moved.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from suta_calib.model.urdf_tree import Element, children, tag_of

# Roles of the joints that are moved too, each with the role of the one whose motor does it.
MOVED: Final[Mapping[str, tuple[tuple[str, str], ...]]] = {
    "DifferentialTransmission": (("joint1", "joint2"), ("joint2", "joint1")),
    # The first bar turns the frame in which the second one's motor stands.
    "FourBarLinkageTransmission": (("joint2", "joint1"),),
}


def coupled_joints(robot: Element) -> dict[str, tuple[str, ...]]:
    """By joint: those whose motors move it too.

    A transmission of another type, or one that names no two joints, couples nothing: what a
    controller would refuse is nothing to a chain.

    Args:
        robot: the element ``<robot>``.
    """
    coupled: dict[str, tuple[str, ...]] = {}
    for transmission in _transmissions(robot):
        kind = _text(transmission, "type", "plugin").rpartition("/")[2]
        joints = _by_role(transmission)
        for moved, by in MOVED.get(kind, ()):
            if moved in joints and by in joints and joints[moved] != joints[by]:
                before = coupled.get(joints[moved], ())
                coupled[joints[moved]] = tuple(dict.fromkeys([*before, joints[by]]))
    return coupled


def _transmissions(robot: Element) -> Iterator[Element]:
    yield from children(robot, "transmission")
    for control in children(robot, "ros2_control"):
        yield from children(control, "transmission")


def _by_role(transmission: Element) -> dict[str, str]:
    """Names of the joints by role: an element of ROS 1, an attribute of ROS 2; else their order."""
    return {
        joint.get("role") or _text(joint, "role") or f"joint{place}": joint.get("name")
        for place, joint in enumerate(children(transmission, "joint"), 1)
        if joint.get("name")
    }


def _text(element: Element, *tags: str) -> str:
    """The text of the first child that is called so, or nothing."""
    texts = (child.text for child in element if tag_of(child) in tags)
    return (next(texts, "") or "").strip()
