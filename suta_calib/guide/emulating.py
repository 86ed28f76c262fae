"""An emulated arm for whoever wants to try the page without an arm."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from suta_calib.emulation.emulated import EmulatedDevice, EmulationOptions, emulated_device
from suta_calib.emulation.emulated_arm import EmulatedArm
from suta_calib.emulation.motion import Stops
from suta_calib.emulation.trajectories import posture_of
from suta_calib.errors import JobError
from suta_calib.geometry.numbers import wrap
from suta_calib.job.outline import read_outline
from suta_calib.job.standing_elsewhere import job_for_other_samples
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import InverseKinematics, PoseSpec
from suta_calib.simulation.noise import stream
from suta_calib.units import shown


def job_to_try(job: Path) -> Path:
    """A copy of a job beside it, in the folder ``emulated``, whose samples are emulated ones.

    Raises:
        JobError: the job cannot be read.
        OutputError: the copy cannot be written.
    """
    return job_for_other_samples(job, job.parent / "emulated" / job.name)


@contextmanager
def emulated_arm(
    job: Path,
    labels: Mapping[str, str],
    rests: int,
    place: PoseSpec | None,
    sequence: tuple[str, ...],
) -> Iterator[Path]:
    """Within it an arm is brought to the places of one label; gives its ``device.yaml``.

    It begins elsewhere, as an arm does that somebody takes up.

    Raises:
        InputError: a job whose places cannot be emulated, or reached.
    """
    outline = read_outline(job)
    ((kind, label),) = labels.items()
    # Of the errors of the arm that is emulated.
    options = EmulationOptions(
        outline.urdf(), script=job, errors_seed=1, seed=zlib.crc32(label.encode())
    )
    if kind == "placement":
        options = replace(options, placements={label: place}, sequence=sequence)
    else:
        options = replace(options, directions=rests)
        options = replace(options, points={label: place or _point_within_reach(options, label)})
    emulation = _near_each_other(options).emulation
    motion = emulation.motion
    assert isinstance(motion, Stops)
    away = motion.posture[0] + 0.1
    taken_up = replace(
        motion,
        posture=np.vstack([away, motion.posture]),
        labels=({}, *motion.labels),
        rounds=(len(motion.posture),),
    )
    with EmulatedArm(replace(emulation, motion=taken_up), patient=True) as arm:
        yield arm.write_device(job.parent / "device.yaml")


def _point_within_reach(options: EmulationOptions, label: str) -> PoseSpec:
    """A point that the arm can touch from all sides that are asked for.

    Raises:
        JobError: none was found.
    """
    tries = 30
    outline = read_outline(options.script) if options.script is not None else None
    assert outline is not None
    arm = ArmModel.from_urdf(options.urdf, *outline.one(options.chain))
    random = stream(options.seed, label, "point")
    readings = InverseKinematics(arm, {}).random_readings(random, tries)
    _, tips = arm.forward(posture_of(arm) + 0.5 * (readings - posture_of(arm)))
    failed: JobError | None = None
    for tip in tips[tips[:, 2] > 0]:
        place = PoseSpec(np.eye(3), np.round(tip, 3))
        try:
            emulated_device(replace(options, points={label: place}))
        except JobError as error:
            failed = error
        else:
            return place
    raise failed or JobError("no point above the base", "an arm that reaches one")


def _near_each_other(options: EmulationOptions) -> EmulatedDevice:
    """The arm in postures near the first one: nobody turns an arm over between two landmarks."""
    found = emulated_device(options)
    assert found.plan is not None
    assert isinstance(found.emulation.motion, Stops)
    arm, first = found.arm, found.emulation.motion.posture[0]
    units = [arm.units[joint] for joint in arm.joints]
    first = np.where([unit == "rad" for unit in units], wrap(first), first)
    readings = (
        f"{joint}={shown(float(reading), unit):.3f}"
        for joint, reading, unit in zip(arm.joints, first, units, strict=True)
    )
    places = dict(found.plan.places)
    near = replace(options, posture=",".join(readings))
    if options.placements:
        return emulated_device(replace(near, placements=places))
    return emulated_device(replace(near, points=places))
