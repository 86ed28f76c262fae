"""Everything that a result holds, as arrays by name: JSON, and NumPy's ``.npz``."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from suta_calib.exchange.option import Given
from suta_calib.exchange.result import Result, json_bytes
from suta_calib.exchange.writer import Writer


class JsonWriter(Writer):
    """Values, covariance, origins and poses; arrays as lists."""

    name = "json"
    summary = "JSON with values, covariance, origins and poses, m and rad"
    example = "results --format json --out arm.json"
    file = "exported.json"
    holds_covariance = True
    holds_everything = True

    def content(self, result: Result, _given: Given) -> bytes:
        """The object."""
        return json_bytes({key: array.tolist() for key, array in _arrays(result).items()})


class NumpyWriter(Writer):
    """The same, read back by ``numpy.load`` without pickles."""

    name = "numpy"
    summary = ".npz with values, covariance, origins and poses, m and rad"
    example = "results --format numpy --out arm.npz"
    file = "exported.npz"
    holds_covariance = True
    holds_everything = True

    def content(self, result: Result, _given: Given) -> bytes:
        """The archive."""
        stream = io.BytesIO()
        np.savez(stream, **_arrays(result))
        return stream.getvalue()


def _arrays(result: Result) -> dict[str, Any]:
    """Values, covariance, origins and poses by key, names beside them; m and rad."""
    entries: dict[str, Any] = {}
    if result.arm is not None:
        calibration, model = result.arm.calibration, result.arm.model
        entries |= {
            "joints": list(model.joints),
            "parameters": list(calibration.values),
            "values": [*calibration.values.values()],
            "estimated": list(calibration.names),
            "covariance": calibration.covariance,
            "origins": list(result.arm.origins),
            "T_parent_joint": [*result.arm.origins.values()],
        }
    poses = result.every_transform
    entries["poses"] = [f"T_{pose.parent}_{pose.child}" for pose in poses]
    entries["T"] = np.array([pose.matrix for pose in poses]).reshape(-1, 4, 4)
    return {key: np.asarray(value) for key, value in entries.items()}
