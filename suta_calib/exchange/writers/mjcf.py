"""MuJoCo's MJCF: the calibrated chain as nested bodies with ``pos`` and ``quat``."""

from __future__ import annotations

import math

import numpy as np
from lxml import etree

from suta_calib.arrays import FloatArray
from suta_calib.exchange.option import Given
from suta_calib.exchange.result import Result
from suta_calib.exchange.writer import Writer
from suta_calib.geometry.numbers import quaternion_from_rotation


class MjcfWriter(Writer):
    """Bodies, joints and a site at the tip; no shapes, and masses of no meaning."""

    name = "mjcf"
    summary = "the chain as MuJoCo model: bodies, joints, and a site at the tip"
    example = "results --format mjcf --out arm.xml"
    file = "exported_mjcf.xml"
    notes = (
        "The model contains only the kinematics of the chain: shapes and masses are in the URDF.",
    )

    def content(self, result: Result, _given: Given) -> bytes:
        """The file; its world is the chain's base, its site the tip."""
        arm = result.need_arm(self.name)
        chain = arm.alone.chain
        root = etree.Element("mujoco", model=chain.robot)
        # Full range, and angles in rad; the default would be degrees.
        etree.SubElement(root, "compiler", angle="radian", autolimits="true")
        body = etree.SubElement(root, "worldbody")
        steps, end = arm.steps(chain)
        for step in steps:
            joint = step.joint
            body = etree.SubElement(body, "body", name=joint.child, **_placed(step.before))
            etree.SubElement(body, "inertial", pos="0 0 0", mass="1", diaginertia="1 1 1")
            kind = "slide" if joint.type == "prismatic" else "hinge"
            moved = etree.SubElement(
                body, "joint", name=joint.name, type=kind, axis=_text(step.axis)
            )
            if math.isfinite(joint.lower) and math.isfinite(joint.upper):
                moved.set("range", _text(np.array([joint.lower, joint.upper])))
        etree.SubElement(body, "site", name=chain.tip, **_placed(end))
        mimics = [(step.joint.name, step.joint.mimic) for step in steps if step.joint.mimic]
        if mimics:
            equality = etree.SubElement(root, "equality")
            for name, mimic in mimics:
                coupling = {"joint1": name, "joint2": mimic.joint}
                coefficients = _text(np.array([mimic.offset, mimic.multiplier, 0, 0, 0]))
                etree.SubElement(equality, "joint", coupling, polycoef=coefficients)
        return bytes(
            etree.tostring(root, pretty_print=True, xml_declaration=True, encoding="utf-8")
        )


def _placed(matrix: FloatArray) -> dict[str, str]:
    """``pos`` and ``quat`` (scalar first) of a transform."""
    x, y, z, w = quaternion_from_rotation(matrix[:3, :3])
    return {"pos": _text(matrix[:3, 3]), "quat": _text(np.array([w, x, y, z]))}


def _text(numbers: FloatArray) -> str:
    return " ".join(repr(float(value)) for value in numbers)
