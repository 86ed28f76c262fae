"""An arm as it is drawn: where each of its links is, and what shape the links have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.model.arm import ArmModel
from suta_calib.model.kinematic_urdf import pinocchio_model
from suta_calib.model.urdf_tree import read_tree


@dataclass(frozen=True, eq=False)
class LinkMesh:
    """A triangle mesh that is rigid with a link.

    Attributes:
        link: its name.
        vertices: (n, 3) in the link's frame, m.
        faces: (m, 3) vertices of each triangle, from 0.
        colour: red, green, blue and opacity, 0 to 255.
    """

    link: str
    vertices: FloatArray
    faces: IntArray
    colour: tuple[int, int, int, int]


@dataclass(frozen=True, eq=False)
class Linkage:
    """What it takes to place an arm's links: a joint's angle or slide is ``gearing @ q + shift``.

    Attributes:
        parent: (joints,) which joint carries each, from 0 and below it; -1 for the root.
        rotation, position: (joints, 3, 3) and (joints, 3), each joint's frame in its parent's, m.
        axis: (joints, 3) unit vector in the joint's own frame.
        slides: (joints,) whether it slides along its axis; it turns about it otherwise.
        gearing, shift: (joints, readings) and (joints,), rad or m.
        carrier: (links,) which joint carries each link; -1 for the root.
        link_rotation, link_position: (links, 3, 3) and (links, 3), each link in its carrier's
            frame, m.
        base: which link all others are told in.
    """

    parent: IntArray
    rotation: FloatArray
    position: FloatArray
    axis: FloatArray
    slides: BoolArray
    gearing: FloatArray
    shift: FloatArray
    carrier: IntArray
    link_rotation: FloatArray
    link_position: FloatArray
    base: int


@dataclass(frozen=True, eq=False)
class DrawnArm:
    """The links of an arm's URDF with some parameter values, all of them, the chain's and others.

    Joints off the chain are at neutral. Gains, eccentricities, compliances and backlashes move no
    link here, as they move none in a calibrated URDF; couplings that are given do.

    Attributes:
        name: ``nominal`` or ``calibrated``.
        arm: the arm.
        values: of its parameters by name, m or rad; nominal where not given.
        meshes: shapes of its links; none where no file of them was found.
    """

    name: str
    arm: ArmModel
    values: Mapping[str, float]
    meshes: tuple[LinkMesh, ...] = ()

    @cached_property
    def _model(self) -> pin.Model:
        tree = read_tree(self.arm.chain.path, self.arm.calibrated_urdf(self.values))
        moving = {joint.name for joint in self.arm.chain.joints if joint.moving}
        return pinocchio_model(tree, moving)

    @cached_property
    def links(self) -> tuple[str, ...]:
        """Names of all links, in the URDF's order."""
        return read_tree(*self.arm.urdf).links

    @cached_property
    def bones(self) -> IntArray:
        """(n, 2) the two links of every joint of the chain, base → tip, by number in `links`."""
        at = {link: k for k, link in enumerate(self.links)}
        return np.array([[at[j.parent], at[j.child]] for j in self.arm.chain.joints], dtype=np.intp)

    def poses(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """``T_base_link`` of all `links` at readings (joints,), rad or m.

        Returns:
            Rotations (links, 3, 3) and positions (links, 3), m.
        """
        model, data = self._model, self._data
        pin.framesForwardKinematics(model, data, self.arm.configuration(q))
        base, *links = (
            data.oMf[model.getFrameId(link, pin.FrameType.BODY)]
            for link in (self.arm.chain.base, *self.links)
        )
        placed = [base.actInv(link) for link in links]
        return np.array([p.rotation for p in placed]), np.array([p.translation for p in placed])

    @property
    def linkage(self) -> Linkage:
        """What `poses` says, as numbers for whoever has no Pinocchio: a page that is looked at."""
        model, arm = self._model, self.arm
        moving = [joint for joint in arm.chain.joints if joint.moving]
        number = [model.getJointId(joint.name) for joint in moving]
        order = np.argsort(number)  # Pinocchio's, in which a parent comes before its children.
        joints = [moving[k] for k in order]
        placed = [model.jointPlacements[number[k]] for k in order]
        frames = [model.frames[model.getFrameId(link, pin.FrameType.BODY)] for link in self.links]
        return Linkage(
            np.array([model.parents[number[k]] for k in order], dtype=np.intp) - 1,
            np.array([each.rotation for each in placed]),
            np.array([each.translation for each in placed]),
            np.array([joint.axis for joint in joints]),
            np.array([joint.type == "prismatic" for joint in joints]),
            arm.gearing[order],
            np.array([segment.shift for segment in arm.movers])[order],
            np.array([_joint_of(frame) for frame in frames], dtype=np.intp) - 1,
            np.array([frame.placement.rotation for frame in frames]),
            np.array([frame.placement.translation for frame in frames]),
            self.links.index(arm.chain.base),
        )

    @cached_property
    def _data(self) -> pin.Data:
        return self._model.createData()


def _joint_of(frame: pin.Frame) -> int:
    """Number of the joint that carries a frame, which Pinocchio 2 calls otherwise."""
    return int(frame.parentJoint if hasattr(frame, "parentJoint") else frame.parent)
