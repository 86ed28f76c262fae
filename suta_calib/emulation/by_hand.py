"""An arm that is swept by hand while its tip is in a socket or on a plate.

The hand tilts the tool, and turns it, by swings whose periods have no common multiple, so that no
posture comes back. On a plate the tip moves about as well. The tip may be lifted off for a while,
and the socket or the plate may slip.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.emulation.faults import PlaceSlip, TipLift
from suta_calib.emulation.motion import Curve, continuous, minimum_jerk
from suta_calib.emulation.trajectories import matching_of, reached
from suta_calib.errors import JobError
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import InverseKinematics, Targets
from suta_calib.simulation.noise import full_circle, stream
from suta_calib.units import from_deg


@dataclass(frozen=True)
class HandSweep(Displayable):
    """How a hand sweeps an arm.

    Attributes:
        cone: largest tilt of the tool, rad; it is turned about itself by as much.
        size: edge of the square on the plate that the tip goes over, m; 0 in a socket.
        duration: s.
        slowest, fastest: frequencies of the swings lie between, Hz.
        seating: standard deviation per axis of where the tip sits, m: friction and play hold it
            elsewhere after each reversal.
        lifts, slips: what goes wrong.
    """

    cone: float = from_deg(30.0)
    size: float = 0.0
    duration: float = 60.0
    slowest: float = 0.15
    fastest: float = 0.45
    seating: float = 0.0
    lifts: tuple[TipLift, ...] = ()
    slips: tuple[PlaceSlip, ...] = ()


def swept_by_hand(
    arm: ArmModel,
    values: Mapping[str, float],
    how: HandSweep = HandSweep(),
    *,
    posture: FloatArray | None = None,
    point: FloatArray | None = None,
    upright: FloatArray | None = None,
    seed: int = 0,
) -> Curve:
    """Readings of the true arm while its tip is in a socket or on a plate.

    Args:
        arm: the nominal arm.
        values: its true parameters, m or rad.
        how: the sweep.
        posture: (joints,) readings from which the first posture is searched; by default the middle
            of every joint's range, and others where that does not allow the tilts.
        point: (3,) the socket, or the middle of what is swept of the plate, in the base, m; by
            default where the tip is at the posture.
        upright: (3, 3) whose z axis is square to the plate; by default the base's.
        seed: of the swings and of the seating.

    Raises:
        JobError: too few joints to tilt the tool, or a tilt that is out of reach.
    """
    matching, kinematics = matching_of(arm), InverseKinematics(arm, values)
    rng = stream(seed, "by hand")
    # Knots of the motion, 1/s: a cubic between two of them keeps the tip within a micrometre.
    knots_per_s = 50.0
    time = np.linspace(0.0, how.duration, max(2, round(knots_per_s * how.duration)) + 1)
    swings = _swings(rng, time, how)
    tilts = rotation_from_vector(how.cone * np.sqrt([0.5, 0.5, 1.0]) * swings[:, :3])
    frame = np.eye(3) if upright is None else np.asarray(upright, dtype=float)
    way = how.size / 2 * swings[:, 3:] @ frame[:, :2].T
    way += _seats(rng, time, swings, how.seating)
    for slip in how.slips:
        aside = frame @ _aside(rng, how)
        way += slip.distance * _ramp(time, slip.start)[:, None] * aside
    off = sum(
        (
            lift.distance * (_ramp(time, lift.window.start) - _ramp(time, lift.window.end))
            for lift in how.lifts
        ),
        np.zeros(len(time)),
    )
    # Of those, every so many are searched one after the other, from the posture before.
    stride = 25
    coarse = np.append(np.arange(0, len(time) - 1, stride), len(time) - 1)

    def knots(start: FloatArray) -> FloatArray:
        """(coarse, joints) postures, each next to the one before."""
        if point is not None:
            rotation, _ = arm.forward(start, values)
            place = np.asarray(point, dtype=float)
            start = reached(kinematics, place, rotation, "position", start, rng)
        rotation, place = arm.forward(start, values)
        postures = np.empty((len(coarse), len(arm.joints)))
        for k, row in enumerate(coarse):
            there = place + way[row]
            start = reached(kinematics, there, rotation @ tilts[row], matching, start, rng)
            postures[k] = start
        return postures

    def along(rough: FloatArray) -> Curve:
        """The whole motion about postures at the coarse knots."""
        rotation, place = _middle(arm, values, rough[0], way[0], tilts[0])
        turned = rotation @ tilts
        there = place + way - off[:, None] * turned[:, :, 2]
        between = CubicSpline(time[coarse], rough)(time)
        answer = kinematics.solve(Targets(there, turned, matching), between, rng, 1)
        q = continuous(answer.q, full_circle(arm))
        # No hand turns a joint faster, rad/s (m/s): the arm has come to the other branch of its
        # postures.
        jumps = np.abs(np.diff(q, axis=0, prepend=q[:1])).max(axis=1) > 6.0 / knots_per_s
        if (wrong := np.flatnonzero(~answer.reached | jumps)).size:
            raise JobError(
                f"a sweep that the arm cannot follow at {time[wrong[0]]:.1f} s",
                "a place where the tool can be tilted and lifted, far from a singular posture",
                file=arm.chain.path,
                where="sweep",
                hint="move the point (--point), start from another posture, or make the cone "
                "smaller (--cone)",
            )
        return Curve(time, q)

    starts = [kinematics.middle, *kinematics.random_readings(stream(seed, "by hand from"), 20)]
    refused: JobError | None = None
    for start in starts if posture is None else [np.asarray(posture, dtype=float)]:
        try:
            return along(continuous(knots(start), full_circle(arm)))
        except JobError as error:
            refused = refused or error
    assert refused is not None
    raise refused


def _middle(
    arm: ArmModel,
    values: Mapping[str, float],
    first: FloatArray,
    way: FloatArray,
    tilt: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """The tip's pose about which it is tilted and moved, by the first posture of a sweep."""
    rotation, position = arm.forward(first, values)
    return rotation @ tilt.T, position - way


def _swings(rng: np.random.Generator, time: FloatArray, how: HandSweep) -> FloatArray:
    """(n, 5) between -1 and 1, each with two frequencies of its own, from rest to rest."""
    frequency = rng.uniform(how.slowest, how.fastest, (2, 5))
    phase = rng.uniform(0.0, 2 * np.pi, (2, 5))
    both = np.sin(2 * np.pi * time[:, None, None] * frequency + phase)
    fading = min(1.0, how.duration / 2)
    fade = minimum_jerk(np.clip(np.minimum(time, how.duration - time) / fading, 0.0, 1.0))
    return np.asarray(fade[:, None] * both.mean(axis=1))


def _seats(
    rng: np.random.Generator, time: FloatArray, swings: FloatArray, std: float
) -> FloatArray:
    """(n, 3) errors of the seat, m: another one whenever the motion of swings (n, 5) reverses."""
    speed = np.gradient(swings, time, axis=0)
    began, turned = speed[1], [0.0]
    for at, now in zip(time, speed, strict=True):
        if now @ began < 0.0:
            began = now
            turned.append(float(at))
    offsets = std * rng.standard_normal((len(turned) + 1, 3))
    number = np.searchsorted(turned, time, side="right")
    share = _ramp(time, np.append(-1.0, turned)[number])[:, None]
    return np.asarray(offsets[number - 1] + share * (offsets[number] - offsets[number - 1]))


def _aside(rng: np.random.Generator, how: HandSweep) -> FloatArray:
    """(3,) which way something slips: a socket along the table, a plate along its normal."""
    if how.size:
        return np.array([0.0, 0.0, 1.0])
    angle = rng.uniform(0.0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def _ramp(time: FloatArray, start: FloatArray | float) -> FloatArray:
    """From 0 to 1."""
    # How long it takes to lift the tip, or for what it is on to slip, s.
    return minimum_jerk(np.clip((time - start) / 0.15, 0.0, 1.0))
