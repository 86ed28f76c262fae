"""Forward kinematics of a chain whose geometry is unknown, on CasADi symbols.

``T_base_tip(θ, q)`` is the product over the chain's segments of

    Trans(xyz) · R_nominal · exp([rx, ry, rz]) · motion(axis, q + offset)

with the placements and axes of `pin.Model`. Two errors that are no geometry, and that a URDF has no
place for, change how far a revolute joint turns for what its encoder reads:

    angle = q + offset + c1 cos q + s1 sin q + c2 cos 2q + s2 sin 2q + compliance · τ(q)

with q the reading and τ the torque of gravity about the joint's axis (`gravity`). An encoder disc
that sits off its axis, or a shaft that is bent, gives the first harmonic; a disc that is tilted or
oval the second (Mooring, Roth, Driels, Fundamentals of Manipulator Calibration, 1991, chapter 2).

The Jacobian is written as the geometric Jacobian of every parameter (an axis through a point)
rather than left to differentiation: a column then costs a cross product, not another walk along
the chain.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.symbols import Symbol, symbolic_rotation
from suta_calib.model.gravity import Load, MovingFrame, gravity_torques
from suta_calib.model.parameters import COMPLIANCE, OFFSET, PLACEMENT, POSITION, ROTATION

Motion = Literal["revolute", "prismatic", "fixed"]


@dataclass(frozen=True, eq=False)
class Segment:
    """One joint of the chain, fixed ones included.

    Attributes:
        owner: of its parameters: the joint's name, or the tip frame's.
        motion: how it moves.
        rotation: (3, 3) nominal rotation of its origin in the parent link.
        position: (3,) nominal position of its origin in the parent link, m.
        axis: (3,) unit axis in the joint's frame.
    """

    owner: str
    motion: Motion
    rotation: FloatArray
    position: FloatArray
    axis: FloatArray

    @property
    def keys(self) -> tuple[str, ...]:
        """Of its six placement parameters, and of its offset if it moves."""
        return PLACEMENT if self.motion == "fixed" else (*PLACEMENT, OFFSET)

    def names(self, *keys: str) -> list[str]:
        """Of its parameters with these keys."""
        return [f"{self.owner}.{key}" for key in keys]


class _Walk:
    """The state of one pass along the chain: the current frame and the columns met so far."""

    def __init__(self, names: Sequence[str], theta: Symbol, nominal: Mapping[str, float]) -> None:
        self.rotation: Symbol = ca.SX.eye(3)
        self.position: Symbol = ca.SX(3, 1)
        self.index = {name: k for k, name in enumerate(names)}
        self.theta, self.nominal = theta, nominal
        # Of gravity about each joint's axis, by the joint's name.
        self.torques: Mapping[str, Symbol] = {}
        self.frames: list[MovingFrame] = []
        # column index → (linear direction, None) or (axis, point it passes through)
        self.columns: dict[int, tuple[Symbol, Symbol | None]] = {}

    def value(self, name: str) -> Symbol:
        k = self.index.get(name)
        return self.theta[k] if k is not None else ca.SX(self.nominal.get(name, 0.0))

    def matters(self, name: str) -> bool:
        """Whether a parameter that is usually zero is unknown, or not zero."""
        return name in self.index or bool(self.nominal.get(name))

    def note(self, name: str, direction: Symbol, point: Symbol | None = None) -> None:
        if name in self.index:
            self.columns[self.index[name]] = (direction, point)

    def through(self, segment: Segment, reading: Symbol | None) -> None:
        names = segment.names(*POSITION)
        for k, name in enumerate(names):
            self.note(name, self.rotation[:, k])
        self.position = self.position + self.rotation @ ca.vertcat(*map(self.value, names))
        self.rotation = self.rotation @ ca.SX(_snapped(segment.rotation))
        self._turn(segment)
        if reading is not None:
            self._move(segment, reading)

    def _turn(self, segment: Segment) -> None:
        names = segment.names(*ROTATION)
        if not any(map(self.matters, names)):
            return
        symbol, value = ca.SX.sym("r", 3), ca.vertcat(*map(self.value, names))
        turn = symbolic_rotation(symbol)
        derivative = ca.jacobian(ca.vec(turn), symbol)
        turn, derivative = (ca.substitute(e, symbol, value) for e in (turn, derivative))
        for k, name in enumerate(names):
            spin = ca.reshape(derivative[:, k], 3, 3) @ turn.T
            axis = ca.vertcat(spin[2, 1], spin[0, 2], spin[1, 0])
            self.note(name, self.rotation @ axis, self.position)
        self.rotation = self.rotation @ turn

    def _move(self, segment: Segment, reading: Symbol) -> None:
        (offset,) = segment.names(OFFSET)
        amount = reading + self.value(offset)
        axis = _snapped(segment.axis)
        direction, point = self.rotation @ ca.SX(axis), self.position
        if segment.motion == "prismatic":
            self.note(offset, direction)
            self.position = self.position + direction * amount
        else:
            self.note(offset, direction, point)
            for name, effect in self._beside_the_reading(segment, reading):
                amount += self.value(name) * effect
                self.note(name, direction * effect, point)
            # Rodrigues' formula; CasADi leaves out what is exactly zero.
            outer = ca.SX(_snapped(np.outer(axis, axis)))
            across = ca.cos(amount) * (ca.SX.eye(3) - outer) + ca.sin(amount) * ca.skew(ca.SX(axis))
            self.rotation = self.rotation @ (across + outer)
        frame = MovingFrame(segment.owner, direction, point, self.rotation, self.position)
        self.frames.append(frame)

    def _beside_the_reading(
        self, segment: Segment, reading: Symbol
    ) -> Iterator[tuple[str, Symbol]]:
        """Names of errors that are no geometry, with the joint's turn per unit of each."""
        turns = {
            "ecc_c1": ca.cos(reading),
            "ecc_s1": ca.sin(reading),
            "ecc_c2": ca.cos(2 * reading),
            "ecc_s2": ca.sin(2 * reading),
            COMPLIANCE: self.torques.get(segment.owner),
        }
        for name, turn in zip(segment.names(*turns), turns.values(), strict=True):
            if self.matters(name):
                yield name, turn

    def jacobian(self) -> Symbol:
        """(6, n): linear over angular velocity of the tip in the base frame, per parameter."""
        rows = []
        for k in range(len(self.index)):
            direction, point = self.columns[k]
            linear = direction if point is None else ca.cross(direction, self.position - point)
            angular = ca.SX(3, 1) if point is None else direction
            rows.append(ca.vertcat(linear, angular))
        return ca.horzcat(*rows) if rows else ca.SX(6, 0)


def forward_kinematics(
    segments: Sequence[Segment],
    names: Sequence[str],
    nominal: Mapping[str, float],
    carried: Sequence[Load] = (),
    gravity: FloatArray | None = None,
) -> Symbol:
    """The chain's kinematics as a CasADi function of the named parameters and one sample.

    Args:
        segments: base to tip.
        names: the parameters that become inputs, in this order.
        nominal: what all others stay at, by name; zero where it is not given.
        carried: loads of the moving joints, needed where a joint yields.
        gravity: (3,) in the base frame, m/s², needed likewise.

    Returns:
        ``ca.Function(theta (n), q (joints)) -> (rotation (9, column by column), position (3),
        jacobian (n, 6))``, all dense, in the base frame. A row of the Jacobian is the velocity of
        the tip's origin, then the angular velocity, for unit change of that parameter.
    """
    theta = ca.SX.sym("theta", len(names))
    moving = [s for s in segments if s.motion != "fixed"]
    q = ca.SX.sym("q", len(moving))
    walk = _Walk(names, theta, nominal)
    if gravity is not None and any(walk.matters(n) for s in moving for n in s.names(COMPLIANCE)):
        # A per cent of a deflection is nothing: the torque is that of the arm as the URDF has it.
        drawn = {
            name: float(x)
            for s in segments
            for name, x in zip(s.names(*POSITION), s.position, strict=True)
        }
        still = _walked(segments, _Walk([], theta, drawn), q)
        walk.torques = gravity_torques(still.frames, carried, gravity)
    _walked(segments, walk, q)
    outputs = [ca.vec(walk.rotation), walk.position, walk.jacobian().T]
    return ca.Function(
        "forward_kinematics",
        [theta, q],
        [ca.densify(o) for o in outputs],
        ["theta", "q"],
        ["rotation", "position", "jacobian"],
        {"cse": True},
    )


def _walked(segments: Sequence[Segment], walk: _Walk, q: Symbol) -> _Walk:
    readings = iter(range(q.numel()))
    for segment in segments:
        walk.through(segment, None if segment.motion == "fixed" else q[next(readings)])
    return walk


def _snapped(array: FloatArray) -> FloatArray:
    """cos(π/2) is 6e-17 in floating point: make it the zero it stands for, and drop its terms."""
    array = np.array(array, dtype=float)
    for exact in (-1.0, 0.0, 1.0):
        array[np.abs(array - exact) < 4e-16] = exact
    return array
