"""Forward kinematics of a chain whose geometry is unknown, on CasADi symbols.

``T_base_tip(θ, q)`` is the product over the chain's segments of

    Trans(xyz) · R_nominal · exp([rx, ry, rz]) · motion(axis, q + offset)

with the placements and axes of `pin.Model`, and over its inverse where the chain climbs from a
joint's child link to its parent. A joint that mimics another has for its reading ``multiplier · q +
offset`` of that one's. Errors that are no geometry, and that a URDF has no place for, change how
far a joint turns for what its encoder reads:

    angle = (1 + gain) q + offset
            + c1 cos q + s1 sin q + c2 cos 2q + s2 sin 2q
            + ripple_c cos 2Nq + ripple_s sin 2Nq + compliance · τ(q)
            + Σ (coupling[k] q_k + cable_c[k] cos q_k + cable_s[k] sin q_k)
            - ½ backlash · d - hysteresis · h

with q the reading, q_k that of another joint (of the cables' waves a neighbour), N the ratio of the
joint's gear, τ the torque of gravity about the joint's axis (`gravity`), and d the direction of its
last motion: 1 towards larger readings, -1 towards smaller ones, 0 where nobody says. In a recording
in motion play and friction follow from the ways s₀, s₁, … that led to the reading
(`geometry.travel`):

    ½ backlash · d = sign(s₀) min(|s₀|, ½ backlash) + Σ sign(sₖ) min(|sₖ|, backlash)
    h = ½ sign(s₀) (1 - exp(-2 |s₀| / decay)) + Σ sign(sₖ) (1 - exp(-|sₖ| / decay))

A prismatic joint has gain, couplings, backlash and hysteresis only. Any joint that moves bends:
before its motion stands

    exp(compliance_x τ_x(q) e_x + compliance_y τ_y(q) e_y)

with e_x and e_y the axes across its own (`Segment.across`), turned by its offset. Lengths grow with
warmth t, how far the arm is above the temperature of its drawing: for xyz stands
xyz (1 + (links.expansion + joint.expansion) t), all links alike or each by itself. A gear ratio, a
counted turn or a scale that is not what it should be is a gain. An encoder disc that sits off its
axis, or a shaft that is bent, gives the first harmonic; a disc that is tilted or oval the second
(Mooring, Roth, Driels, Fundamentals of Manipulator Calibration, 1991, chapter 2). Play between an
encoder on the motor and the link is backlash: the link lags by half of it, on the side that the
joint came from. Friction along a cable or in a bearing lets it lag too: the farther it has come
since it turned, the more, in the end by half of its hysteresis (Dahl, A solid friction model, 1968;
Ruderman, Hoffmann, Bertram, Modeling and identification of elastic robot joints with hysteresis and
backlash, 2009). A strain wave gear errs twice with each turn of its wave generator, which turns N
times with the joint (Tuttle, Seering, A nonlinear model of a harmonic drive gear transmission,
1996). Where a motor stands on an earlier link and drives its joint through a parallelogram, a belt
or a hollow shaft, the joints in between turn it too: couplings, between joints that both turn or
both slide. A cable that runs about the axis of a neighbour is longer or shorter as that one turns.

The Jacobian is written as the geometric Jacobian of every parameter (an axis through a point)
rather than left to differentiation: a column then costs a cross product, not another walk along
the chain.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import casadi as ca
import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.symbols import Symbol
from suta_calib.geometry.travel import TURNS, Said
from suta_calib.model.chain import LoopJoints
from suta_calib.model.gravity import Load, MovingFrame, gravity_torques
from suta_calib.model.loop_kinematics import PlanarLoop, Reach
from suta_calib.model.parameters import (
    BACKLASH,
    BENDING,
    CABLE,
    COMPLIANCE,
    DECAY,
    EXPANSION,
    GAIN,
    GEAR_RATIO,
    HYSTERESIS,
    LEAST_DECAY,
    LINKS,
    MASS,
    NOMINAL_DECAY,
    OFFSET,
    PLACEMENT,
    POSITION,
    RIPPLE,
    ROTATION,
    SHARE,
    coupling_key,
)
from suta_calib.model.segment_steps import (
    lag_by_friction,
    lag_by_play,
    lean_of_link,
    turn_about_axis,
    turn_by_vector,
    velocity_of_turn,
)
from suta_calib.model.tilt import MOUNT, TURN, UP, TiltedLink

Motion = Literal["revolute", "prismatic", "fixed"]
# From which side joints came, how warm the arm was, what its tip carried, how links leaned, and how
# joints moved.
Condition = Said


@dataclass(frozen=True, eq=False)
class Segment:
    """One joint of the chain, fixed ones included.

    Attributes:
        owner: of its parameters: the joint's name, or the tip frame's.
        motion: how it moves.
        rotation: (3, 3) nominal rotation of its origin in the parent link.
        position: (3,) nominal position of its origin in the parent link, m.
        axis: (3,) unit axis in the joint's frame.
        column: which of the samples' readings moves it, from 0; of no meaning for a fixed one.
        multiplier, shift: the joint's own reading is ``multiplier · reading + shift``: 1 and 0
            where it mimics none.
        climbed: whether the chain passes it from child to parent.
        others: the columns of the readings that may move it too, by the joint they are of.
        neighbours: those of them whose cables may run about its axis, of joints that turn.
        passive: whether it has no encoder: a closed loop moves it.
    """

    owner: str
    motion: Motion
    rotation: FloatArray
    position: FloatArray
    axis: FloatArray
    column: int = 0
    multiplier: float = 1.0
    shift: float = 0.0
    climbed: bool = False
    others: Mapping[str, int] = field(default_factory=dict)
    passive: bool = False
    neighbours: tuple[str, ...] = ()

    @property
    def keys(self) -> tuple[str, ...]:
        """Of its six placement parameters, and of its offset if it is read."""
        return (*PLACEMENT, OFFSET) if self.read else PLACEMENT

    @property
    def read(self) -> bool:
        """Whether a reading says where it is, its own or one that it follows."""
        return self.motion != "fixed" and not self.passive

    def names(self, *keys: str) -> list[str]:
        """Of its parameters with these keys."""
        return [f"{self.owner}.{key}" for key in keys]

    @cached_property
    def across(self) -> FloatArray:
        """(3, 2) the axes e_x and e_y across its own, about which it bends, in the joint's frame.

        They stand still on the parent link. Of an axis along z they are the frame's x and y, of one
        along x they are y and z, of one along y they are z and x. Of any other axis they are those
        of the frame's axis that is nearest to it, turned until they are across it.
        """
        nearest = int(np.argmax(np.abs(self.axis) + 1e-9 * np.array([0, 1, 2])))
        following = np.eye(3)[(nearest + 1) % 3]
        first = following - (following @ self.axis) * self.axis
        first /= np.linalg.norm(first)
        second = np.cross(self.axis, first) * np.sign(self.axis[nearest])
        return np.stack([first, second], axis=1)

    @property
    def couplings(self) -> dict[str, str]:
        """Names of its couplings, with the joint whose reading each of them takes."""
        return dict(zip(self.names(*map(coupling_key, self.others)), self.others, strict=True))

    @property
    def cables(self) -> tuple[str, ...]:
        """Names of what its neighbours' cables do to it: the cosine and the sine of each."""
        keys = (coupling_key(joint, key) for joint in self.neighbours for key in CABLE)
        return tuple(self.names(*keys))


# By passive joint: its angle, and what it turns per unit of each parameter.
Passive = dict[str, tuple[Symbol, Mapping[str, Symbol]]]


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """A closed loop of the arm: its two branches, from the link above both to their ends."""

    loop: PlanarLoop
    branches: tuple[tuple[Segment, ...], tuple[Segment, ...]]


@dataclass(frozen=True, eq=False)
class HangingArm:
    """What hangs on joints of a chain and moves with joints of another chain of the robot.

    Attributes:
        carriers: how many of the chain's moving joints carry it, from the base on.
        segments: from the last of these on, fixed ones of the chain included.
        loads: of those of its moving segments whose motion counts.
    """

    carriers: int
    segments: tuple[Segment, ...]
    loads: tuple[Load, ...]

    def moment_change(self, frame: MovingFrame, nominal: Mapping[str, float], q: Symbol) -> Symbol:
        """(3,) kg·m, against all these joints at zero.

        Args:
            frame: of the last joint that carries it.
            nominal: parameters by name.
            q: all readings.
        """
        moving = {load.joint for load in self.loads}
        as_drawn = [replace(s, motion="fixed") if s.owner in moving else s for s in self.segments]
        change = ca.SX(3, 1)
        for sign, segments in ((1, self.segments), (-1, as_drawn)):
            walk = _Walk([], ca.SX(0, 1), nominal)
            walk.rotation, walk.position = frame.rotation, frame.position
            for segment in segments:
                walk.along([segment], q)
                for load in self.loads:
                    if load.joint == segment.owner:
                        centre = walk.position + walk.rotation @ ca.DM(load.centre)
                        change += sign * load.mass * centre
        return change


class _Walk:
    """The state of one pass along the chain: the current frame and the columns met so far."""

    def __init__(
        self,
        names: Sequence[str],
        theta: Symbol,
        nominal: Mapping[str, float],
        rows: int | None = None,
    ) -> None:
        self.rotation: Symbol = ca.SX.eye(3)
        self.position: Symbol = ca.SX(3, 1)
        self.index = {name: k for k, name in enumerate(names)}
        self.theta, self.nominal = theta, nominal
        # So many parameters, the first of them, have a column.
        self.rows = len(names) if rows is None else rows
        # (3,) of gravity about each joint's axis and the two across it, by the joint's name.
        self.torques: Mapping[str, Symbol] = {}
        # What is said of a sample beside its readings: a joint of which nothing is said is in the
        # middle of its play, and an arm at the temperature of its drawing.
        self.direction: Symbol | None = None
        self.travel: Symbol | None = None
        self.warmth: Symbol | None = None
        # What sensors on links felt: links lean, by the owner of the segment that leads to them.
        self.felt: Symbol | None = None
        self.up: Symbol | None = None
        self.root_axes = ca.DM.eye(3)
        self.tilted: Mapping[str, TiltedLink] = {}
        self.frames: list[MovingFrame] = []
        # Of the link above base and tip in the base: the frame in which climbing has ended.
        self.top: Symbol = self.rotation
        # Of joints that closed loops move: the angle, and what it turns per unit of parameters.
        self.passive: Passive = {}
        # Of these parameters, which are unknown, the torques are functions.
        self.pulling: list[str] = []
        # Shifts (direction, None) and turns (axis, point it passes through).
        self.ways: list[tuple[Symbol, Symbol | None]] = []
        # column index → which of these the parameter does, and how much of it; None for all of it
        self.columns: dict[int, list[tuple[int, Symbol | None]]] = defaultdict(list)

    def value(self, name: str) -> Symbol:
        k = self.index.get(name)
        return self.theta[k] if k is not None else float(self.nominal.get(name, 0.0))

    def matters(self, name: str) -> bool:
        """Whether a parameter that is usually zero is unknown, or not zero."""
        return name in self.index or bool(self.nominal.get(name))

    def note(
        self, effects: Mapping[str, Symbol | None], direction: Symbol, point: Symbol | None = None
    ) -> None:
        """How much parameters turn about a line through a point, or shift, here; None for 1."""
        unknown = {n: e for n, e in effects.items() if self.index.get(n, self.rows) < self.rows}
        for name, effect in unknown.items():
            self.columns[self.index[name]].append((len(self.ways), effect))
        if unknown:
            self.ways.append((direction, point))

    def along(self, segments: Sequence[Segment], q: Symbol) -> _Walk:
        for segment in segments:
            if segment.climbed:
                self._move(segment, q)
                self._bend(segment)
                self._turn(segment)
                self._shift(segment)
                self.top = self.rotation
            else:
                self._shift(segment)
                self._turn(segment)
                self._bend(segment)
                self._move(segment, q)
            if segment.owner in self.tilted:
                self.lean(self.tilted[segment.owner])
        return self

    def lean(self, link: TiltedLink) -> None:
        """Turn a link by what its sensor felt beyond the model (`model.tilt`)."""
        if self.felt is None:
            return
        sensor, reach = link.sensor, ca.DM(_snapped(link.reach))
        (share, turn), mount = sensor.names(SHARE, TURN), sensor.names(*MOUNT)
        mounted, mount_axes = turn_by_vector()(ca.vertcat(*map(self.value, mount)))
        upright = ca.DM(_snapped(np.array(sensor.upright)))
        turning, along = turn_about_axis()(ca.SX.eye(3), upright, self.value(turn))
        in_link = turning @ mounted @ self.felt[link.column : link.column + 3]
        shown = self.rotation @ in_link
        lean = self.root_axes.T @ ca.vertcat(*map(self.value, UP))
        turned, by_shown, by_lean = lean_of_link()(shown, self.up, lean)
        point = self.position + self.value(share) * (self.rotation @ reach)
        taken_back = dict[int, int]()
        # What turns the model's link turns what was felt with it, and so is taken back.
        for k, (way, at) in enumerate([*self.ways]):
            if at is not None:
                taken_back[k] = len(self.ways)
                back = by_shown @ ca.cross(way, shown) + turned @ way - way
                self.ways.append((back, point))
        for column in self.columns.values():
            column += [(taken_back[k], much) for k, much in column if k in taken_back]
        for k, name in enumerate(UP):
            self.note({name: None}, by_lean @ self.root_axes.T[:, k], point)
        axes = ca.horzcat(along, turning @ mount_axes)
        for k, name in enumerate((turn, *mount)):
            moved = self.rotation @ ca.cross(axes[:, k], in_link)
            self.note({name: None}, by_shown @ moved, point)
        drawn, self.rotation = self.rotation, turned @ self.rotation
        self.note({share: None}, (drawn - self.rotation) @ reach)
        self.position = point - self.value(share) * (self.rotation @ reach)

    def _shift(self, segment: Segment) -> None:
        names, nominal = segment.names(*POSITION), _snapped(segment.rotation)
        if segment.climbed:
            self._rotate(nominal.T)
        axes = -self.rotation if segment.climbed else self.rotation
        along = axes @ ca.vertcat(*map(self.value, names))
        # A joint that is called as all links are has no expansion of its own.
        both = dict.fromkeys(f"{owner}.{EXPANSION}" for owner in (LINKS, segment.owner))
        if grown := [expansion for expansion in both if self.matters(expansion)]:
            warmth = ca.SX(0) if self.warmth is None else self.warmth
            for expansion in grown:
                self.note({expansion: warmth}, along)
            stretch = 1 + sum(map(self.value, grown)) * warmth
            axes, along = axes * stretch, along * stretch
        for k, name in enumerate(names):
            if name in self.index:
                self.note({name: None}, axes[:, k])
        self.position += along
        if not segment.climbed:
            self._rotate(nominal)

    def _rotate(self, nominal: FloatArray) -> None:
        if not np.array_equal(nominal, np.eye(3)):
            self.rotation = self.rotation @ ca.DM(nominal)

    def _turn(self, segment: Segment) -> None:
        names = segment.names(*ROTATION)
        if not any(map(self.matters, names)):
            return
        about = self._turned(segment, ca.vertcat(*map(self.value, names)))
        for k, name in enumerate(names):
            self.note({name: None}, about[:, k], self.position)

    def _turned(self, segment: Segment, vector: Symbol) -> Symbol:
        """The axes (3, 3) of a turn's components, in the base, once it is made."""
        turn, axes = turn_by_vector()(vector)
        if segment.climbed:
            self.rotation = self.rotation @ turn.T
            return -self.rotation @ axes
        about = self.rotation @ axes
        self.rotation = self.rotation @ turn
        return about

    def _bend(self, segment: Segment) -> None:
        names = segment.names(*BENDING)
        if segment.owner not in self.torques or not any(map(self.matters, names)):
            return
        across, torques = self._across(segment), self.torques[segment.owner][1:]
        turn = across @ (ca.vertcat(*map(self.value, names)) * torques)
        slid, before = self._slid(segment), self.rotation
        if slid is not None:
            self.position += before @ slid
        axes = self._turned(segment, turn)
        for k, name in enumerate(names):
            if self.matters(name):
                pulls = self._pulls(torques[k], self.value(name))
                self.note({name: torques[k], **pulls}, axes @ across[:, k], self.position)
        (offset,), axis = segment.names(OFFSET), ca.DM(_snapped(segment.axis))
        if slid is not None:
            # It bends where its offset has put it.
            self.position -= self.rotation @ slid
            self.note({offset: None}, (before - self.rotation) @ axis)
        elif self.matters(offset):
            self.note({offset: None}, axes @ ca.cross(axis, turn), self.position)

    def _across(self, segment: Segment) -> Symbol:
        """(3, 2) the axes across a joint's own, turned by its offset as in a calibrated URDF."""
        (offset,), across = segment.names(OFFSET), ca.DM(_snapped(segment.across))
        if segment.motion != "revolute" or not self.matters(offset):
            return across
        axis = ca.DM(_snapped(segment.axis))
        return turn_about_axis()(ca.SX.eye(3), axis, self.value(offset))[0] @ across

    def _slid(self, segment: Segment) -> Symbol | None:
        """(3,) how far its offset moves the origin of a joint that slides, in the joint's frame."""
        (offset,) = segment.names(OFFSET)
        if segment.motion != "prismatic" or not self.matters(offset):
            return None
        return ca.DM(_snapped(segment.axis)) * self.value(offset)

    def _pulls(self, torque: Symbol, compliance: Symbol) -> dict[str, Symbol | None]:
        """What parameters that a torque depends on make a joint yield more, by their names."""
        if not self.pulling:
            return {}
        slopes = ca.jacobian(torque, ca.vertcat(*map(self.value, self.pulling)))
        return {
            name: compliance * slopes[k] for k, name in enumerate(self.pulling) if slopes[k].nnz()
        }

    def _move(self, segment: Segment, q: Symbol) -> None:
        if segment.motion == "fixed":
            return
        if segment.passive:
            reading, by_loop = self.passive[segment.owner]
        else:
            reading, by_loop = q[segment.column], {}
        if (segment.multiplier, segment.shift) != (1.0, 0.0):
            reading = segment.multiplier * reading + segment.shift
        axis, way = ca.DM(_snapped(segment.axis)), -1 if segment.climbed else 1
        point, before = self.position, (self.rotation, self.position)
        turns = segment.motion == "revolute"
        amount, effects = reading, dict[str, Symbol | None](by_loop)
        for name, effect in self._beside_the_reading(segment, reading, q):
            amount += self.value(name) if effect is None else self.value(name) * effect
            effects[name] = effect
        for much, slopes in self._beyond_linear(segment, reading):
            amount += much
            effects |= slopes
        spun, along = turn_about_axis()(self.rotation, axis, way * amount)
        turned = way * along
        self.note(effects, turned, point if turns else None)
        (compliance,) = segment.names(COMPLIANCE)
        if segment.owner in self.torques and self.matters(compliance):
            # What an offset or a coupling turns, gravity pulls at elsewhere; at more mass, more.
            pulls = self._pulls(self.torques[segment.owner][0], self.value(compliance))
            self.note(pulls, turned, point)
        if turns:
            self.rotation = spun
        else:
            self.position += turned * amount
        ends = before, (self.rotation, self.position)
        # The parent link's side of the motion, and the child link's.
        (fixed, root), behind = reversed(ends) if segment.climbed else ends
        if (slid := self._slid(segment)) is not None:
            root = root + fixed @ slid
        axes = ca.horzcat(along, fixed @ self._across(segment))
        self.frames.append(MovingFrame(segment.owner, axes, root, *behind, segment.climbed))

    def _beside_the_reading(
        self, segment: Segment, reading: Symbol, q: Symbol
    ) -> Iterator[tuple[str, Symbol | None]]:
        """Names of its offset and of errors that are no geometry, with its turn per unit."""
        if segment.passive:
            return
        turns: dict[str, Callable[[], Symbol | None]] = {
            OFFSET: lambda: None,
            GAIN: lambda: reading,
        }
        if segment.motion == "revolute":
            turns |= {
                "ecc_c1": lambda: ca.cos(reading),
                "ecc_s1": lambda: ca.sin(reading),
                "ecc_c2": lambda: ca.cos(2 * reading),
                "ecc_s2": lambda: ca.sin(2 * reading),
                COMPLIANCE: lambda: self.torques[segment.owner][0],
            }
        for name, turn in zip(segment.names(*turns), turns.values(), strict=True):
            if self.matters(name):
                yield name, turn()
        for name, joint in segment.couplings.items():
            if self.matters(name):
                yield name, q[segment.others[joint]]
        waves = [
            wave(q[segment.others[joint]])
            for joint in segment.neighbours
            for wave in (ca.cos, ca.sin)
        ]
        yield from (
            pair for pair in zip(segment.cables, waves, strict=True) if self.matters(pair[0])
        )

    def _beyond_linear(
        self, segment: Segment, reading: Symbol
    ) -> Iterator[tuple[Symbol, dict[str, Symbol]]]:
        """How far a joint turns for what is no factor, and its turn per unit of each parameter."""
        if segment.passive:
            return
        backlash, hysteresis, decay = segment.names(BACKLASH, HYSTERESIS, DECAY)
        travel = self._travel_of(segment)
        if self.matters(backlash):
            yield self._play(segment, backlash, travel)
        if travel is not None and self.matters(hysteresis):
            unit: Literal["m", "rad"] = "m" if segment.motion == "prismatic" else "rad"
            least = LEAST_DECAY * NOMINAL_DECAY[unit]
            way = ca.fmax(self.value(decay), least)
            size = self.value(hysteresis)
            by_size, by_way = lag_by_friction()(travel, way)
            yield size * by_size, {hysteresis: by_size, decay: size * by_way}
        ratio, *waves = segment.names(GEAR_RATIO, *RIPPLE)
        if segment.motion == "revolute" and self.matters(ratio) and any(map(self.matters, waves)):
            phase, (c, s) = 2 * self.value(ratio) * reading, map(self.value, waves)
            cosine, sine = ca.cos(phase), ca.sin(phase)
            by_ratio = 2 * reading * (s * cosine - c * sine)
            slopes = dict(zip((*waves, ratio), (cosine, sine, by_ratio), strict=True))
            yield c * cosine + s * sine, slopes

    def _travel_of(self, segment: Segment) -> Symbol | None:
        """(TURNS,) ways of the joint itself, where the samples are of a recording."""
        if self.travel is None:
            return None
        first = TURNS * segment.column
        return segment.multiplier * self.travel[first : first + TURNS]

    def _play(
        self, segment: Segment, name: str, travel: Symbol | None
    ) -> tuple[Symbol, dict[str, Symbol]]:
        """How far a joint lags behind its reading because of backlash; a column tells it first."""
        width, by_direction = self.value(name), None
        if self.direction is not None:
            direction = math.copysign(1.0, segment.multiplier) * self.direction[segment.column]
            by_direction = -0.5 * width * direction, -0.5 * direction
        if travel is None:
            lag, slope = by_direction or (ca.SX(0), ca.SX(0))
        else:
            lag, slope = lag_by_play()(travel, width)
            if by_direction is not None:
                lag, slope = (
                    ca.if_else(direction == 0, own, stated)
                    for own, stated in zip((lag, slope), by_direction, strict=True)
                )
        return lag, {name: slope}

    def jacobian(self) -> Symbol:
        """(6, rows): linear over angular velocity of the tip in the base frame, per parameter."""
        twist, rows = velocity_of_turn(), [ca.SX(6, 0)]
        done = [
            twist(way, self.position - point) if point is not None else ca.vertcat(way, ca.SX(3, 1))
            for way, point in self.ways
        ]
        for k in range(self.rows):
            parts = [done[way] * (1 if much is None else much) for way, much in self.columns[k]]
            rows.append(sum(parts[1:], parts[0]) if parts else ca.SX(6, 1))
        return ca.horzcat(*rows)


def forward_kinematics(
    segments: Sequence[Segment],
    names: Sequence[str],
    nominal: Mapping[str, float],
    carried: Sequence[Load] = (),
    gravity: FloatArray | None = None,
    conditions: Sequence[Condition] = (),
    rows: int | None = None,
    width: int = 0,
    loops: Sequence[ClosedLoop] = (),
    hung: Sequence[HangingArm] = (),
    tilted: Sequence[TiltedLink] = (),
    root_axes: FloatArray | None = None,
) -> Symbol:
    """The chain's kinematics as a CasADi function of the named parameters and one sample.

    Args:
        segments: base to tip.
        names: the parameters that become inputs, in this order.
        nominal: what all others stay at, by name; zero where it is not given.
        carried: loads of the moving segments, needed where a joint yields.
        gravity: (3,) in the frame of the link where the chain begins to descend, m/s², needed
            likewise.
        conditions: what is said of a sample beside its readings.
        rows: of the Jacobian, of so many parameters, the first ones; of all by default.
        width: columns of readings, of which the chain may need but some; as many as it needs by
            default.
        loops: closed loops that move passive joints, in the order in which they are solved.
        hung: what hangs on the chain's joints and moves with readings of other chains.
        tilted: links whose lean was measured, where it is told.
        root_axes: (3, 3) rotation of the base in the root link, about whose axes "up" leans; the
            base itself by default.

    Returns:
        ``ca.Function(theta (n), q (readings)) -> (rotation (9, column by column), position (3),
        jacobian (rows, 6))``, all dense, in the base frame. What is told are further inputs, in
        the order of ``conditions``: ``direction (readings)``; ``warmth (1)``, K; ``payload (4)``,
        the mass, kg, that the tip carries and its centre in the tip's frame, m; ``tilt (3 for each
        of the tilted links)``, unit vectors, or zeros where nothing was felt; ``travel (readings ·
        TURNS)``, the first joint's first. A row of the Jacobian is the velocity of the tip's
        origin, then the angular velocity, for unit change of that parameter.
    """
    theta = ca.SX.sym("theta", len(names))
    moving = [s for s in segments if s.motion != "fixed"]
    q = ca.SX.sym("q", max(width, 1 + max((s.column for s in moving), default=-1)))
    walk = _Walk(names, theta, nominal, rows)
    inputs = {"theta": theta, "q": q}
    sizes: dict[Condition, int] = {
        **{"direction": q.numel(), "warmth": 1, "payload": 4},
        **{"tilt": 3 * len(tilted), "travel": TURNS * q.numel()},
    }
    for name in conditions:
        inputs[name] = ca.SX.sym(name, sizes[name])
    yielding = (n for s in moving for n in s.names(COMPLIANCE, *BENDING))
    if gravity is not None and any(map(walk.matters, yielding)):
        # A per cent of a deflection is nothing: the torque is that of the arm as the URDF has it.
        drawn = _drawn(segments, nominal)
        # But a zero that was set by hand, or a coupling, turns the links as a reading does; and
        # masses pull.
        masses = {f"{load.joint}.{MASS}": load.mass for load in carried}
        turning = [n for s in moving for n in _turning(s)]
        drawn |= {n: nominal.get(n, mass) for n, mass in masses.items()}
        pulling = {*masses, *turning}
        walk.pulling = [n for n in names if n in pulling]
        those = ca.vertcat(*map(walk.value, walk.pulling))
        still = _Walk(walk.pulling, those, drawn).along(segments, q)
        pulled = [replace(w, mass=still.value(n)) for n, w in zip(masses, carried, strict=True)]
        at_tip = still.rotation, still.position, inputs.get("payload")
        moved = [
            (branch.carriers, branch.moment_change(still.frames[branch.carriers - 1], lengths, q))
            for branch in hung
            for lengths in [_drawn(branch.segments, nominal)]
        ]
        down = still.top @ ca.DM(gravity)
        walk.torques = gravity_torques(still.frames, pulled, down, at_tip, moved)
    walk.direction, walk.warmth = inputs.get("direction"), inputs.get("warmth")
    walk.travel = inputs.get("travel")
    if tilted and gravity is not None:
        walk.felt, walk.up = inputs.get("tilt"), ca.DM(-gravity / np.linalg.norm(gravity))
        walk.root_axes = ca.DM.eye(3) if root_axes is None else ca.DM(_snapped(root_axes))
        walk.tilted = {link.behind: link for link in tilted}
    for loop in loops:
        _close(loop, walk, q)
    if "" in walk.tilted:
        walk.lean(walk.tilted[""])
    walk.along(segments, q)
    outputs = [ca.vec(walk.rotation), walk.position, walk.jacobian().T]
    return ca.Function(
        "forward_kinematics",
        list(inputs.values()),
        [ca.densify(o) for o in outputs],
        list(inputs),
        ["rotation", "position", "jacobian"],
    )


def _turning(segment: Segment) -> tuple[str, ...]:
    """What turns the links beyond a joint as its reading does."""
    return (*segment.names(OFFSET), *segment.couplings)


def _drawn(segments: Sequence[Segment], nominal: Mapping[str, float]) -> dict[str, float]:
    """Lengths of the drawing, and zeros and couplings as they are."""
    drawn = {
        name: float(x)
        for s in segments
        for name, x in zip(s.names(*POSITION), s.position, strict=True)
    }
    turning = (n for s in segments if s.motion != "fixed" for n in _turning(s))
    return drawn | {n: nominal.get(n, 0.0) for n in turning}


def closed_loop(loop: LoopJoints, by_joint: Mapping[str, Segment]) -> ClosedLoop:
    """A loop of the URDF with the segments of its joints."""
    first, second = (
        tuple(replace(by_joint[joint.name], climbed=False) for joint in branch)
        for branch in loop.branches
    )
    places = {
        j.name: (b, k) for b, branch in enumerate(loop.branches) for k, j in enumerate(branch)
    }
    # Of two in one branch, the one that carries the other comes first.
    one, two = sorted(loop.passive, key=places.__getitem__)
    senses = loop.drawn_senses
    branch = places[one][0], places[two][0]
    planar = PlanarLoop((one, two), branch, (senses[one], senses[two]), loop.axis, 1.0)
    return ClosedLoop(replace(planar, side=_side(planar, (first, second))), (first, second))


def _side(planar: PlanarLoop, branches: tuple[tuple[Segment, ...], ...]) -> float:
    """On which side the loop is assembled, with all joints at zero."""
    drawn = {
        name: float(x)
        for branch in branches
        for s in branch
        for name, x in zip(s.names(*POSITION), s.position, strict=True)
    }
    columns = 1 + max((s.column for branch in branches for s in branch), default=0)

    def reach(branch: int, angles: Symbol) -> tuple[dict[str, tuple[Symbol, Symbol]], Symbol]:
        along = _Walk([], ca.SX(0, 1), drawn)
        # Joints that earlier loops move are at zero too.
        along.passive = {s.owner: (ca.SX(0), {}) for b in branches for s in b if s.passive}
        along.passive |= {n: (angles[k], {}) for k, n in enumerate(planar.passive)}
        along.along(branches[branch], ca.SX(columns, 1))
        at = {frame.joint: (frame.axes[:, 0], frame.point) for frame in along.frames}
        return at, along.position

    return planar.drawn_side(reach)


def passive_angles(loops: Sequence[ClosedLoop], nominal: Mapping[str, float], width: int) -> Symbol:
    """CasADi function of readings (width): an angle for each passive joint, called as the joint.

    Before them a number (loops), m: how far apart the ends of each loop stay where it cannot close.
    """
    q = ca.SX.sym("q", width)
    walk, gaps = _Walk([], ca.SX(0, 1), nominal), list[Symbol]()
    for loop in loops:
        gaps.append(loop.loop.apart(_reach(loop, walk, q)))
        _close(loop, walk, q)
    angles = [angle for angle, _ in walk.passive.values()]
    outputs = [ca.densify(output) for output in (ca.vertcat(*gaps), *angles)]
    return ca.Function("passive", [q], outputs, ["q"], ["apart", *walk.passive])


def _reach(loop: ClosedLoop, walk: _Walk, q: Symbol) -> Reach:
    """The branches of a loop without columns: only points of axes and ends are asked."""

    def reach(branch: int, angles: Symbol) -> tuple[dict[str, tuple[Symbol, Symbol]], Symbol]:
        along = _Walk([*walk.index], walk.theta, walk.nominal, rows=0)
        along.direction, along.warmth = walk.direction, walk.warmth
        along.travel = walk.travel
        turned: Passive = {name: (angles[k], {}) for k, name in enumerate(loop.loop.passive)}
        along.passive = {**walk.passive, **turned}
        along.along(loop.branches[branch], q)
        at = {frame.joint: (frame.axes[:, 0], frame.point) for frame in along.frames}
        return at, along.position

    return reach


def _close(loop: ClosedLoop, walk: _Walk, q: Symbol) -> None:
    """Tell a walk the angles of a loop's passive joints, and how they change with parameters."""
    given = (walk.direction, walk.warmth, walk.travel)
    conditions = [c for c in given if c is not None]
    reach = _reach(loop, walk, q)
    angles, slopes = loop.loop.solved(reach, walk.theta, [q, *conditions])
    for k, name in enumerate(loop.loop.passive):
        columns = {n: slopes[k, j] for n, j in walk.index.items() if slopes[k, j].nnz()}
        walk.passive[name] = angles[k], columns


def _snapped(array: FloatArray) -> FloatArray:
    """cos(π/2) is 6e-17 in floating point: make it the zero it stands for, and drop its terms."""
    array = np.array(array, dtype=float)
    for exact in (-1.0, 0.0, 1.0):
        array[np.abs(array - exact) < 4e-16] = exact
    return array
