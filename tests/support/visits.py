"""Simulated visits of the SUTA to one point."""

from __future__ import annotations

import math

import numpy as np
from simulated import arm_named, readings_for

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_rpy, rotation_from_vector
from suta_calib.measurements import Samples

POINT = np.array([0.4, 0.1, 0.05])
DOWN = rotation_from_rpy([math.pi, 0.0, 0.2])


def visits(
    n: int,
    size: float,
    seed: int = 0,
    tilt: float = 1e-3,
    at: FloatArray = POINT,
    **labels: list[str],
) -> Samples:
    """Simulated visits of the SUTA to one point, ``size`` (m) off along each axis."""
    arm, rng = arm_named("suta"), np.random.default_rng(seed)
    first = readings_for(arm, {}, at[None], DOWN[None])
    turn = rotation_from_vector(tilt * rng.standard_normal((n, 3)))
    position = at + size * rng.standard_normal((n, 3))
    q = readings_for(arm, {}, position, turn @ DOWN, np.repeat(first, n, axis=0))
    return Samples.from_arrays(arm.joints, q, labels=labels)
