"""Links that lean at random, and what tilt sensors on them feel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.model.arm import ArmModel

# What an accelerometer at rest feels, m/s².
FELT_AT_REST: Final = 9.81


def up_in_links(
    arm: ArmModel,
    q: FloatArray,
    values: Mapping[str, float],
    lean: float,
    random: np.random.Generator,
) -> dict[str, FloatArray]:
    """What ideal sensors feel in postures q (n, joints): (n, 3), by what their readings are called.

    Args:
        arm: with the sensors, whose axes are those of their links.
        q: readings.
        values: the truth, by name.
        lean: standard deviation of a link's lean about either horizontal axis, rad.
        random: where the leans come from.
    """
    felt = dict[str, FloatArray]()
    for sensor in arm.tilt_sensors:
        rotation, _ = arm.link_poses(sensor.link, q, values)
        leaning = lean * random.standard_normal((len(q), 3))
        leaning -= np.outer(leaning @ arm.up, arm.up)
        shown = rotation_from_vector(-leaning) @ arm.up
        felt[sensor.felt] = FELT_AT_REST * np.einsum("nij,ni->nj", rotation, shown)
    return felt


def as_felt(
    felt: Mapping[str, FloatArray], noise: float, random: np.random.Generator
) -> dict[str, FloatArray]:
    """Readings with noise, rad of each component of the direction."""
    return {
        name: vectors + FELT_AT_REST * noise * random.standard_normal(vectors.shape)
        for name, vectors in felt.items()
    }
