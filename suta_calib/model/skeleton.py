"""Where the joints of an arm are in one posture: what there is to draw of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from suta_calib.arrays import FloatArray
from suta_calib.plotting.scene import Line, PlacedPoints, Scene


@dataclass(frozen=True, eq=False)
class Skeleton:
    """An arm in one posture at nominal, in its base, m: joints (n, 3), base → tip; tip (3,).

    The axes (n, 3) are unit vectors that each joint turns about, or slides along.
    """

    joints: FloatArray
    axes: FloatArray
    tip: FloatArray

    @classmethod
    def of(
        cls, model: Any, base: str, names: tuple[str, ...], at: FloatArray, tip: FloatArray
    ) -> Skeleton:
        """By Pinocchio's forward kinematics."""
        data = model.createData()
        pin.framesForwardKinematics(model, data, at)
        jacobians = pin.computeJointJacobians(model, data, at)
        origin = data.oMf[model.getFrameId(base, pin.FrameType.BODY)]
        joints, axes = [], []
        for number in map(model.getJointId, names):
            joints.append(origin.actInv(data.oMi[number]).translation)
            column = jacobians[:, model.joints[number].idx_v]
            along = column[3:] if np.linalg.norm(column[3:]) > 0 else column[:3]
            axes.append(origin.rotation.T @ along / np.linalg.norm(along))
        return cls(np.reshape(joints, (-1, 3)), np.reshape(axes, (-1, 3)), tip)

    @property
    def points(self) -> FloatArray:
        """(n + 2, 3) origins of the base, of all that moves in between, and of the tip, m."""
        return np.vstack([np.zeros(3), self.joints, self.tip])

    def scene(self, name: str) -> Scene:
        """The links as a line, the joints' axes as short bars, and the tip."""
        # Of the arm's size, what is drawn of a joint's axis to either side.
        axis = 0.04
        half = axis * float(np.ptp(self.points, axis=0).max()) * self.axes
        # One line for all bars: what is not a number interrupts it.
        bars = np.stack(
            [self.joints - half, self.joints + half, np.full_like(half, np.nan)], axis=1
        )
        return Scene(
            (
                Line(name, "links", self.points),
                Line("joint axes", "axes", bars.reshape(-1, 3)[:-1]),
                PlacedPoints("tip", "tip", self.tip[None, :]),
            )
        )
