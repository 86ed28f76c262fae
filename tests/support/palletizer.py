"""A palletizing arm of our own: a crank at the shoulder moves its elbow through a four-bar."""

from __future__ import annotations

from suta_calib import ArmModel, Loop

# Crank and coupler are as long as what they stand beside: the four-bar is a parallelogram.
CRANK, ARM = 0.12, 0.4


def _joint(name: str, parent: str, child: str, xyz: str, axis: str = "", more: str = "") -> str:
    kind = "revolute" if axis else "fixed"
    turning = f'<axis xyz="{axis}"/><limit lower="-1.2" upper="1.2" effort="1" velocity="1"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/>{turning if axis else ""}{more}</joint>'
    )


def palletizer_urdf(crank: float = CRANK, coupler: float = ARM) -> str:
    """The text of its URDF: base → yaw → shoulder → elbow (passive) → wrist → tool.

    The crank turns about the shoulder's axis and pulls the coupler, which is pinned to the
    forearm's tail. All joints are at zero with the upper arm upright and the forearm level.
    """
    joints = [
        _joint("yaw", "base", "column", "0 0 0.3", "0 0 1"),
        _joint("shoulder", "column", "upper_arm", "0.1 0 0.05", "0 1 0"),
        _joint("elbow", "upper_arm", "forearm", f"0 0 {ARM}", "0 1 0"),
        _joint("wrist", "forearm", "hand", "0.35 0 0", "0 1 0"),
        _joint("flange", "hand", "flange_link", "0.08 0 0", "1 0 0"),
        _joint("mount", "flange_link", "tool", "0.05 0.01 0.02"),
        _joint("crank", "column", "crank_link", "0.1 0 0.05", "0 1 0"),
        _joint("coupler", "crank_link", "coupler_link", f"-{crank} 0 0", "0 -1 0"),
        _joint("tail", "forearm", "tail_link", f"-{CRANK} 0 0"),
        _joint("pin", "coupler_link", "pin_link", f"0 0 {coupler}"),
    ]
    names = ["base", "column", "upper_arm", "forearm", "hand", "flange_link", "tool"]
    names += ["crank_link", "coupler_link", "tail_link", "pin_link"]
    links = "".join(f'<link name="{name}"/>' for name in names)
    return f'<robot name="palletizer">{links}{"".join(joints)}</robot>'


LOOP = Loop(("tail_link", "pin_link"), ("elbow", "coupler"))


def palletizer() -> ArmModel:
    """The arm with its loop."""
    return ArmModel.from_urdf(palletizer_urdf(), "tool", loops=[LOOP])
