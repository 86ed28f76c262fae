"""An accelerometer that is strapped to the tip's link of an emulated arm, as a phone is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.emulation.motion import ExtraNumbers, Motion
from suta_calib.errors import InputError
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.model.arm import ArmModel
from suta_calib.simulation.leaning import FELT_AT_REST
from suta_calib.simulation.noise import stream
from suta_calib.units import from_deg

COLUMNS: Final = ("ax", "ay", "az")


def accelerometer(
    arm: ArmModel,
    values: Mapping[str, float],
    motion: Motion,
    *,
    mounting: FloatArray | None = None,
    noise: float = from_deg(0.2),
    seed: int = 0,
) -> ExtraNumbers:
    """What one on the tip's link feels, in m/s²: gravity, and how the tip is accelerated.

    Args:
        arm: the nominal arm.
        values: its true parameters, m or rad.
        motion: what the arm does; must end.
        mounting: (3, 3) of the sensor in the frame of the tip; its axes by default.
        noise: standard deviation of the direction about each axis, rad: of a reading, and of what
            all readings of one rest have in common.
        seed: of the latter.

    Raises:
        InputError: a motion without an end.
    """
    end = motion.end
    if not np.isfinite(end):
        posture = motion.readings(np.array([0.0, 1.0]))
        if np.any(posture[0] != posture[1]):
            raise InputError("a motion without end", "one that ends", where="--accelerometer")
        end = 0.0
    # A bit longer than the motion: after it the arm rests.
    # s; a motion between two rests lasts many times as long.
    interval = 0.02
    time = np.arange(0.0, end + 5 * interval, interval)
    q = motion.readings(time)
    rotation, position = arm.forward(q, values)
    force = np.zeros_like(position)
    force[1:-1] = np.diff(position, 2, axis=0) / interval**2
    force[:, 2] += FELT_AT_REST
    sensor = rotation if mounting is None else rotation @ mounting
    felt = (sensor.transpose(0, 2, 1) @ force[:, :, None])[:, :, 0]
    # A rest is where nothing moves from one moment to the next.
    moving = np.concatenate([[True], np.any(np.diff(q, axis=0) != 0.0, axis=1)])
    rest = np.cumsum(moving & ~np.concatenate([[False], moving[:-1]]))
    tilts = noise * stream(seed, "accelerometer").standard_normal((int(rest[-1]) + 1, 3))
    felt = (rotation_from_vector(tilts[rest]) @ felt[:, :, None])[:, :, 0]
    return ExtraNumbers(COLUMNS, time, felt, noise * FELT_AT_REST)
