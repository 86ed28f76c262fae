"""Simulated points in two frames."""

from __future__ import annotations

from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import vector_from_rotation
from suta_calib.pose_calibration.registration import Registration
from suta_calib.terms import TrackedPoint
from suta_calib.terms.synthetic import PoseNoise, Simulated

NOISE = PoseNoise(3e-4)
NATURES = ("wrong", "slipped", "swapped")
Points = tuple[FloatArray, FloatArray]


def simulate(count: int, **more: Any) -> tuple[Simulated[TrackedPoint], FloatArray, FloatArray]:
    """Simulated data, the points in the first frame and in the second."""
    data = TrackedPoint.simulate(count, **more)
    return data, data.poses[1], data.seen[1]


def error_of(found: Registration, data: Simulated[TrackedPoint]) -> FloatArray:
    """Displacement (m) and turn (rad) of the moved points about their middle, (6,)."""
    R, p = data.true_pose("base")
    middle = R.T @ (found.centre - p)
    turn = vector_from_rotation(found.rotation @ R.T)
    return np.concatenate([found.act(middle) - found.centre, turn])


def at_points(found: Registration, data: Simulated[TrackedPoint]) -> float:
    """Root mean square error at the points, m."""
    R, p = data.true_pose("base")
    points = data.poses[1]
    return float(np.sqrt(np.mean(np.sum((found.act(points) - points @ R.T - p) ** 2, axis=1))))
