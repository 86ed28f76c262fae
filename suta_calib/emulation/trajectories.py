"""Trajectories of the joints: swings within the joints' limits, or given in a file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.emulation.motion import Curve, Sweep, ThereAndBack, continuous
from suta_calib.errors import InputError, JobError, did_you_mean
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements.csv_table import read_csv_table
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import InverseKinematics, Targets
from suta_calib.simulation.inverse_kinematics import Matching
from suta_calib.simulation.noise import full_circle, stream
from suta_calib.units import deg, from_deg, mm, stored


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
        at = arm.joints.index(name)
        joint = arm.readings[at]
        if not joint.lower <= reading <= joint.upper:
            limits = f"{joint.lower:.4g} to {joint.upper:.4g}"
            raise InputError(f"{reading:.4g} for {name!r}", limits, where="posture")
        posture[at] = reading
    return posture


def sweep(
    arm: ArmModel,
    posture: FloatArray | None = None,
    amplitude: float = from_deg(20.0),
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
    prismatic = np.array([joint.type == "prismatic" for joint in arm.readings])
    limits = np.array([(joint.lower, joint.upper) for joint in arm.readings])
    room = np.minimum(middle - limits[:, 0], limits[:, 1] - middle)
    room = np.where(full_circle(arm), np.inf, room)
    # A prismatic joint swings by this much for every rad of the others.
    swing = np.where(prismatic, 0.2 * amplitude, amplitude)
    return Sweep(middle, np.minimum(swing, room), slowest, fastest, duration)


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
    """``joint_1=15,joint_3=160`` in degrees (mm), or one number per joint: rad (m) by joint."""
    parts = [part.strip() for part in text.split(",") if part.strip()]
    if "=" not in text and len(parts) == len(arm.joints):
        parts = [f"{joint}={part}" for joint, part in zip(arm.joints, parts, strict=True)]
    prismatic = [joint.name for joint in arm.readings if joint.type == "prismatic"]
    posture = {}
    for part in parts:
        name, equals, value = (word.strip() for word in part.partition("="))
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not (equals and math.isfinite(number)):
            expected = f"JOINT=DEGREES, or {len(arm.joints)} numbers"
            raise InputError(repr(part), expected, where="posture")
        posture[name] = stored(number, "m" if name in prismatic else "rad")
    return posture


def pivoting(
    arm: ArmModel,
    values: Mapping[str, float],
    point: FloatArray | None = None,
    *,
    posture: FloatArray | None = None,
    cone: float = from_deg(30.0),
    period: float = 40.0,
    seed: int = 0,
) -> ThereAndBack:
    """Readings that keep the tip of the true arm on a point.

    Args:
        arm: the nominal arm.
        values: its true parameters, m or rad.
        point: (3,) in the base, m; by default where the tip is at ``posture``.
        posture: (joints,) readings from which the first posture is searched; the middle of every
            joint's range by default, and others where that does not allow the tilts, as with many
            an arm that is stretched there.
        cone: largest angle by which the tool is tilted, rad.
        period: of going through all tilts and back, s.
        seed: of the search.

    Raises:
        JobError: too few joints to tilt the tool, or the point or a tilt is out of reach.
    """
    matching, joints = matching_of(arm), len(arm.joints)
    kinematics, rng = InverseKinematics(arm, values), stream(seed, "pivot")
    tilts = rotation_from_vector(_tilts(cone))

    def on_point(start: FloatArray) -> FloatArray:
        """A posture with the tip on the point; where there is none, no other start helps."""
        if point is None:
            return start
        rotation, _ = arm.forward(start, values)
        position = np.asarray(point, dtype=float)
        return reached(kinematics, position, rotation, "position", start, rng)

    def tilted(start: FloatArray, tilts: FloatArray) -> FloatArray:
        """(n, joints) postures with the tip where it is, tilted from the first posture's."""
        rotation, position = arm.forward(start, values)
        knots = np.empty((len(tilts), joints))
        for k, tilt in enumerate(tilts):
            start = reached(kinematics, position, rotation @ tilt, matching, start, rng)
            knots[k] = start
        return knots

    # So many postures are tried where none is asked for.
    starts = [kinematics.middle, *kinematics.random_readings(stream(seed, "pivot from"), 20)]
    if posture is not None:
        starts = [np.asarray(posture, dtype=float)]
    refused: JobError | None = None
    for start in map(on_point, starts):
        try:
            tilted(start, tilts[::25])  # tells soon where one is out of reach
            knots = continuous(tilted(start, tilts), full_circle(arm))
            break
        except JobError as error:
            refused = refused or error
    else:
        assert refused is not None
        raise refused
    # By the length of the way in joint space: no joint hurries where the arm is nearly singular.
    steps = np.linalg.norm(np.diff(knots, axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps + 1e-3 * steps.mean())])
    return ThereAndBack(Curve(length, knots), period)


def _tilts(cone: float) -> FloatArray:
    """(n, 3) rotation vectors: a Lissajous figure over the cone, and turns about the tool."""
    # So dense that a cubic between two of them keeps the tip within a micrometre.
    turn = np.linspace(0.0, 2 * np.pi, 1000)
    figure = np.sin(turn[:, None] * [3, 2, 1])
    # The first two reach their largest values together: the corner of a square in a circle.
    return np.asarray(cone * figure * np.array([math.sqrt(0.5), math.sqrt(0.5), 0.5]), dtype=float)


def matching_of(arm: ArmModel) -> Matching:
    """What of the tool's orientation an arm can match; of fewer than five joints a JobError."""
    fewest_joints = 5
    joints = len(arm.joints)
    if joints < fewest_joints:
        raise JobError(
            f"an arm with {joints} joints",
            f"at least {fewest_joints} joints: with fewer, the tool cannot be tilted about a point",
            file=arm.chain.path,
            where="motion",
        )
    return "axis" if joints == fewest_joints else "pose"


def reached(
    kinematics: InverseKinematics,
    position: FloatArray,
    rotation: FloatArray,
    matching: Matching,
    start: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    """The posture next to ``start`` that reaches a pose: one start, lest another branch is met."""
    target = Targets(position[None], rotation[None], matching)
    answer = kinematics.solve(target, start, rng, 40 if matching == "position" else 1)
    if answer.reached[0]:
        return np.asarray(answer.q[0], dtype=float)
    x, y, z = mm(position)
    off = f"{mm(answer.distance[0]):.3g} mm and {deg(answer.angle[0]):.3g} deg away"
    raise JobError(
        f"a tilt about ({x:.1f}, {y:.1f}, {z:.1f}) mm that is out of the arm's reach (closest: "
        f"{off})",
        "a point about which the tip can be tilted",
        file=kinematics.arm.chain.path,
        where="motion",
        hint="move the point (--point), start from another posture, or make the cone smaller "
        "(--cone)",
    )
