"""The torque of gravity about every joint's axis, on CasADi symbols, at the nominal geometry.

With the mass m_k and centre c_k of every body beyond joint j, whose axis a_j passes through p_j,

    τ_j(q) = a_j · Σ_{k beyond j} (c_k - p_j) × m_k g

which is what gravity does to the joint: the negative of `pin.computeGeneralizedGravity`, the
torque that would hold it. Beyond a joint is what hangs on its child link: towards the tip where the
chain descends, towards the base where it climbs. Gravity points along -z of the URDF's root link,
as Pinocchio has it, so the root must stand as it does in the file. Offsets and other errors are
left out: a per cent of a deflection is nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from suta_calib.arrays import FloatArray
from suta_calib.geometry.symbols import Symbol


@dataclass(frozen=True, eq=False)
class Load:
    """The mass, kg, that moves with one joint, before the next one, and its centre (3,), m.

    The centre is in the joint's frame.
    """

    joint: str
    mass: float
    centre: FloatArray


@dataclass(frozen=True, eq=False)
class MovingFrame:
    """One moving joint at a posture: its axis (3,) and origin (3,) in the base, and its load.

    Attributes:
        joint: its name.
        axis, point: in the base frame; the point in m.
        rotation, position: of the frame behind the joint's motion, which its child link has.
        climbed: whether the chain passes it from child to parent.
    """

    joint: str
    axis: Symbol
    point: Symbol
    rotation: Symbol
    position: Symbol
    climbed: bool


def beyond(climbed: Sequence[bool], joint: int) -> slice:
    """Which of a chain's moving joints, base → tip, hang on one of them, itself included."""
    return slice(0, joint + 1) if climbed[joint] else slice(joint, None)


def gravity_torques(
    frames: Sequence[MovingFrame], carried: Sequence[Load], gravity: Symbol
) -> dict[str, Symbol]:
    """Torque of gravity about each joint's axis, N·m (for a prismatic one it means nothing).

    The moving joints are at nominal, base → tip, and so are their loads; gravity is (3,) in the
    base frame, m/s².
    """
    climbed = [frame.climbed for frame in frames]
    centres = [
        f.position + f.rotation @ ca.DM(load.centre)
        for f, load in zip(frames, carried, strict=True)
    ]
    torques = {}
    for k, frame in enumerate(frames):
        torque: Symbol = ca.SX(3, 1)
        hanging = beyond(climbed, k)
        for centre, load in zip(centres[hanging], carried[hanging], strict=True):
            torque += ca.cross(centre - frame.point, load.mass * gravity)
        torques[frame.joint] = ca.dot(frame.axis, torque)
    return torques
