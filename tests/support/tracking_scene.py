"""What the tests of tracking share: readings, poses, a calibrated arm with known covariance."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from simulated import SUTA_URDF

from suta_calib.arrays import FloatArray
from suta_calib.device import Reading
from suta_calib.model.arm import ArmModel
from suta_calib.tracking.tracker import TipKinematics, TrackedPose, Tracker

TRUTH = {
    "joint_2.offset": 0.08,
    "joint_2.rx": 0.03,
    "joint_3.offset": -0.06,
    "joint_3.ry": -0.02,
    "joint_4.z": 0.574,
    "joint_4.rz": 0.01,
    "tip.y": 0.002,
    "tip.rz": 0.05,
}


def reading(
    angles: FloatArray,
    sequence: int = 0,
    *,
    at: float | None = None,
    error: tuple[int, ...] = (),
    warning: tuple[int, ...] = (),
) -> Reading:
    """One reading; ``at`` is the device's time, 1 ms per frame by default."""
    flags = np.zeros((2, len(angles)), dtype=np.bool_)
    flags[0, list(error)] = True
    flags[1, list(warning)] = True
    when = 1e-3 * sequence if at is None else at
    return Reading(sequence, when, np.asarray(angles), flags[0], flags[1], time.perf_counter())


def suta_tracker() -> Tracker:
    arm = ArmModel.from_urdf(SUTA_URDF, "tip")
    return Tracker(arm, arm.joints, TipKinematics(arm))


def poses(count: int, invalid: tuple[int, ...] = ()) -> list[TrackedPose]:
    """Poses of the SUTA on a random walk; some not valid."""
    tracker, rng = suta_tracker(), np.random.default_rng(0)
    walk = np.cumsum(1e-3 * rng.standard_normal((count, 6)), axis=0)
    return [
        tracker.pose(reading(q, k, error=(2,) if k in invalid else (), warning=(1,)))
        for k, q in enumerate(walk)
    ]


def with_play(position: FloatArray, play: FloatArray) -> FloatArray:
    """What encoders behind gears with play read: they stand until it is taken up."""
    read = np.empty_like(position)
    read[0] = position[0]
    for k in range(1, len(position)):
        read[k] = np.clip(read[k - 1], position[k] - play / 2, position[k] + play / 2)
    return read


@dataclass(frozen=True)
class Calibrated:
    """An arm with errors, its calibrated URDF, and a result that goes with it."""

    nominal: ArmModel
    arm: ArmModel
    covariance: FloatArray
    result: dict[str, Any]
    path: Path


def calibrated(folder: Path) -> Calibrated:
    """The SUTA with the errors of `TRUTH`, known with a random covariance."""
    nominal = ArmModel.from_urdf(SUTA_URDF, "tip")
    nominal.write_urdf(folder / "calibrated.urdf", TRUTH)
    rng = np.random.default_rng(4)
    factor = 1e-4 * rng.standard_normal((len(TRUTH), len(TRUTH)))
    covariance = factor @ factor.T
    std = np.sqrt(np.diag(covariance))
    parameters = {
        name: {
            "unit": nominal.parameters[name].unit,
            "nominal": nominal.parameters[name].nominal,
            "value": value,
            "std": float(std[k]),
            "state": "identified",
        }
        for k, (name, value) in enumerate(TRUTH.items())
    }
    parameters["joint_1.offset"] = {"value": 0.0, "std": None, "state": "unidentified"}
    result = {
        "status": "converged",
        "parameters": parameters,
        "unidentified": ["joint_1.offset", "placement[P1].x"],
        "covariance": {"parameters": list(TRUTH), "matrix": covariance.tolist()},
        "correlations": {
            "parameters": list(TRUTH),
            "matrix": (covariance / np.outer(std, std)).tolist(),
        },
    }
    path = folder / "result.json"
    path.write_text(json.dumps(result), encoding="utf-8")
    arm = ArmModel.from_urdf(folder / "calibrated.urdf", "tip")
    return Calibrated(nominal, arm, covariance, result, path)
