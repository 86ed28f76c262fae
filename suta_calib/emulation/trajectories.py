"""Trajectories of the joints: swings within the joints' limits, or given in a file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.emulation.motion import Curve, Sweep, continuous
from suta_calib.errors import InputError, did_you_mean
from suta_calib.measurements.csv_table import read_csv_table
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import InverseKinematics
from suta_calib.simulation.noise import full_circle

# A prismatic joint swings by this much for every rad of the others.
_M_PER_RAD: Final = 0.2


def posture_of(arm: ArmModel, readings: Mapping[str, float] | None = None) -> FloatArray:
    """(joints,) readings: those given by joint, rad (m), the middle of the range for the others.

    Raises:
        InputError: a joint that the arm does not have, or a reading beyond its limits.
    """
    posture = InverseKinematics(arm, {}).middle
    for name, reading in (readings or {}).items():
        if name not in arm.joints:
            raise InputError(
                f"no joint {name!r}",
                f"one of {', '.join(arm.joints)}",
                where="posture",
                hint=did_you_mean(name, arm.joints),
            )
        joint = arm.chain.moving[arm.joints.index(name)]
        if not joint.lower <= reading <= joint.upper:
            limits = f"{joint.lower:.4g} to {joint.upper:.4g}"
            raise InputError(f"{reading:.4g} for {name!r}", limits, where="posture")
        posture[arm.joints.index(name)] = reading
    return posture


def sweep(
    arm: ArmModel,
    posture: FloatArray | None = None,
    *,
    amplitude: float = math.radians(20),
    slowest: float = 0.05,
    fastest: float = 0.5,
    duration: float = 60.0,
) -> Sweep:
    """All joints swinging about a posture; see `Sweep`.

    Args:
        arm: whose joints swing.
        posture: (joints,) in the middle of the swings; the middle of the ranges by default.
        amplitude: rad; less where a joint's limits are nearer, 0.2 m per rad for prismatic joints.
        slowest: frequency at the start, Hz.
        fastest: at the end, Hz.
        duration: s.
    """
    middle = posture_of(arm) if posture is None else posture
    prismatic = np.array([joint.type == "prismatic" for joint in arm.chain.moving])
    limits = np.array([(joint.lower, joint.upper) for joint in arm.chain.moving])
    room = np.minimum(middle - limits[:, 0], limits[:, 1] - middle)
    room = np.where(full_circle(arm), np.inf, room)
    wanted = np.where(prismatic, _M_PER_RAD * amplitude, amplitude)
    return Sweep(middle, np.minimum(wanted, room), slowest, fastest, duration)


def recorded(path: Path, arm: ArmModel) -> Curve:
    """A trajectory from a CSV file: ``time`` in s, and a column for each joint, rad (m).

    Raises:
        SamplesError: the file cannot be read, lacks a column, or its times do not increase.
    """
    table = read_csv_table(path)
    time = table.numbers("time", "times in s")
    for row in np.flatnonzero(np.diff(time) <= 0):
        raise table.refuse(int(row) + 1, "time", f"{time[row + 1]:g}", f"more than {time[row]:g}")
    if len(time) == 1:
        raise table.refuse(0, "time", "one row", "two or more")
    posture = np.stack([table.numbers(name, "readings in rad or m") for name in arm.joints], axis=1)
    return Curve(time - time[0], continuous(posture, full_circle(arm)))


def parse_posture(arm: ArmModel, text: str) -> dict[str, float]:
    """``joint_1=15,joint_3=160`` in degrees (mm), or one number per joint: rad (m) by joint.

    Raises:
        InputError: something that is neither.
    """
    parts = [part.strip() for part in text.split(",") if part.strip()]
    named = [part.partition("=") for part in parts]
    if not any(equals for _, equals, _ in named) and len(parts) == len(arm.joints):
        named = [(joint, "=", part) for joint, part in zip(arm.joints, parts, strict=True)]
    return {name.strip(): _si(arm, name.strip(), equals, value) for name, equals, value in named}


def _si(arm: ArmModel, name: str, equals: str, value: str) -> float:
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not (equals and math.isfinite(number)):
        raise InputError(
            repr(f"{name}{equals}{value}"),
            f"JOINT=DEGREES, or {len(arm.joints)} numbers",
            where="posture",
        )
    prismatic = [joint.name for joint in arm.chain.moving if joint.type == "prismatic"]
    return 1e-3 * number if name in prismatic else math.radians(number)
