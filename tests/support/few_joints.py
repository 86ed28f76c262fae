"""Arms of one to eight joints, as a student might build them, and jobs for them; all simulated."""

from __future__ import annotations

# A turntable, a shoulder, an elbow, and a wrist of three; two joints more for a redundant one.
AXES = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")
LENGTHS = ("0 0 0.1", "0.02 0 0.1", "0.3 0 0", "0.2 0 0.02", "0.1 0.02 0", "0.08 0 0", "0.1 0 0")


def few_joints(joints: int) -> str:
    """A URDF with so many revolute joints, one to eight, and a link called tip."""
    text, origins = [f'<robot name="arm_{joints}"><link name="l0"/>'], (*LENGTHS, "0.05 0 0")
    for k in range(joints):
        text.append(
            f'<link name="l{k + 1}"/><joint name="j{k + 1}" type="revolute"><parent link="l{k}"/>'
            f'<child link="l{k + 1}"/><origin xyz="{origins[k]}"/><axis xyz="{AXES[k]}"/>'
            '<limit lower="-2.5" upper="2.5" effort="1" velocity="1"/></joint>'
        )
    text.append(
        f'<link name="tip"/><joint name="tool" type="fixed"><parent link="l{joints}"/>'
        '<child link="tip"/><origin xyz="0.15 0.03 0.05"/></joint></robot>'
    )
    return "\n".join(text)


SIMULATION = """\
arm: {{urdf: arm.urdf, tip: tip}}
errors:
  - {{select: ["*.offset"], std_deg: 0.5}}
  - {{select: [geometric], std_mm: 0.5}}
posture_deg: {{{posture}}}
sets:
{sets}
"""
TRACKED = """\
  {name}: {{kind: tracked_point, samples: {samples}, noise: {{instrument_mm: 0.05}}}}
"""
TOUCHED = """\
  {name}:
    kind: fixed_point
    noise: {{seating_mm: 0.05}}
    directions: 12
    points: {{F1: {{position_mm: [350, 50, 250]}}, F2: {{position_mm: [250, -200, 200]}}}}
"""
JOB = """\
arm: {{urdf: arm.urdf, tip: tip}}
parameters:
  - {{select: ["*.offset"], bound_deg: 10}}
  - {{select: [geometric], bound_mm: 10, bound_deg: 3}}
observations:
  - {{kind: {kind}, samples: fitted/*.csv}}
validation:
  - {{kind: {kind}, samples: held/*.csv}}
"""
