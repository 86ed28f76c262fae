"""How far links lean by what accelerometers on them felt, and what that does to the tip."""

from __future__ import annotations

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rms_length
from suta_calib.measurements.felt import up_felt
from suta_calib.model.arm import ArmModel
from suta_calib.model.tilt import TiltSensor
from suta_calib.solver.sensor_mounts import agreeing
from suta_calib.terms.poses import ArmPoses
from suta_calib.trust.examination import Examination


def lean_of(
    answer: Examination, poses: ArmPoses, felt_name: str, link: str
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """By how much a link leans (n, 3), in the base, rad, about its mean; its pose, m.

    The pose is the orientation (n, 3, 3) and the position (n, 3) as the answer has them, nothing
    leaning. The sensor is taken to be mounted such that it agrees with it on average.
    """
    arm, felt = poses.arm, up_felt(poses.samples.felt[felt_name])
    values = answer.problem.values(answer.x)
    of_arm = {n: v for n, v in values.items() if n in arm.offered}
    rotation, position = arm.link_poses(link, poses.samples.q, of_arm)
    there, sensor = felt.any(axis=1), TiltSensor(link)
    turn, mounts = agreeing(arm.up, {sensor: (rotation[there], felt[there])})
    shown = np.einsum("nij,jk,nk->ni", rotation, mounts[sensor], felt)
    return np.cross(shown, turn @ arm.up), rotation, position


def moved_by(arm: ArmModel, lean: FloatArray, levers: FloatArray) -> FloatArray:
    """(n, 6, 2) what a lean (n, 3) does to a tip (n, 3) away: as it is, and turned about "up"."""
    both = np.stack([lean, np.cross(arm.up, lean)], axis=2)
    shift = np.cross(both, levers[:, :, None], axis=1)
    return np.concatenate([shift, both], axis=1)


def tip_moved(velocity: FloatArray, size: FloatArray) -> float:
    """RMS, m, of what an effect of a size (k,) does to the tips, by velocities (n, 6, k)."""
    return rms_length(velocity[:, :3] @ size)
