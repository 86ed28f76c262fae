"""Pose and uncertainty of the tip for one reading, compiled: some ten microseconds."""

from __future__ import annotations

from typing import Any, Final

import casadi as ca
import numpy as np
import pinocchio as pin

from suta_calib.arrays import FloatArray
from suta_calib.batched import Batched
from suta_calib.geometry.symbols import Symbol, symbolic_skew
from suta_calib.model.arm import ArmModel
from suta_calib.tracking.tool import Tool
from suta_calib.tracking.uncertainty import CalibrationUncertainty

_NOTHING: Final = Tool.none()


class TipKinematics:
    """``T_base_tip`` of a calibrated arm with a tool, and how far it may be off.

    The variance of the tip's position is ``J C Jᵀ + R C_tool Rᵀ``, with J the tip's Jacobian by the
    arm's parameters at this very posture, C the calibration's covariance and C_tool the tool's.
    It says nothing of parameters the calibration held, nor of the encoders' noise.

    Args:
        arm: the calibrated arm, for raw readings.
        tool: where the tool's tip is; the arm's own tip by default.
        uncertainty: of the calibration that wrote the arm's URDF; what that could not hold
            (eccentric encoders, yielding joints) is corrected from it.

    Raises:
        InputError: the uncertainty is not this arm's.
    """

    def __init__(
        self,
        arm: ArmModel,
        tool: Tool = _NOTHING,
        uncertainty: CalibrationUncertainty | None = None,
    ) -> None:
        self.has_std = uncertainty is not None
        self._run = Batched(_compiled(arm, tool, uncertainty), 1)

    def __call__(self, angles: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        """Rotation (3, 3), position (3,) m and its standard uncertainty (3,) m along base axes.

        Args:
            angles: (joints,) readings in the order of the arm's joints, rad.
        """
        run = self._run
        run.inputs[0][0] = angles
        flat, position, std = run()
        rotation = flat.reshape(3, 3).T.copy()
        return rotation, position[0].copy(), std[0].copy() if self.has_std else None


def quaternion(rotation: FloatArray) -> FloatArray:
    """Quaternion x y z w (4,) of a rotation matrix (3, 3), w ≥ 0."""
    found = np.asarray(pin.Quaternion(rotation).coeffs(), dtype=float)
    return -found if found[3] < 0 else found


def _compiled(arm: ArmModel, tool: Tool, uncertainty: CalibrationUncertainty | None) -> Any:
    """CasADi function: readings → rotation (9, column by column), position (3), std (3)."""
    names, factor = ((), np.zeros((0, 0))) if uncertainty is None else uncertainty.folded(arm)
    beside = {} if uncertainty is None else uncertainty.beside_geometry
    nominal = ca.DM([beside.get(name, arm.offered[name].nominal) for name in names])
    q = ca.SX.sym("q", len(arm.joints))
    flat, tip, jacobian = arm.function(names)(nominal, q)
    R = ca.reshape(flat, 3, 3)
    lever = R @ ca.DM(tool.tip)
    by_error = (jacobian[:, :3].T - symbolic_skew(lever) @ jacobian[:, 3:].T) @ ca.DM(factor)
    std = ca.sqrt(_row_squares(by_error) + _tool_variance(R, tool))
    outputs = [ca.densify(o) for o in (flat, tip + lever, std)]
    return ca.Function("tip", [q], outputs, ["q"], ["rotation", "position", "std"], {"cse": True})


def _tool_variance(R: Symbol, tool: Tool) -> Symbol:
    return ca.DM.zeros(3, 1) if tool.std is None else _row_squares(R @ ca.diag(ca.DM(tool.std)))


def _row_squares(matrix: Symbol) -> Symbol:
    """Sum of squares of each row; zeros where there is no column."""
    return ca.sum2(matrix**2) if matrix.shape[1] else ca.DM.zeros(3, 1)
