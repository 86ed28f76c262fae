"""How tilt sensors are mounted in their links: such that on average they agree with the model.

A constant error of a mounting turns a link by a constant amount, which the placements of the joints
behind it take up, and one of what is up in the base turns all of the arm, which what stands outside
takes up. So neither is estimated with the geometry. With R the orientation of the link of a sensor
as the model has it, nothing leaning, they are those with the least

    Σ |Rᵀ u - S a|²

over all rows of all sensors: u common, S for each. What no row shows stays: the lean of the base
where no link turns against gravity, and a turn of a sensor about the vertical.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import (
    nearest_rotation,
    rotation_from_rpy,
    rotation_from_vector,
    skew,
    vector_from_rotation,
)
from suta_calib.model.arm import ArmModel
from suta_calib.model.robot import Robot, same_chain
from suta_calib.model.tilt import MOUNT, UP, TiltSensor
from suta_calib.terms.poses import ArmPoses
from suta_calib.terms.term import Term

_AnyArm = TypeVar("_AnyArm", ArmModel, Robot, ArmModel | Robot)


def over_mounted(arm: ArmModel | Robot, terms: Sequence[Term]) -> tuple[Term, ...]:
    """Terms over an arm as terms over the same arm at other values."""
    return tuple(
        term.over_poses(ArmPoses(same_chain(term.poses.arm, arm), term.poses.samples))
        if isinstance(term.poses, ArmPoses)
        else term
        for term in terms
    )


def with_sensors_mounted(arm: _AnyArm, terms: Sequence[Term]) -> _AnyArm:
    """The arm, with the mountings of its sensors and what is up as samples have them."""
    poses = [term.poses for term in terms if isinstance(term.poses, ArmPoses)]
    by_sensor = dict[TiltSensor, list[tuple[FloatArray, FloatArray]]]()
    for arm_poses in poses:
        for link in arm_poses.arm.tilted if "tilt" in arm_poses.conditions else ():
            felt = arm_poses.conditions["tilt"][:, link.column : link.column + 3]
            rows = np.flatnonzero(felt.any(axis=1))
            if len(rows):
                q = arm_poses.samples.q[rows]
                rotation, _ = arm_poses.arm.link_poses(link.sensor.link, q)
                in_root = arm_poses.arm.root_axes @ rotation
                by_sensor.setdefault(link.sensor, []).append((in_root, felt[rows]))
    if not by_sensor:
        return arm
    up = next(
        arm_poses.arm.root_axes @ arm_poses.arm.up for arm_poses in poses if arm_poses.arm.tilted
    )
    data = {s: tuple(map(np.concatenate, zip(*d, strict=True))) for s, d in by_sensor.items()}
    lean, mounts = agreeing(up, data)
    nominal = dict(zip(UP, vector_from_rotation(lean).tolist(), strict=True))
    for sensor, mount in mounts.items():
        vector = vector_from_rotation(mount)
        nominal |= dict(zip(sensor.names(*MOUNT), vector.tolist(), strict=True))
    return arm.at(nominal)


def agreeing(
    up: FloatArray, data: dict[TiltSensor, tuple[FloatArray, ...]]
) -> tuple[FloatArray, dict[TiltSensor, FloatArray]]:
    """The lean of "up" (3, 3), and how each sensor is mounted (3, 3).

    Of orientations of the links (n, 3, 3) and unit vectors that were felt (n, 3).
    """
    lean, mounts = np.eye(3), dict[TiltSensor, FloatArray]()
    # Weight, beside a row's, of what was said, rad⁻²: leans of some degrees tell more.
    weight_of_said = 1e-3
    for sensor, (rotation, felt) in data.items():
        stated = np.eye(3) if sensor.rpy is None else rotation_from_rpy(sensor.rpy)
        together = np.einsum("nji,j,nk->ik", rotation, up, felt) / len(felt)
        # Where it hangs upside down, what was said does not tell about which axis.
        mounts[sensor] = nearest_rotation(together + weight_of_said * stated)
    # The two ways to lean, and three for each sensor: leans of degrees take a few steps.
    across = np.linalg.svd(up[None])[2][1:].T
    for _ in range(5):
        at = lean @ up
        normal = np.diag([1e-9] * 2 + [weight_of_said] * (3 * len(data)))
        side = np.zeros(len(normal))
        for k, (sensor, (rotation, felt)) in enumerate(data.items()):
            in_link, shown = at @ rotation, felt @ mounts[sensor].T
            columns = np.zeros((len(felt), 3, len(normal)))
            columns[:, :, :2] = np.einsum("nji,jk->nik", rotation, -skew(at) @ across)
            columns[:, :, 2 + 3 * k : 5 + 3 * k] = [skew(v) for v in shown]
            flat, off = columns.reshape(-1, len(normal)), (shown - in_link).reshape(-1)
            normal += flat.T @ flat / len(felt)
            side += flat.T @ off / len(felt)
        step = np.linalg.solve(normal, side)
        lean = rotation_from_vector(across @ step[:2]) @ lean
        mounts = {
            sensor: rotation_from_vector(step[2 + 3 * k : 5 + 3 * k]) @ mount
            for k, (sensor, mount) in enumerate(mounts.items())
        }
    return lean, mounts
