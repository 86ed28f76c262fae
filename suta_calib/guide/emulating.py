"""An emulated arm for whoever wants to try the page without an arm."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from suta_calib.acquisition.measuring import MeasureOptions
from suta_calib.acquisition.touch_sequence import Station, kinds_of, read_row
from suta_calib.arrays import FloatArray
from suta_calib.device.device_file import device_text
from suta_calib.emulation.accelerometer import COLUMNS, accelerometer
from suta_calib.emulation.emulated import EmulatedDevice, EmulationOptions, emulated_device
from suta_calib.emulation.emulated_arm import EmulatedArm
from suta_calib.emulation.motion import Stops
from suta_calib.emulation.stream import EMULATED
from suta_calib.emulation.trajectories import posture_of
from suta_calib.errors import JobError
from suta_calib.geometry.numbers import wrap
from suta_calib.job.outline import read_outline
from suta_calib.job.standing_elsewhere import job_for_other_samples
from suta_calib.measurements import write_text
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import InverseKinematics, PoseSpec
from suta_calib.simulation.noise import stream
from suta_calib.terms import KINDS
from suta_calib.units import shown


def job_to_try(job: Path) -> Path:
    """A copy of a job beside it, in the folder ``emulated``, whose samples are emulated ones.

    Raises:
        JobError: the job cannot be read.
        OutputError: the copy cannot be written.
    """
    return job_for_other_samples(job, job.parent / "emulated" / job.name)


def emulated_sensors(measuring: MeasureOptions) -> Path:
    """The ``device.yaml`` of the arm that will be emulated: a port that is there when it is.

    Raises:
        InputError: a job whose arm cannot be emulated.
        OutputError: the file cannot be written.
    """
    device = emulated_device(replace(_sensors(measuring), motion="still")).emulation.device
    file = measuring.job.parent / "device.yaml"
    write_text(file, device_text(replace(device, port=str(_port(measuring))), EMULATED))
    return file


def _port(measuring: MeasureOptions) -> Path:
    return measuring.job.absolute().parent / "port"


def _sensors(measuring: MeasureOptions) -> EmulationOptions:
    """The arm at rest: with an accelerometer on the tip where an observation is made of that."""
    outline = read_outline(measuring.job)
    tip, base = outline.one(measuring.chain)
    named = " ".join(measuring.labels.values()) or measuring.repeat
    seed = zlib.crc32(named.encode())
    # Of the errors of the arm that is emulated.
    options = EmulationOptions(outline.urdf(), tip, base, errors_seed=1, seed=seed)
    kinds = [KINDS[row.kind] for row in outline.rows if row.kind in KINDS]
    if measuring.free and any(kind.sent and {*kind.sent} <= {*COLUMNS} for kind in kinds):
        # As a phone and a microcontroller send them together: as text, and not as often.
        text_rate = 200.0
        options = replace(options, form="lines", unit="rad", rate=text_rate)
        options = replace(options, accelerometer=np.eye(3))
    return options


@contextmanager
def emulated_arm(
    measuring: MeasureOptions, place: PoseSpec | None, left: Sequence[Station]
) -> Iterator[FloatArray]:
    """Within it an arm is brought to the places that are left to measure (`emulated_sensors`).

    It begins elsewhere, as an arm does that somebody takes up.

    Yields:
        Its (rests, joints) true readings at these places.

    Raises:
        InputError: a job whose places cannot be emulated, or reached.
    """
    options = replace(_sensors(measuring), directions=len(left))
    if measuring.free:
        found = emulated_device(replace(options, motion="postures"))
    else:
        ((sort, label),) = measuring.labels.items()
        options = replace(options, script=measuring.job, chain=measuring.chain)
        given = read_row(
            measuring.job, measuring.observation, kinds_of(sort), measuring.chain
        ).given
        if place is None and (known := given.get(label)) is not None:
            # It stands where the job says.
            turned = np.eye(3) if known.rotation is None else known.rotation
            place = PoseSpec(turned, known.position)
        if sort == "placement":
            names = tuple(station.name for station in left)
            options = replace(options, placements={label: place}, sequence=names)
        else:
            point = place or _point_within_reach(options, label)
            options = replace(options, points={label: point})
        found = _near_each_other(options)
    emulation = found.emulation
    motion = emulation.motion
    assert isinstance(motion, Stops)
    away = motion.posture[0] + 0.1
    taken_up = replace(
        motion,
        posture=np.vstack([away, motion.posture]),
        labels=({}, *motion.labels),
        rounds=(len(motion.posture),),
    )
    extra = None
    if options.accelerometer is not None:
        extra = accelerometer(found.arm, found.values, taken_up, seed=options.seed)
    emulation = replace(emulation, motion=taken_up, extra=extra)
    with EmulatedArm(emulation, link=_port(measuring), patient=True):
        yield motion.posture


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
