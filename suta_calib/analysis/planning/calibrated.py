"""Inverse kinematics of an arm as it is known."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from suta_calib.model.arm import ArmModel
from suta_calib.simulation.inverse_kinematics import InverseKinematics


def calibrated_kinematics(arm: ArmModel, values: Mapping[str, float]) -> InverseKinematics:
    """Inverse kinematics of the arm with these values, for raw readings.

    The calibrated URDF is read back, so that nothing is differentiated by parameters: with the
    whole geometry unknown that is six times faster.

    Args:
        arm: the nominal arm.
        values: parameter values by name, m or rad; names of others are ignored.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / arm.chain.path.name
        arm.write_urdf(path, values)
        return InverseKinematics(ArmModel.from_urdf(path, arm.chain.tip, arm.chain.base), {})
