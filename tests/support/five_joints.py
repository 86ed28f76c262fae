"""An arm of five joints, for what gravity tells."""

from __future__ import annotations

# Of five joints, each crosses the next one at a right angle. Or three of them are parallel.
AXES = {"crossed": "zyxyx", "parallel": "zyyyz"}


def urdf(axes: str, names: tuple[str, ...] = ("j1", "j2", "j3", "j4", "j5")) -> str:
    links = "".join(f'<link name="l{k}"/>' for k in range(len(axes) + 1))
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="0 0 0.1"/><axis xyz="{" ".join(str(int(a == axis)) for a in "xyz")}"/>'
        '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
        for k, (name, axis) in enumerate(zip(names, axes, strict=True))
    )
    tool = (
        '<joint name="tool" type="fixed"><parent link="l5"/><child link="tip"/>'
        '<origin xyz="0 0 0.1"/></joint><link name="tip"/>'
    )
    return f'<robot name="five">{links}{joints}{tool}</robot>'
