"""A place for an artefact where the arm can touch all of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.emulation.trajectories import posture_of
from suta_calib.errors import JobError
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.measurements import Artefact, read_artefact
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import InverseKinematics, PoseSpec, Targets
from suta_calib.simulation.noise import stream
from suta_calib.terms.landmark import seated

_TRIES: Final = 300
_STARTS: Final = 3


def placement_within_reach(
    arm: ArmModel,
    values: Mapping[str, float],
    artefact: Path,
    label: str,
    *,
    posture: FloatArray | None = None,
    seed: int = 0,
) -> PoseSpec:
    """An upright pose of an artefact, drawn at random, in which every landmark can be reached.

    Args:
        arm: the nominal arm.
        values: its true parameters, m or rad.
        artefact: the artefact's file.
        label: of the placement; others are drawn for other labels.
        posture: (joints,) readings about which it is looked for; the middle of the ranges.
        seed: of the pose.

    Raises:
        JobError: none was found.
    """
    rng = stream(seed, label, "placement")
    kinematics = InverseKinematics(arm, values)
    start = posture_of(arm) if posture is None else posture
    read = read_artefact(artefact)
    near = start + 0.4 * (kinematics.random_readings(rng, _TRIES) - start)
    _, tips = arm.forward(near, values)
    for tip in tips:
        rotation = rotation_from_rpy([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
        centre = np.mean([mark.position for mark in read.landmarks.values()], axis=0)
        # Rounded to what somebody would write down, and not below the table the arm stands on.
        position = np.round(tip - rotation @ centre, 4)
        pose = PoseSpec(rotation, np.array([*position[:2], max(0.0, position[2])]))
        if _reached(kinematics, read, pose, start, rng):
            return pose
    raise JobError(
        f"no place for placement {label!r} in {_TRIES} tries",
        "an upright pose in which every landmark is within reach",
        file=artefact,
        hint=f"give one: --placement {label}=x,y,z,roll,pitch,yaw in mm and degrees",
    )


def _reached(
    kinematics: InverseKinematics,
    artefact: Artefact,
    pose: PoseSpec,
    start: FloatArray,
    rng: np.random.Generator,
) -> bool:
    """Whether every landmark can be: one after the other, for most poses fail at the first."""
    marks = sorted(artefact.landmarks.values(), key=lambda mark: mark.rotation is None)
    tips = seated(artefact, [mark.name for mark in marks], pose.rotation, pose.position)
    assert tips.rotation is not None
    targets = (
        Targets(p[None], R[None], "position" if mark.rotation is None else "pose")
        for mark, p, R in zip(marks, tips.position, tips.rotation, strict=True)
    )
    return all(kinematics.solve(each, start, rng, _STARTS).reached[0] for each in targets)
