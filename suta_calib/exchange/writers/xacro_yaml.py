"""ROS kinematics YAML, as ``default_kinematics.yaml`` of Universal Robots' description."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from typing import Final

import numpy as np

from suta_calib.exchange.option import Given
from suta_calib.exchange.result import CalibratedArm, Result
from suta_calib.exchange.writer import Writer
from suta_calib.geometry.numbers import rotation_from_rpy, vector_from_rotation
from suta_calib.measurements.yaml_text import yaml_text
from suta_calib.model.chain import ChainJoint
from suta_calib.model.robot import placed_joints
from suta_calib.model.urdf import number_text, rounded
from suta_calib.units import deg, mm

# Their names are the same whatever the description puts in front of them (tf_prefix).
_UR_LINKS: Final = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_LINK: Final = "_link"
_NUMBERS: Final = ("x", "y", "z", "roll", "pitch", "yaw")


class XacroYamlWriter(Writer):
    """Origins of the joints that move, which a xacro loads with ``xacro.load_yaml``.

    A joint is called as its child link without ``_link``. Fixed joints, the tip's among them, have
    no place in such a file: the description has their origins itself.
    """

    name = "xacro-yaml"
    summary = "origins by link as ROS kinematics YAML (default_kinematics.yaml)"
    example = "results --format xacro-yaml --out calibrated_kinematics.yaml"
    file = "exported_kinematics.yaml"

    def content(self, result: Result, _given: Given) -> bytes:
        """``kinematics: {link: {x, y, z, roll, pitch, yaw}, …, hash}``, m and rad."""
        arm = result.need_arm(self.name)
        origins = arm.model.origins(arm.values)
        moving = [joint for joint, _ in placed_joints(arm.model) if joint.moving]
        joints = {
            key: dict(zip(_NUMBERS, map(rounded, np.concatenate(origins[joint.name])), strict=True))
            for key, joint in zip(_keys(moving), moving, strict=True)
        }
        # Drivers tell by it that a description and a controller speak of one calibration.
        digest = hashlib.sha256(yaml_text(joints).encode()).hexdigest()[:20]
        return yaml_text({"kinematics": {**joints, "hash": f"calib_{digest}"}}).encode()

    def lost(self, arm: CalibratedArm) -> list[str]:
        """What is no geometry, and the parameters of fixed joints that changed."""
        names = (name for _, changed in _changed_fixed_joints(arm) for name in changed)
        return [*super().lost(arm), *names]

    def care(self, arm: CalibratedArm) -> tuple[str, ...]:
        """How much a fixed joint changed, and the origin that the description needs."""
        sentences = []
        nominal, calibrated = arm.model.origins({}), arm.model.origins(arm.values)
        for joint, _ in _changed_fixed_joints(arm):
            (xyz, rpy), (old_xyz, old_rpy) = calibrated[joint.name], nominal[joint.name]
            turn = rotation_from_rpy(old_rpy).T @ rotation_from_rpy(rpy)
            origin = " ".join(
                f'{key}="{" ".join(map(number_text, three))}"'
                for key, three in (("xyz", xyz), ("rpy", rpy))
            )
            sentences.append(
                f"This format cannot contain the fixed joint {joint.name}, which changed by "
                f"{mm(float(np.linalg.norm(xyz - old_xyz))):.3f} mm and "
                f"{deg(float(np.linalg.norm(vector_from_rotation(turn)))):.3f}°. Write <origin "
                f"{origin}/> for it into the description."
            )
        return tuple(sentences)


def _keys(joints: list[ChainJoint]) -> list[str]:
    """What such a file calls the joints: their child links, without what all descriptions add."""
    links = [joint.child for joint in joints]
    short = [link.removesuffix(_LINK) for link in links]
    if len(set(short)) < len(short):
        return links
    prefix = short[0].removesuffix(_UR_LINKS[0])
    bare = [name.removeprefix(prefix) for name in short]
    if set(bare) <= set(_UR_LINKS):
        return bare
    return short


def _changed_fixed_joints(arm: CalibratedArm) -> Iterator[tuple[ChainJoint, list[str]]]:
    """Fixed joints of the chains that are not nominal any more, with names of their parameters."""
    for joint, segment in placed_joints(arm.model):
        if joint.moving:
            continue
        names = segment.names(*segment.keys)
        nominal = {name: arm.model.parameters[name].nominal for name in names}
        changed = [n for n, x in nominal.items() if rounded(arm.values.get(n, x) - x)]
        if changed:
            yield joint, changed
