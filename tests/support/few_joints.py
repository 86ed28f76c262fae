"""Arms of one to eight joints, as a student might build them, and what is simulated with them."""

from __future__ import annotations

from pathlib import Path

from suta_calib.terms import KINDS

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


ARTEFACT = """\
landmarks:
  A: {position_mm: [0, 0, 0], rotation_rpy_deg: [180, 0, 0]}
  B: {position_mm: [100, 0, 0], rotation_rpy_deg: [180, 0, 0]}
  C: {position_mm: [0, 80, 0], rotation_rpy_deg: [180, 0, 0]}
"""
_PLACES = {
    True: "artefact: artefact.yaml\n    placements: {P1: {position_mm: [250, 50, 250]}}",
    False: "directions: 6\n    points: {F1: {position_mm: [350, 50, 250]}}",
}


def simulation(folder: Path, kind: str) -> Path:
    """A simulation of one kind over ``arm.urdf`` and ``artefact.yaml`` in the folder."""
    places = _PLACES[KINDS[kind].needs_artefact]
    path = folder / "simulation.yaml"
    path.write_text(
        "arm: {urdf: arm.urdf, tip: tip}\n"
        'errors: [{select: ["*.offset"], std_deg: 0.5}]\n'
        f"sets:\n  fitted:\n    kind: {kind}\n    {places}\n"
    )
    return path
