"""What the options of ``suta-calib emulate`` mean: the arm, its truth, its motion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.cli._emulate_options import EmulationOptions
from suta_calib.device.description import DeviceSpec
from suta_calib.emulation.device import device_of
from suta_calib.emulation.faults import Faults
from suta_calib.emulation.motion import Motion, Still
from suta_calib.emulation.script import (
    ScriptFile,
    Timing,
    artefact_set,
    parse_pose,
    placement_within_reach,
    point_set,
    read_script,
    stops,
)
from suta_calib.emulation.stream import Emulation
from suta_calib.emulation.trajectories import (
    parse_posture,
    pivoting,
    posture_of,
    recorded,
    sweep,
)
from suta_calib.emulation.truth import drawn_truth, nominal_values, read_truth
from suta_calib.errors import InputError
from suta_calib.measurements.suggestion import did_you_mean
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import NoiseLevels, PoseSpec, SetSpec
from suta_calib.simulation.schema import PostureRow

_RAD_PER_DEG: Final = math.pi / 180
_SIGNS: Final = {"1": 1, "+1": 1, "+": 1, "-1": -1, "-": -1}


@dataclass(frozen=True, eq=False)
class Emulated:
    """An emulated arm, and the truth behind it.

    Attributes:
        arm: the nominal arm.
        values: its true parameters, m or rad.
        plan: what a script touches.
        emulation: what it sends; its device has no port yet.
    """

    arm: ArmModel
    values: dict[str, float]
    plan: SetSpec | None
    emulation: Emulation


def build(options: EmulationOptions) -> Emulated:
    """The emulated arm that the options describe.

    Raises:
        InputError: options that contradict each other, or a file that cannot be used.
    """
    _check(options)
    faults = Faults.parse(",".join(options.faults))
    script = None if options.script is None else read_script(options.script)
    arm = _arm(options, script)
    device = _device(options, arm)
    faults.check_joints(device.names)
    values = _values(options, script, arm)
    plan = None
    if script is None:
        motion = _free_motion(options, arm, values)
    else:
        if script.simulation is None:
            plan = _job_plan(options, script, arm, values)
        else:
            plan = _set(options, script)
        motion = _script_motion(options, script, arm, values, plan)
    noise = _RAD_PER_DEG * options.encoder_deg
    emulation = Emulation(device, motion, options.rate, noise, faults, options.seed)
    return Emulated(arm, values, plan, emulation)


def _check(options: EmulationOptions) -> None:
    """Refuse options that the others leave without meaning."""
    if options.script is not None and (options.motion or options.csv):
        raise InputError("--script beside --motion or --csv", "one of them")
    if options.csv is not None and options.motion not in (None, "trajectory"):
        raise InputError(f"--csv beside --motion {options.motion}", "--motion trajectory")
    if options.script is None and options.placements:
        raise InputError("--placement without --script", "the job whose artefact is placed there")
    if options.script is None and options.points and options.motion != "pivot":
        raise InputError("--point without --script", "--script, or --motion pivot")


def _arm(options: EmulationOptions, script: ScriptFile | None) -> ArmModel:
    if options.tip is not None:
        return ArmModel.from_urdf(options.urdf, options.tip, options.base)
    if script is None:
        raise InputError("no tip", "--tip FRAME, the link or frame whose pose matters")
    return ArmModel.from_urdf(options.urdf, script.tip, options.base or script.base)


def _values(
    options: EmulationOptions, script: ScriptFile | None, arm: ArmModel
) -> dict[str, float]:
    seed = options.errors_seed
    if options.truth is not None:
        return read_truth(options.truth, arm, seed)
    if script is not None and script.simulation is not None:
        return read_truth(script.path, arm, seed)
    if seed is None:
        return nominal_values(arm)
    return drawn_truth(arm, seed, () if script is None else script.unknowns)


def _device(options: EmulationOptions, arm: ArmModel) -> DeviceSpec:
    words = [word.strip() for word in options.signs.split(",") if word.strip()]
    if not all(word in _SIGNS for word in words):
        raise InputError(repr(options.signs), "1 or -1 for each joint", where="--signs")
    return device_of(
        arm,
        form=options.form,
        unit=options.unit,
        counts_per_turn=options.counts_per_turn,
        signs=[_SIGNS[word] for word in words],
        baudrate=options.baudrate,
    )


def _set(options: EmulationOptions, script: ScriptFile) -> SetSpec:
    """A set of a simulation, with what the options change of it."""
    plan = script.set(options.set_name)
    if options.seating_mm is not None:
        plan = replace(plan, noise=replace(plan.noise, seating=1e-3 * options.seating_mm))
    if plan.kind == "fixed_point":
        chosen = _places(options.points, plan.points or {}, "--point")
        return replace(plan, points=chosen, directions=options.directions or plan.directions)
    chosen = _places(options.placements, plan.placements or {}, "--placement")
    return replace(plan, placements=chosen, repeats=options.repeats or plan.repeats)


def _job_plan(
    options: EmulationOptions, script: ScriptFile, arm: ArmModel, values: dict[str, float]
) -> SetSpec:
    """What a job's arm shall touch: the job itself does not say where anything stands."""
    seating = options.seating_mm
    noise = None if seating is None else NoiseLevels(seating=1e-3 * seating)
    if options.points:
        points = _places(options.points, {}, "--point")
        directions = options.directions or SetSpec.directions
        return point_set(points, directions, _RAD_PER_DEG * options.cone, noise)
    if script.artefact is None:
        raise InputError(
            "no artefact in the job",
            "--point F1=x,y,z of a fixed point, in mm in the base frame",
            file=script.path,
        )
    placements = {}
    for text in options.placements or ("P1",):
        if "=" in text:
            label, pose = parse_pose(text, "--placement")
        else:
            label = text
            pose = placement_within_reach(
                arm,
                values,
                script.artefact,
                label,
                seed=options.seed,
                posture=posture_of(arm, parse_posture(arm, options.posture)),
            )
        placements[label] = pose
    return artefact_set(script.artefact, placements, options.repeats or 1, noise)


def _places(
    texts: tuple[str, ...], known: Mapping[str, PoseSpec], where: str
) -> dict[str, PoseSpec]:
    """The places asked for, by label from those known or with a pose; those known by default."""
    chosen: dict[str, PoseSpec] = {}
    for text in texts:
        if "=" in text or not known:
            label, pose = parse_pose(text, where)
            chosen[label] = pose
        elif text in known:
            chosen[text] = known[text]
        else:
            names = ", ".join(known)
            raise InputError(
                repr(text), f"one of {names}", where=where, hint=did_you_mean(text, known)
            )
    return chosen or dict(known)


def _script_motion(
    options: EmulationOptions,
    script: ScriptFile,
    arm: ArmModel,
    values: dict[str, float],
    plan: SetSpec,
) -> Motion:
    posture = () if script.simulation is None else script.simulation.posture
    units = {name: arm.parameters[f"{name}.offset"].unit for name in arm.joints}
    # Checked here too: below, a wrong joint would be blamed on the script's file.
    given = parse_posture(arm, options.posture)
    posture_of(arm, given)
    posture += tuple(PostureRow(name, q, units[name]) for name, q in given.items())
    order = tuple(filter(None, (name.strip() for name in options.sequence.split(","))))
    return stops(
        arm,
        values,
        plan,
        seed=options.seed,
        sequence=order,
        posture=posture,
        timing=Timing(options.rest, options.move),
        path=script.path,
    )


def _free_motion(options: EmulationOptions, arm: ArmModel, values: dict[str, float]) -> Motion:
    if options.csv is not None:
        return recorded(options.csv, arm)
    posture = posture_of(arm, parse_posture(arm, options.posture))
    if options.motion == "pivot":
        return _pivot(options, arm, values, posture if options.posture else None)
    if options.motion == "trajectory":
        slowest, fastest = options.frequency
        return sweep(
            arm,
            posture,
            amplitude=_RAD_PER_DEG * options.amplitude,
            slowest=slowest,
            fastest=fastest,
            duration=options.duration,
        )
    return Still(posture)


def _pivot(
    options: EmulationOptions, arm: ArmModel, values: dict[str, float], posture: FloatArray | None
) -> Motion:
    if len(options.points) > 1:
        raise InputError(f"{len(options.points)} points", "one to pivot on", where="--point")
    points = [pose.position for pose in _places(options.points, {}, "--point").values()]
    return pivoting(
        arm,
        values,
        np.array(points[0]) if points else None,
        posture=posture,
        cone=_RAD_PER_DEG * options.cone,
        period=options.period,
        seed=options.seed,
    )
