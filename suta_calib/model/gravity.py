"""The torque of gravity at every joint, on CasADi symbols, at the geometry of the URDF.

With the mass m_k and centre c_k of every body beyond joint j, which stands at p_j,

    τ_j(q) = Σ_{k beyond j} (c_k - p_j) × m_k g

Its component along the joint's axis is what gravity does to the joint: the negative of
`pin.computeGeneralizedGravity`, the torque that would hold it. Those across the axis bend the joint
and the link that leads to it. Beyond a joint is what hangs on its child link: towards the tip where
the chain descends, towards the base where it climbs. What the tip carries, a mass at a point, hangs
on every joint that descends. Gravity points along -z of the URDF's root link, as Pinocchio has it,
so the root must stand as it does in the file. Offsets and couplings count, because a zero may have
been set by hand. Errors of lengths, and deflections, are left out: a per cent of a deflection is
nothing.

Where chains of a robot share joints, the arm that is not looked at hangs on them too. Its links are
part of what the last shared joint carries, as drawn, with its own joints at zero. Where the samples
have its readings, its moment changes with them.
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

    The centre is in the joint's frame. The mass may be a symbol.
    """

    joint: str
    mass: float | Symbol
    centre: FloatArray


@dataclass(frozen=True, eq=False)
class MovingFrame:
    """One moving joint at a posture: its axes, where it stands, and the frame of its load.

    Attributes:
        joint: its name.
        axes: (3, 3) its axis, then the two across it, in the base frame.
        point: (3,) where it stands on its parent link, in the base frame, m.
        rotation, position: of the frame behind the joint's motion, which its child link has.
        climbed: whether the chain passes it from child to parent.
    """

    joint: str
    axes: Symbol
    point: Symbol
    rotation: Symbol
    position: Symbol
    climbed: bool


def beyond(climbed: Sequence[bool], joint: int) -> slice:
    """Which of a chain's moving joints, base → tip, hang on one of them, itself included."""
    return slice(0, joint + 1) if climbed[joint] else slice(joint, None)


def gravity_torques(
    frames: Sequence[MovingFrame],
    carried: Sequence[Load],
    gravity: Symbol,
    tip: tuple[Symbol, Symbol, Symbol | None],
    moved: Sequence[tuple[int, Symbol]] = (),
) -> dict[str, Symbol]:
    """Torque of gravity about each joint's axis and the two across it, (3,) N·m.

    About its own axis that of a prismatic joint means nothing.

    Args:
        frames: the moving joints at nominal, base → tip.
        carried: their loads, likewise.
        gravity: (3,) in the base frame, m/s².
        tip: rotation and position of the tip, and (4,) what it carries: the mass, kg, and its
            centre in the tip's frame, m; None for nothing.
        moved: what hangs on the first few joints, how many, and by how much its moment (3,), kg·m,
            changes when joints of other chains move.
    """
    climbed = [frame.climbed for frame in frames]
    rotation, position, payload = tip
    held = [
        (load.mass, load.mass * (f.position + f.rotation @ ca.DM(load.centre)))
        for f, load in zip(frames, carried, strict=True)
    ]
    hung: list[tuple[Symbol, Symbol]] = []
    if payload is not None:
        hung.append((payload[0], payload[0] * (position + rotation @ payload[1:])))
    torques = {}
    for k, frame in enumerate(frames):
        hanging = [*held[beyond(climbed, k)], *([] if climbed[k] else hung)]
        hanging += [(0.0, change) for carriers, change in moved if k < carriers]
        mass, moment = (sum(parts[1:], parts[0]) for parts in zip(*hanging, strict=True))
        torques[frame.joint] = frame.axes.T @ ca.cross(moment - mass * frame.point, gravity)
    return torques
