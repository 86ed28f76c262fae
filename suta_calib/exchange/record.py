"""Everything a result says of an arm and of poses, as plain names and arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from suta_calib.exchange.result import Result


def record(result: Result) -> dict[str, Any]:
    """Values, covariance, origins and poses by key; arrays, and lists of names. m and rad."""
    entries: dict[str, Any] = {}
    if result.arm is not None:
        calibration, model = result.arm.calibration, result.arm.model
        entries |= {
            "joints": list(model.joints),
            "parameters": list(calibration.values),
            "values": np.array([*calibration.values.values()]),
            "estimated": list(calibration.names),
            "covariance": calibration.covariance,
            "origins": list(result.arm.origins),
            "T_parent_joint": np.array([*result.arm.origins.values()]),
        }
    poses = (*result.transforms, *(() if result.arm is None else (result.arm.tool,)))
    return entries | {
        "poses": [f"T_{pose.parent}_{pose.child}" for pose in poses],
        "T": np.array([pose.matrix for pose in poses]).reshape(-1, 4, 4),
    }
