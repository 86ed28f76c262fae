"""From a simulation's description to samples, with the truth they were made from."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from suta_calib.arguments import checked
from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import JobError, ParameterError
from suta_calib.measurements import Artefact, Board, Corners, Samples, corners_of, read_artefact
from suta_calib.measurements.profiles import Profiles, profiles_of
from suta_calib.measurements.sample_files import check_joint_names
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import Parameter
from suta_calib.model.robot import AnyArm
from suta_calib.simulation.inverse_kinematics import InverseKinematics, Targets
from suta_calib.simulation.leaning import as_felt, up_in_links
from suta_calib.simulation.motion import MotionSpec, Passage, passage
from suta_calib.simulation.noise import (
    encoder_readings,
    full_circle,
    last_motions,
    outlier_displacements,
    readings_beside,
    remembers,
    scattered_rotations,
    stream,
    wrapped,
)
from suta_calib.simulation.protocol import TruePose, Visitor, Visits, own_values, true_poses
from suta_calib.simulation.schema import ErrorRow, SetSpec, SimulationSpec
from suta_calib.terms import ArmPoses, Observed, Setup
from suta_calib.terms.line_delay import rolled
from suta_calib.units import key
from suta_calib.words import seen_from


@dataclass(frozen=True, eq=False)
class SimulatedFile(Displayable):
    """One samples file.

    Attributes:
        path: relative to the output folder, such as ``calibration/P1.csv``.
        samples: what it holds; the origins name its lines.
        displacement: (n, 3) gross error of each row in the base's frame (what was seen from afar:
            in the instrument's or the camera's), m; zero for all but the outliers.
        corners: what a camera saw, and the path of its file; or None.
        profiles: what a line scanner saw, and the path of its file; or None.
    """

    path: str
    samples: Samples
    displacement: FloatArray
    corners: tuple[str, Corners] | None = None
    profiles: tuple[str, Profiles] | None = None

    @property
    def outliers(self) -> NDArray[np.intp]:
        """Numbers of the rows that are grossly wrong, from 0."""
        return np.flatnonzero(self.displacement.any(axis=1))


@dataclass(frozen=True, eq=False)
class Simulation(Displayable):
    """Simulated samples and the truth behind them.

    Attributes:
        spec: the description.
        seed: that was used.
        arm: the nominal arm, or the robot with its chains.
        values: true values of all its parameters, m or rad.
        outside: by the name of the set, the true poses of what stands outside the arm.
        artefacts: by the name of the set, the true artefact it was made with.
        files: the samples.
    """

    spec: SimulationSpec
    seed: int
    arm: AnyArm
    values: dict[str, float]
    outside: dict[str, tuple[TruePose, ...]]
    artefacts: dict[str, Artefact]
    files: tuple[SimulatedFile, ...]


@checked
def simulate(
    spec: SimulationSpec, seed: int | None = None, progress: Callable[[str], Any] = lambda _: None
) -> Simulation:
    """Simulate every set; the same specification and seed give the same numbers.

    Args:
        spec: what to simulate.
        seed: in place of the specification's.
        progress: called with the path of each file before it is made.

    Raises:
        JobError: a key contradicts the arm, or a target is out of reach.
        UrdfError, ArtefactError: a file it names cannot be used.
        SamplesError: a joint is called as a column of the samples.
    """
    seed = spec.seed if seed is None else seed
    arm = spec.arm.mechanism((plan.chain, plan.base_chain) for plan in spec.sets)
    values = true_values(arm, spec, seed)

    @cache
    def visitor_of(chain: str) -> Visitor:
        one = arm if isinstance(arm, ArmModel) else arm.chains[chain]
        kinematics = InverseKinematics(one, {n: v for n, v in values.items() if n in one.offered})
        return Visitor(spec, kinematics, _posture(spec, kinematics, arm), seed)

    visitors = {plan.name: visitor_of(seen_from(plan.chain, plan.base_chain)) for plan in spec.sets}
    for plan in spec.sets:
        joints = visitors[plan.name].kinematics.arm.joints
        check_joint_names(joints, plan.term.columns)
    certified = cache(read_artefact)  # of several sets one file
    artefacts = {
        p.name: _true_artefact(p, certified(p.artefact), seed)
        for p in spec.sets
        if p.artefact is not None
    }
    files: list[SimulatedFile] = []
    for plan in spec.sets:
        visitor = visitors[plan.name]
        for label in plan.places or ("samples",):
            progress(f"{plan.name}/{label}.csv")
            if plan.term.medium != "touch":
                files.append(_sighted_samples(plan, label, visitor.kinematics, seed))
                continue
            place, touched = plan.places[label], artefacts.get(plan.name)
            visits = (
                visitor.place(plan, label, place)
                if touched is None
                else visitor.artefact(plan, label, place, touched)
            )
            files.append(_touched(plan, visits, visitor))
    outside = {
        plan.name: true_poses(
            plan,
            visitors[plan.name].kinematics.arm,
            Samples.concatenate(parts),
            artefacts.get(plan.name),
            None
            if isinstance(arm, ArmModel)
            else arm.laid_out[seen_from(plan.chain, plan.base_chain)],
        )
        for plan in spec.sets
        for parts in [[f.samples for f in files if f.path.startswith(f"{plan.name}/")]]
    }
    return Simulation(spec, seed, arm, values, outside, artefacts, tuple(files))


def true_values(arm: AnyArm, spec: SimulationSpec, seed: int) -> dict[str, float]:
    """True values of all the arm's placements and offsets, nominal where no row names them.

    Gain, eccentricity, compliance and masses are among them only where a row gives them.

    A parameter's random number depends on the seed and its name alone, so a change to one row
    leaves the others' parameters as they were.

    Args:
        arm: the nominal arm, or the robot.
        spec: whose ``errors`` are applied; later rows win.
        seed: of the drawn errors.

    Returns:
        Values by name, m, rad, rad/(N·m), kg or 1, in the arm's order.

    Raises:
        JobError: a row selects nothing, or gives no size in the unit of one it selects, or makes a
            mass that is less than zero.
    """
    errors: dict[str, float] = {}
    for index, row in enumerate(spec.errors):
        try:
            names = arm.select(*row.select).names
        except ParameterError as problem:
            raise JobError.of(problem, spec.path, row.line, f"errors[{index}].select") from None
        # The word geometric and globs reach units that the row gives no size for.
        sized = {*row.value, *row.std}
        for name in names:
            if name in row.select or arm.offered[name].unit in sized:
                p, error = arm.offered[name], _error(arm.offered[name], row, index, seed, spec)
                if p.unit == "kg" and p.nominal + error < 0:
                    raise JobError(
                        f"a mass of {p.nominal + error:.3g} kg for {name}",
                        f"0 or more: the URDF has {p.nominal:g} kg, to which the error is added",
                        file=spec.path,
                        line=row.line,
                        where=f"errors[{index}]",
                    )
                errors[name] = error
    stated = [n for n in arm.offered if n in errors or n in arm.parameters]
    return {n: arm.offered[n].nominal + errors.get(n, 0.0) for n in stated}


def _error(
    parameter: Parameter, row: ErrorRow, index: int, seed: int, spec: SimulationSpec
) -> float:
    if parameter.unit in row.value:
        return row.value[parameter.unit]
    if parameter.unit in row.std:
        return row.std[parameter.unit] * float(stream(seed, parameter.name).standard_normal())
    raise JobError(
        f"no size of the error of {parameter.name}",
        f"{key('value', parameter.unit)} or {key('std', parameter.unit)}",
        file=spec.path,
        line=row.line,
        where=f"errors[{index}]",
    )


def _posture(spec: SimulationSpec, kinematics: InverseKinematics, robot: AnyArm) -> FloatArray:
    posture, arm = kinematics.middle, kinematics.arm
    for row in spec.posture:
        place: dict[str, Any] = {"file": spec.path, "line": row.line, "where": row.key}
        if row.joint not in robot.joints:
            raise JobError(f"no joint {row.joint!r}", f"one of {', '.join(robot.joints)}", **place)
        unit = robot.units[row.joint]
        if row.unit != unit:
            raise JobError(
                f"a reading in {row.unit}", f"a reading in {unit} for this joint", **place
            )
        if row.joint in arm.joints:
            posture[arm.joints.index(row.joint)] = row.reading
    return posture


def _true_artefact(plan: SetSpec, certified: Artefact, seed: int) -> Artefact:
    """The certified artefact, or one that departs from it: the same for every set that uses it."""
    assert plan.artefact is not None
    if not plan.noise.artefact:
        return certified
    landmarks = {
        name: replace(mark, position=mark.position + mark.sigma * rng.standard_normal(3))
        for name, mark in certified.landmarks.items()
        for rng in [stream(seed, "artefact", plan.artefact.name, name)]
    }
    return replace(certified, landmarks=landmarks)


def _touched(plan: SetSpec, visits: Visits, visitor: Visitor) -> SimulatedFile:
    """Readings at every touch: seated imperfectly, reached exactly, read with noise."""
    n, kinematics = len(visits.targets), visitor.kinematics
    random = partial(stream, visitor.seed, plan.name, visits.name)
    rng, instrument = random("seating"), random("instrument")
    displacement = outlier_displacements(random("outliers"), plan.outliers, n)
    position = visits.targets.position + plan.noise.seating * rng.standard_normal((n, 3))
    if plan.term.columns.numbers and not visits.numbers:
        # Nobody reads the number that the instrument keeps: it scatters as a reading would.
        position += plan.noise.instrument * instrument.standard_normal((n, 3))
    tilt = scattered_rotations(rng, plan.noise.seating_angle, n)
    targets = Targets(position + displacement, visits.targets.rotation @ tilt)
    if remembers(kinematics.arm, kinematics.values):
        raise JobError(
            "hysteresis of a joint, in a set of touches",
            "sets of a kind that an instrument or a camera sees in motion",
            where=plan.name,
        )
    q = visitor.reach(plan, visits, targets, visits.start, random("touches"))
    sides = last_motions(kinematics.arm, kinematics.values, q, random("direction"))
    q = readings_beside(kinematics.arm, kinematics.values, q, sides)
    # Postures are found for links that do not lean.
    level = up_in_links(kinematics.arm, q, kinematics.values, 0.0, random("lean"))
    path = f"{plan.name}/{visits.name}.csv"
    samples = Samples.from_arrays(
        kinematics.arm.joints,
        encoder_readings(random("encoders"), plan.noise, kinematics.true, q),
        labels=visits.labels,
        origin=_origins(path, n),
        numbers=_read_numbers(plan, visits.numbers, instrument),
        direction=sides,
        felt=as_felt(level, plan.noise.tilt, random("tilt")),
    )
    return SimulatedFile(path, samples, displacement)


def _read_numbers(
    plan: SetSpec, ideal: Mapping[str, FloatArray], rng: np.random.Generator
) -> dict[str, FloatArray]:
    """Numbers by name, (n,) in SI, as an instrument reads them: with noise."""
    level = {c.name: plan.noise.of_instrument(c.scatters_in) for c in plan.term.columns.numbers}
    return {name: v + level[name] * rng.standard_normal(len(v)) for name, v in ideal.items()}


def _sighted_samples(
    plan: SetSpec, label: str, kinematics: InverseKinematics, seed: int
) -> SimulatedFile:
    """What an external instrument sees of the tip, or a camera on it, in random configurations."""
    arm, values = kinematics.arm, kinematics.values
    noise, random = plan.noise, partial(stream, seed, plan.name)
    time, moving = None, None
    if plan.motion is None:
        rests = moments = _in_sight(plan, kinematics, values, random("configurations"))
    else:
        moving = _moving(plan, plan.motion, kinematics, values, random("configurations"))
        time, rests = moving.time, moving.q
        moments = wrapped(kinematics.true, moving.seen_at)
    # At every rest each of the marks is seen.
    marks = [*plan.marks, *plan.term.marks_in(plan.settings)]
    labels: dict[str, Any] = {plan.term.mark: marks * plan.samples} if marks else {}
    seen_at = np.repeat(np.arange(plan.samples), max(len(marks), 1))
    q, n = moments[seen_at], len(seen_at)
    conditions: dict[str, Any] = {}
    if plan.temperature is not None:
        warmth = random("temperature").uniform(*plan.temperature, plan.samples)
        conditions["temperature"] = warmth[seen_at]
    if plan.payloads:
        masses = random("payload").choice(plan.payloads, plan.samples)
        places = np.tile(plan.payload_place, (plan.samples, 1))
        conditions["payload"] = np.column_stack([masses, places])[seen_at]
    sides = last_motions(arm, values, rests, random("direction"))
    if sides is not None:
        conditions["direction"] = sides[seen_at]
    if time is None and remembers(arm, values):
        # The arm goes straight from row to row, one each second.
        time = np.arange(plan.samples, dtype=float)
    if time is not None:
        conditions["time"] = time[seen_at]
    if arm.tilt_sensors:
        felt = up_in_links(arm, rests, values, plan.lean, random("lean"))
        conditions["felt"] = {name: vectors[seen_at] for name, vectors in felt.items()}
    ideal = _ideal(plan, arm, q, labels, values, conditions)
    delay = plan.settings.get("line_delay")
    if moving is not None and delay is not None and ideal.camera is not None:
        # Each row of a picture is of its own moment.
        def pixels_at(after: float) -> FloatArray:
            q = wrapped(kinematics.true, moving.later(after))[seen_at]
            pixels = _ideal(plan, arm, q, labels, values, conditions).pixels
            assert pixels is not None
            return pixels

        ideal = replace(ideal, pixels=rolled(pixels_at, delay.value, ideal.camera.height))
    if arm.tilt_sensors:
        conditions["felt"] = as_felt(conditions["felt"], noise.tilt, random("tilt"))
    rng = random("instrument")
    displacement = outlier_displacements(random(label, "outliers"), plan.outliers, n)
    position, corners, profiles = None, None, None
    if ideal.position is not None:
        sigma = noise.instrument if ideal.sigma is None else ideal.sigma
        position = displacement + ideal.scattered(sigma * rng.standard_normal((n, 3)))
    turned = scattered_rotations(rng, noise.instrument_angle, n)
    oriented = plan.orientation or plan.term.columns.orientation == "required"
    rotation = ideal.rotation @ turned if oriented and ideal.rotation is not None else None
    numbers = _read_numbers(plan, ideal.numbers, rng)
    readings = encoder_readings(random("encoders"), noise, kinematics.true, rests)
    if ideal.pixels is not None:
        # A camera's samples are its pictures: where the board was is not measured.
        position, rotation = None, None
        (what,) = plan.term.columns.labels
        names = np.array([f"{plan.name}-{k:04d}" for k in range(n)])
        if ideal.camera is None:
            labels[what] = names
            seen = _profiles(plan, ideal.pixels, displacement, names, rng)
            profiles = f"profiles/{plan.name}.csv", seen
        else:
            labels[what] = names = np.char.add(names, ".png")
            corners = f"corners/{plan.name}.csv", _corners(plan, ideal, displacement, names, rng)
    path = f"{plan.name}/{label}.csv"
    samples = Samples.from_arrays(
        arm.joints,
        readings[seen_at],
        labels=labels,
        position=position,
        rotation=rotation,
        origin=_origins(path, n),
        numbers=numbers,
        **conditions,
    )
    return SimulatedFile(path, samples, displacement, corners, profiles)


def _profiles(
    plan: SetSpec,
    points: FloatArray,
    displacement: FloatArray,
    names: NDArray[np.str_],
    rng: np.random.Generator,
) -> Profiles:
    """Profiles whose points scatter along the beam; an outlier moves all of a profile."""
    points = points + displacement[:, None, [0, 2]]
    points[..., 1] += plan.noise.instrument * rng.standard_normal(points.shape[:2])
    scan, point = np.nonzero(np.isfinite(points).all(axis=2))
    return profiles_of(names[scan], points[scan, point])


def _corners(
    plan: SetSpec,
    ideal: Observed,
    displacement: FloatArray,
    names: NDArray[np.str_],
    rng: np.random.Generator,
) -> Corners:
    """Corners in pictures, each scattered by itself; an outlier moves all of a picture."""
    assert ideal.pixels is not None
    assert ideal.camera is not None
    # As the board would seem displaced: by the pixels that a length covers where it is.
    across = np.nanmedian(np.linalg.norm(np.diff(ideal.pixels, axis=1), axis=2), axis=1)
    board: Board = plan.settings["board"]
    spacings = np.linalg.norm(np.diff(np.array(list(board.points.values())), axis=0), axis=1)
    shift = displacement[:, :2] * (across / np.median(spacings))[:, None]
    pixels = ideal.pixels + shift[:, None]
    pixels = pixels + plan.noise.corner * rng.standard_normal(pixels.shape)
    # Nobody finds a corner where there is no picture.
    picture, point = np.nonzero(ideal.camera.inside(pixels))
    return corners_of(names[picture], np.array(list(board.points))[point], pixels[picture, point])


def _moving(
    plan: SetSpec,
    motion: MotionSpec,
    kinematics: InverseKinematics,
    values: Mapping[str, float],
    rng: np.random.Generator,
) -> Passage:
    """An arm on its way through random configurations, while what is looked at is in sight."""
    arm, endless = kinematics.arm, full_circle(kinematics.true)
    slides = np.array([joint.type == "prismatic" for joint in arm.readings])

    def postures(count: int) -> FloatArray:
        q = _in_sight(replace(plan, samples=count), kinematics, values, rng)
        q[:, endless] = np.unwrap(q[:, endless], axis=0)
        return q

    def in_sight(q: FloatArray) -> BoolArray:
        return _ideal(plan, arm, wrapped(kinematics.true, q), {}, values).in_sight

    # What moves as fast at a lever of half a metre.
    lever = 0.5
    largest = motion.speed * np.where(slides, lever, 1.0)
    visible = in_sight if plan.term.chance < 1.0 else None
    return passage(motion, plan.samples, largest, postures, visible)


def _in_sight(
    plan: SetSpec,
    kinematics: InverseKinematics,
    values: Mapping[str, float],
    rng: np.random.Generator,
) -> FloatArray:
    """Random configurations in which what is looked at is in sight."""
    rounds = 20
    arm, n, chance = kinematics.arm, plan.samples, plan.term.chance
    tries, batches, left = math.ceil(n / chance), list[FloatArray](), n
    for _ in range(rounds):
        q = wrapped(kinematics.true, kinematics.random_readings(rng, tries))
        if chance < 1.0:
            # Some at a time, as long as some are wanted: of a large board all take much memory.
            in_sight, rest, many = list[FloatArray](), q, max(n, 200)
            while len(rest) and sum(map(len, in_sight)) < left:
                chunk, rest = rest[:many], rest[many:]
                in_sight.append(chunk[_ideal(plan, arm, chunk, {}, values).in_sight])
            q = np.concatenate(in_sight)[:left]
        batches.append(q)
        left -= len(q)
        if not left:
            return np.concatenate(batches)
    raise JobError(
        f"the target visible in only {n - left} of {rounds * tries} random configurations",
        f"{n} visible configurations",
        line=plan.line,
        where=f"sets.{plan.name}",
        hint="move it into the arm's reach, turn it towards the camera, or ask for fewer samples",
    )


def _ideal(
    plan: SetSpec,
    arm: ArmModel,
    q: FloatArray,
    labels: Mapping[str, Sequence[str]],
    values: Mapping[str, float],
    conditions: Mapping[str, Any] = MappingProxyType({}),
) -> Observed:
    """What would be seen in these configurations without noise.

    ``conditions`` is what is known of the arm beside its readings, such as its temperature.
    """
    n = len(q)
    blank = Samples.from_arrays(
        arm.joints,
        q,
        labels=labels,
        position=np.zeros((n, 3)),
        rotation=np.tile(np.eye(3), (n, 1, 1)),
        numbers={number.name: np.zeros(n) for number in plan.term.columns.numbers},
        **conditions,
    )
    poses = ArmPoses(arm, blank)
    term = plan.term.over(poses, Setup(settings=plan.settings))
    return term.observed({**values, **own_values(plan, term)}, poses)


def _origins(path: str, n: int) -> list[str]:
    """``folder/file.csv:2`` for the first row: the header is line 1."""
    return [f"{path}:{row + 2}" for row in range(n)]
