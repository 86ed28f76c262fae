"""A small robot of our own: two arms on a torso with two joints; simulated observations of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from suta_calib import ArmModel, Robot, TrackedPoint

_ARM = (
    ("0 {y} 0.3", "0 1 0"),
    ("0 0 0.02", "1 0 0"),
    ("0 0 -0.25", "0 0 1"),
    ("0 0 -0.05", "0 1 0"),
    ("0 0 -0.2", "0 0 1"),
    ("0 0 -0.05", "0 1 0"),
)
# What an instrument sees of the base.
SEEN = np.diag([1.0, -1.0, -1.0]), np.array([1.0, 2.0, 3.0])
# Where a reflector sits in each tip.
REFLECTOR = np.array([0.05, 0.01, -0.03])


def _link(name: str) -> str:
    return (
        f'<link name="{name}"><inertial><origin xyz="0 0 -0.1"/><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def _joint(name: str, parent: str, child: str, xyz: str, axis: str, kind: str = "revolute") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>'
        '<limit lower="-2.5" upper="2.5" effort="1" velocity="1"/></joint>'
    )


def torso_robot_urdf(*, head: bool = False) -> str:
    """The text of its URDF: chains base_link → left_hand and base_link → right_hand.

    With a head, it has a third one: base_link → eye, by a neck of two joints.
    """
    parts = [_link(name) for name in ("base_link", "torso_a", "torso_b")]
    parts.append(_joint("torso_1", "base_link", "torso_a", "0 0 0.5", "0 0 1"))
    parts.append(_joint("torso_2", "torso_a", "torso_b", "0 0 0.2", "0 1 0"))
    for side, y in (("left", "0.2"), ("right", "-0.2")):
        parent = "torso_b"
        for k, (xyz, axis) in enumerate(_ARM, 1):
            link = f"{side}_link_{k}"
            parts += [_link(link), _joint(f"{side}_{k}", parent, link, xyz.format(y=y), axis)]
            parent = link
        parts.append(_link(f"{side}_hand"))
        parts.append(_joint(f"{side}_mount", parent, f"{side}_hand", "0 0 -0.1", "1 0 0", "fixed"))
    if head:
        parts += [_link(name) for name in ("pan", "head", "eye")]
        parts.append(_joint("neck_1", "torso_b", "pan", "0.05 0 0.35", "0 0 1"))
        parts.append(_joint("neck_2", "pan", "head", "0 0 0.05", "0 1 0"))
        parts.append(_joint("eye_mount", "head", "eye", "0.05 0 0.05", "1 0 0", "fixed"))
    return "\n".join(['<robot name="torso">', *parts, "</robot>"])


def torso_robot(path: Path | None = None) -> Robot:
    """The robot with the chains left and right."""
    urdf: str | Path = torso_robot_urdf() if path is None else path
    return Robot.from_urdf(urdf, {"left": ("left_hand", None), "right": ("right_hand", None)})


def built(robot: Robot, rng: np.random.Generator) -> dict[str, float]:
    """Its true values: a millimetre and half a degree off the drawing."""
    names = [n for n in robot.geometric if n not in robot.like_offsets]
    names += [n for n in robot.offsets if n not in names]
    size = {"m": 1e-3, "rad": 8e-3}
    return {
        name: robot.parameters[name].nominal + size[robot.parameters[name].unit] * float(value)
        for name, value in zip(sorted(names), rng.standard_normal(len(names)), strict=True)
    }


def seen(
    arm: ArmModel, values: dict[str, float], n: int, rng: np.random.Generator, sigma: float = 2e-4
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Readings (n, joints) at random and where an instrument sees the reflector (n, 3), m."""
    q = rng.uniform(-1.5, 1.5, (n, len(arm.joints)))
    rotation, position = arm.forward(q, values)
    return q, (position + rotation @ REFLECTOR) @ SEEN[0].T + SEEN[1] + rng.normal(0, sigma, (n, 3))


def tracked(
    arm: ArmModel, values: dict[str, float], n: int, rng: np.random.Generator, sigma: float = 2e-4
) -> TrackedPoint:
    """The same as a term, with the reflector as target A."""
    q, position = seen(arm, values, n, rng, sigma)
    return TrackedPoint.from_arrays(arm, q, position=position, target="A")


def write_torso_job(folder: Path, fitted: int = 50, held_out: int = 20) -> Path:
    """A job of two chains, each with samples of its own columns, fitted and held out."""
    urdf = folder / "robot.urdf"
    urdf.write_text(torso_robot_urdf())
    robot, rng = torso_robot(), np.random.default_rng(5)
    truth = built(robot, rng)
    for name, arm in robot.chains.items():
        for file, n in (("fitted", fitted), ("held", held_out)):
            q, position = seen(arm, truth, n, rng)
            header = ",".join((*arm.joints, "x", "y", "z", "target"))
            rows = [",".join(map(repr, map(float, row))) + ",A" for row in np.hstack([q, position])]
            (folder / f"{name}_{file}.csv").write_text("\n".join([header, *rows]) + "\n")
    path = folder / "calibration.yaml"
    path.write_text(
        "arm: {urdf: robot.urdf, chains: {left: {tip: left_hand}, right: {tip: right_hand}}}\n"
        "parameters:\n"
        "  - {select: geometric, prior_mm: 2, prior_deg: 0.5}\n"
        "  - {select: '*.offset', prior_deg: 5}\n"
        "observations:\n"
        "  - {kind: tracked_point, chain: left, samples: left_fitted.csv}\n"
        "  - {kind: tracked_point, chain: right, samples: right_fitted.csv}\n"
        "validation:\n"
        "  - {kind: tracked_point, chain: left, samples: left_held.csv}\n"
        "  - {kind: tracked_point, chain: right, samples: right_held.csv}\n"
    )
    return path
