"""An arm as it is drawn: where each of its links is, and what shape the links have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.model.arm import configuration_of
from suta_calib.model.kinematic_urdf import pinocchio_model
from suta_calib.model.robot import AnyArm, placed_joints
from suta_calib.model.urdf_tree import read_tree


@dataclass(frozen=True, eq=False)
class LinkMesh:
    """A triangle mesh that is rigid with a link: vertices (n, 3), m, and faces (m, 3) from 0."""

    link: str
    vertices: FloatArray
    faces: IntArray
    colour: tuple[int, int, int, int]


@dataclass(frozen=True, eq=False)
class DrawnArm(Displayable):
    """The links of an arm's URDF with some parameter values, all of them, the chain's and others.

    Joints off the chain are at neutral. Gains, eccentricities, compliances and backlashes move no
    link here, as they move none in a calibrated URDF; couplings that are given do.

    Attributes:
        name: ``nominal`` or ``calibrated``.
        arm: the arm, or the robot with its chains.
        values: of its parameters by name, m or rad; nominal where not given.
        meshes: shapes of its links; none where no file of them was found.
    """

    name: str
    arm: AnyArm
    values: Mapping[str, float]
    meshes: tuple[LinkMesh, ...] = ()

    @cached_property
    def _model(self) -> pin.Model:
        tree = read_tree(self.arm.urdf[0], self.arm.calibrated_urdf(self.values))
        every = placed_joints(self.arm)
        return pinocchio_model(tree, {joint.name for joint, _ in every if joint.moving})

    @cached_property
    def links(self) -> tuple[str, ...]:
        """Names of all links, in the URDF's order."""
        return read_tree(*self.arm.urdf).links

    @cached_property
    def bones(self) -> IntArray:
        """(n, 2) the two links of every joint of the chains, base → tip, by number in `links`."""
        at = {link: k for k, link in enumerate(self.links)}
        bones = [(at[joint.parent], at[joint.child]) for joint, _ in placed_joints(self.arm)]
        return np.array(bones, dtype=np.intp)

    @property
    def base(self) -> str:
        """The link in whose frame all is drawn: the base of the first chain."""
        return self.arm.chained[0].base

    def poses(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """``T_base_link`` of all `links` at readings (joints,), rad or m.

        Returns:
            Rotations (links, 3, 3) and positions (links, 3), m.
        """
        model, data = self._model, self._data
        pin.framesForwardKinematics(model, data, configuration_of(model, self.arm.motions(q)))
        base, *links = (
            data.oMf[model.getFrameId(link, pin.FrameType.BODY)]
            for link in (self.base, *self.links)
        )
        placed = [base.actInv(link) for link in links]
        return np.array([p.rotation for p in placed]), np.array([p.translation for p in placed])

    @cached_property
    def _data(self) -> pin.Data:
        return self._model.createData()
