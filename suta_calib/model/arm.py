"""The arm whose geometry is unknown: one chain of a URDF, as Pinocchio reads it."""

from __future__ import annotations

import math
import pickle
from collections.abc import Container, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property, lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, final

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from suta_calib import plotting
from suta_calib.arrays import FloatArray
from suta_calib.batched import Batched
from suta_calib.errors import ParameterError, UrdfError, did_you_mean
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.geometry.symbols import Symbol
from suta_calib.inputs import XacroFile
from suta_calib.model.bodies import ALONE, Bodies
from suta_calib.model.chain import Chain, ChainJoint, chain_of
from suta_calib.model.gravity import Load, beyond
from suta_calib.model.kinematic_urdf import moving_model
from suta_calib.model.kinematics import (
    ClosedLoop,
    Condition,
    HangingArm,
    Segment,
    closed_loop,
    forward_kinematics,
    passive_angles,
)
from suta_calib.model.loop import Loop, with_loops
from suta_calib.model.mechanism import Mechanism
from suta_calib.model.parameters import (
    BENDING,
    COMPLIANCE,
    EXPANSION,
    LINKS,
    MASS,
    OFFSET,
    POSITION,
    Parameter,
    ParameterSet,
)
from suta_calib.model.segments import geometric_parameters, nongeometric_parameters, segment_of
from suta_calib.model.skeleton import Skeleton
from suta_calib.model.tilt import TiltedLink, TiltSensor, up_parameters
from suta_calib.model.urdf import folded_origin
from suta_calib.model.urdf_tree import read_tree
from suta_calib.plotting.scene import Scene


def configuration_of(model: pin.Model, motions: Mapping[str, float]) -> FloatArray:
    """The configuration of a model whose joints have moved so far, rad or m; others rest."""
    tangent = np.zeros(model.nv)
    for joint, amount in motions.items():
        tangent[model.joints[model.getJointId(joint)].idx_v] = amount
    return np.asarray(pin.integrate(model, pin.neutral(model), tangent))


def tip_owner(chain: Chain) -> dict[str, str]:
    """By the fixed joint that carries the tip, if one does: what its parameters are called."""
    last = chain.joints[-1]
    return {} if last.moving or last.climbed else {last.name: chain.tip}


@final
class ArmModel(Mechanism):
    """A chain base → tip through the tree of a URDF, with a parametric geometry.

    Build one with `from_urdf`; `at` gives the same arm at other values. Readings ``q`` are
    (n, joints) in the order of `joints`, rad for revolute joints and m for prismatic ones, as the
    encoders report them. A joint that mimics another has its own parameters and no reading.

    Attributes:
        chain: the joints as the URDF's text gives them, base → tip, fixed ones included.
        model: `pin.Model` in which the chain's joints move, and all others are fixed.
        segments: the same chain as Pinocchio understood it.
        parameters: every placement and offset that could be unknown, all at nominal.
        grades: how it was made, of `measurements.scale.GRADES`, and so how far held dimensions may
            be from the drawing; empty where nobody says it. In a cell by robot, else by no name.
        nongeometric: gain of its joints, and coupling of each to every other of its kind;
            eccentricity, compliance and backlash of its revolute ones; bending of its joints;
            expansion of its links, together and each by itself (`kinematics`): zero unless the arm
            is held at other values. And the masses that its joints carry, as the URDF has them.
        readings: the joints whose readings the samples hold, in the order of their columns: those
            of the chain; of a chain of a `Robot` those of all its chains.
        bodies: what labels call its base and its tip, for a chain of a `Robot`.
        beside: parameters of the other chains of its `Robot`: nothing of this one depends on them.
        gravity: (3,) along the axes of the URDF's root link, m/s².
        hung: what hangs on its joints and moves with those of other chains of its `Robot`.
        tilted: its links with a tilt sensor, base → tip.
    """

    def __init__(
        self, chain: Chain, model: pin.Model, tips: Mapping[str, str] = MappingProxyType({})
    ) -> None:
        self.chain = chain
        self.model = model
        self.grades: Mapping[str, str] = {"": ""}
        self.gravity = model.gravity.linear.copy()
        self.readings = chain.moving
        self.bodies = ALONE
        self.beside = ParameterSet()
        self.hung: tuple[HangingArm, ...] = ()
        self.tilted: tuple[TiltedLink, ...] = ()
        # A fixed joint that carries the tip is known by the tip's name, all others by their own.
        tip = {**tips, **tip_owner(chain)}
        columns = {joint.name: k for k, joint in enumerate(chain.moving)}
        sliding = {joint.name for joint in chain.moving if joint.type == "prismatic"}
        data = model.createData()
        self.segments = tuple(
            segment_of(model, data, j, tip.get(j.name, j.name), columns, sliding)
            for j in chain.joints
        )
        self.loop_segments = tuple(
            segment_of(model, data, j, tip.get(j.name, j.name), columns, sliding)
            for j in chain.beside
        )
        every = (*self.segments, *self.loop_segments)
        self.parameters = ParameterSet(p for s in every for p in geometric_parameters(s))
        masses = {load.joint: load.mass for load in self.loads}
        beside = [p for s in every for p in nongeometric_parameters(s, masses.get(s.owner, 0.0))]
        self.nongeometric = ParameterSet([*beside, Parameter(LINKS, EXPANSION, "1/K")])

    @classmethod
    def from_urdf(
        cls,
        urdf: str | Path | XacroFile,
        tip: str,
        base: str | None = None,
        loops: Sequence[Loop] = (),
    ) -> ArmModel:
        """Read the chain from ``base`` to ``tip``: any two links or frames of one tree.

        Args:
            urdf: the path of a URDF, or of a ``.xacro`` file that makes one, as an `XacroFile` with
                values of its arguments; or the text of a URDF, which begins with ``<``.
            tip: name of a link, or of a joint, which stands for its child link.
            base: the same; the root link by default.
            loops: closed loops that hang on the tree, of which the URDF says nothing.

        Raises:
            UrdfError: no such file, link, chain or loop, or a chain with a joint that is not
                revolute, continuous, prismatic or fixed (`chain.read_chain`).
        """
        tree = read_tree(urdf)
        chain = with_loops(tree, chain_of(tree, tip, base), loops)
        return cls(chain, moving_model(tree, chain))

    def at(self, values: Mapping[str, float]) -> ArmModel:
        """The same arm with these values as its nominal ones, those of no geometry included.

        ``arm.at(values).forward(q)`` is ``arm.forward(q, values)``, and their derivatives agree,
        but what is nominal costs nothing: with the whole geometry at other values that is six
        times faster. `chain`, `model` and `segments` stay those of the URDF.

        Args:
            values: parameter values by name; names of other things than this arm are ignored.

        Raises:
            ParameterError: something else than values by name.
            UrdfError: a joint that yields, and nothing beyond it has a mass.
        """
        if not isinstance(values, Mapping):
            raise ParameterError(repr(values), "values by name: {'joint_2.offset': 0.01}")
        arm = self._renewed()
        arm.parameters, arm.nongeometric = (
            ParameterSet(
                replace(p, nominal=float(values[n])) if n in values else p for n, p in s.items()
            )
            for s in (self.parameters, self.nongeometric)
        )
        arm.check_masses(n for n, p in arm.nongeometric.items() if p.nominal)
        return arm

    def of_grade(self, grade: str | Mapping[str, str]) -> ArmModel:
        """The same arm, made like this: one of `measurements.scale.GRADES`; in a cell by robot."""
        arm = copy(self)
        arm.grades = {"": grade} if isinstance(grade, str) else grade
        passed = {arm.maker(segment.owner) for segment in self.segments}
        arm.grades = {robot: made for robot, made in arm.grades.items() if robot in passed}
        return arm

    def with_gravity(self, direction: ArrayLike) -> ArmModel:
        """The same arm, mounted so that gravity points in this direction.

        Args:
            direction: (3,) along the axes of the URDF's root link, of any length but zero.

        Raises:
            ParameterError: no direction.
        """
        down = np.asarray(direction, dtype=float)
        size = float(np.linalg.norm(down)) if down.shape == (3,) else 0.0
        if not (math.isfinite(size) and size > 0.0):
            raise ParameterError(repr(direction), "x, y, z of a direction", where="gravity")
        arm = self._renewed()
        arm.gravity = down / size * float(np.linalg.norm(self.gravity))
        return arm

    def with_tilt_sensors(
        self, sensors: Sequence[TiltSensor], reaches: Mapping[str, FloatArray] | None = None
    ) -> ArmModel:
        """The same arm, whose links lean by what accelerometers on them felt (`model.tilt`).

        Args:
            sensors: at most one for each link.
            reaches: (3,) from a link's origin to the joints that it carries, m, by its name; by
                default to the next joint of the chain that moves.

        Raises:
            UrdfError: a link that the chain does not have, that has two, or that is between another
                tip, where the chain begins, and the link above both.
        """
        by_link = dict[str, TiltSensor]()
        for sensor in sensors:
            problem = ""
            if sensor.link not in self.links:
                expected = f"a link of the chain: {', '.join(self.links)}"
            elif sensor.link in by_link:
                problem, expected = f"two tilt sensors on {sensor.link}", "one of them"
            else:
                by_link[sensor.link] = sensor
                climbs = any(joint.climbed for joint in self.chain.joints)
                if not climbs or sensor.link == self.chain.top:
                    continue
                problem = f"a tilt sensor on {sensor.link}, in a chain that begins at another tip"
                expected = "a sensor on a link below both: only there is up a fixed direction"
            raise UrdfError(
                problem or f"a tilt sensor on the link '{sensor.link}'",
                expected,
                file=self.chain.path,
                where="tilt_sensors",
                hint="" if problem else did_you_mean(sensor.link, self.links),
            )
        arm, given = self._renewed(), reaches or {}
        # What leans the link above both ends of a chain leans both alike.
        leaning = [
            link for link in self.links if link in by_link and not self.chain.joints[0].climbed
        ]
        arm.tilted = tuple(
            TiltedLink(
                self._upright(by_link[link]),
                self.links[link],
                given[link] if link in given else self.carried_by(link)[1],
                3 * k,
            )
            for k, link in enumerate(leaning)
        )
        more = [p for tilted in arm.tilted for p in tilted.sensor.parameters]
        more += up_parameters() if arm.tilted else ()
        arm.nongeometric = ParameterSet([*self.nongeometric.values(), *more])
        return arm

    def _upright(self, sensor: TiltSensor) -> TiltSensor:
        """A sensor of which it is known which way is up in its link."""
        if sensor.upright is not None:
            return sensor
        rotation, _ = self.link_poses(sensor.link, np.zeros((1, len(self.joints))))
        x, y, z = (self.up @ rotation[0]).tolist()
        return replace(sensor, upright=(x, y, z))

    @property
    def links(self) -> dict[str, str]:
        """Links of the chain, base → tip, each with the owner of the segment that leads to it."""
        links = {self.chain.base: ""}
        for joint, segment in zip(self.chain.joints, self.segments, strict=True):
            links[joint.parent if joint.climbed else joint.child] = segment.owner
        return links

    @property
    def root_axes(self) -> FloatArray:
        """(3, 3) rotation of the link above base and tip in the URDF's root link."""
        # Nothing between the two moves with the chain.
        top = self.model.frames[self.model.getFrameId(self.chain.top, pin.FrameType.BODY)]
        return np.asarray(top.placement.rotation)

    @property
    def down(self) -> FloatArray:
        """(3,) gravity along the axes of the link above base and tip, m/s²."""
        return np.asarray(self.root_axes.T @ self.gravity)

    @property
    def up(self) -> FloatArray:
        """(3,) of unit length, the other way."""
        return -self.down / np.linalg.norm(self.down)

    def link_poses(
        self, link: str, q: FloatArray, values: Mapping[str, float] = MappingProxyType({})
    ) -> tuple[FloatArray, FloatArray]:
        """Orientations (n, 3, 3), positions (n, 3) of a link in the base; nothing yields or leans.

        Args:
            link: of the chain, which does not climb.
            q: (n, joints) readings.
            values: of parameters by name; nominal where not given.
        """
        passed = [*self.links].index(link)
        stiff = (p for p in self.offered.values() if p.key not in (COMPLIANCE, *BENDING))
        nominal = {p.name: p.nominal for p in stiff} | dict(values)
        function = forward_kinematics(
            self.segments[:passed],
            [],
            nominal,
            width=len(self.joints),
            loops=self.closed,
        ).map(len(q))
        flat, position, _ = (np.array(part).T for part in function(np.zeros(0), q.T))
        return np.swapaxes(flat.reshape(-1, 3, 3), 1, 2), position

    def carried_by(self, link: str) -> tuple[str, FloatArray]:
        """The next moving joint that a link of the chain carries, and where (3,) in its frame, m.

        The tip's name and place where there is none.
        """
        rotation, position = np.eye(3), np.zeros(3)
        for joint in self.chain.joints[[*self.links].index(link) :]:
            position = position + rotation @ joint.xyz
            if joint.moving:
                return joint.name, position
            rotation = rotation @ rotation_from_rpy(joint.rpy)
        return self.chain.tip, position

    @property
    def tilt_sensors(self) -> tuple[TiltSensor, ...]:
        """Of `tilted`."""
        return tuple(link.sensor for link in self.tilted)

    def with_tip_moved(self, by: ArrayLike) -> ArmModel:
        """The same arm with another tip on the same link, such as the end of a probe.

        It moves the tip's own placement ``tip.x|y|z``, which a calibrated URDF holds.

        Args:
            by: (3,) along the axes of the tip, m.

        Raises:
            ParameterError: the tip is on a link that a joint moves, and so has no placement.
        """
        last = self.segments[-1]
        if last.motion != "fixed":
            raise ParameterError(
                f"a tip_offset_mm at {self.tip}, a link that {last.owner} moves",
                "a tip on a fixed joint, because calibrated.urdf stores the offset in its "
                "<origin>; the origin of a moving joint also fixes its axis",
                where="arm.tip_offset_mm",
                hint=f"add a link with a fixed joint on {self.chain.tip_link} to the URDF, and "
                "make it the tip. Targets of an instrument need no link: give their samples "
                "a column 'target'",
            )
        names = last.names(*POSITION)
        moved = [self.parameters[n].nominal for n in names] + last.rotation @ np.asarray(by)
        return self.at(dict(zip(names, moved.tolist(), strict=True)))

    @property
    def urdf(self) -> tuple[Path, bytes]:
        """The URDF it was read from: the file, or what messages call a given text; its bytes."""
        return self.chain.path, self.chain.data

    @property
    def arms(self) -> tuple[ArmModel, ...]:
        """Itself."""
        return (self,)

    @property
    def chained(self) -> tuple[Chain, ...]:
        """Its own."""
        return (self.chain,)

    def chosen(self, chain: str = "") -> ArmModel:
        """Itself."""
        if chain:
            raise ParameterError(f"the chain '{chain}'", "no name: the arm has one chain")
        return self

    @property
    def own_joints(self) -> tuple[str, ...]:
        """Names of those of `joints` that move this chain."""
        return tuple(joint.name for joint in self.chain.moving)

    @property
    def _moving(self) -> tuple[str, ...]:
        """Names of all joints that move, those without a reading of their own included."""
        return tuple(joint.name for joint in self.chain.joints if joint.moving)

    def laid_out(
        self, readings: tuple[ChainJoint, ...], bodies: Bodies, beside: ParameterSet
    ) -> ArmModel:
        """The same chain, moved by columns of samples that all chains of a robot share.

        Args:
            readings: the joints of these columns, its own among them.
            bodies: what its base and its tip are called in labels.
            beside: parameters of the other chains, which nothing of this one depends on.
        """
        column = {joint.name: k for k, joint in enumerate(readings)}
        own_joints = self.joints
        arm = self._renewed()
        arm.readings, arm.bodies, arm.beside = readings, bodies, beside
        arm.segments, arm.loop_segments = (
            tuple(
                replace(
                    s,
                    column=column[own_joints[s.column]],
                    others={joint: column[joint] for joint in s.others},
                )
                for s in segments
            )
            for segments in (self.segments, self.loop_segments)
        )
        return arm

    def carrying(self, others: Sequence[ArmModel]) -> ArmModel:
        """The same chain, with what hangs on its joints and moves with those of other chains.

        Where a chain climbs, or another does not begin at one of its links, what hangs there stays
        as drawn.

        Args:
            others: laid out over the same columns of readings.
        """
        on_chain = {joint.name for joint in self.chain.joints}
        counted, branches = set(on_chain), list[HangingArm]()
        for arm in others:
            if any(joint.climbed for joint in (*self.chain.joints, *arm.chain.joints)):
                continue
            branch = self._branch(arm, on_chain, counted)
            counted |= {joint.name for joint in arm.chain.joints}
            if branch is not None:
                branches.append(branch)
        carrying = self._renewed()
        carrying.hung = tuple(branches)
        return carrying

    def _branch(self, arm: ArmModel, own: set[str], counted: set[str]) -> HangingArm | None:
        """Of another chain what is beyond its joints that count already; None if nothing is."""
        pairs = list(zip(arm.chain.joints, arm.segments, strict=True))
        beyond_own = [k for k, (joint, _) in enumerate(pairs) if joint.name not in own]
        if not beyond_own:
            return None
        at, segments, carriers = pairs[beyond_own[0]][0].parent, list[Segment](), 0
        place = self.chain.base
        for joint, segment in zip(self.chain.joints, self.segments, strict=True):
            if place == at:
                break
            if joint.moving:
                segments, carriers = [], carriers + 1
            else:
                segments.append(segment)
            place = joint.child
        if place != at or not carriers:
            return None
        segments += [segment for _, segment in pairs[beyond_own[0] :]]
        new = {joint.name for joint, _ in pairs if joint.name not in counted}
        loads = tuple(load for load in arm.loads if load.joint in new)
        if not any(load.mass for load in loads):
            return None
        return HangingArm(carriers, tuple(segments), loads)

    def _renewed(self) -> ArmModel:
        """A copy, without what was derived."""
        arm = copy(self)
        for name in [
            n for n in vars(arm) if isinstance(getattr(type(self), n, None), cached_property)
        ]:
            del arm.__dict__[name]
        return arm

    def configuration(self, q: ArrayLike) -> FloatArray:
        """Readings (joints,) as a configuration of `model`, continuous joints included."""
        return configuration_of(self.model, self.motions(q))

    def motions(self, q: ArrayLike) -> dict[str, float]:
        """How far each joint of the chain, and of its closed loops, moves at readings (joints,)."""
        readings = np.asarray(q, dtype=float)
        moved = self.gearing @ readings + [s.shift for s in self.movers]
        amounts = dict(zip((s.owner for s in self.movers), moved.tolist(), strict=True))
        return amounts | self.passive_angles(readings)

    def passive_angles(self, q: ArrayLike) -> dict[str, float]:
        """Angles, rad, of the joints that closed loops move, by name, for readings (joints,)."""
        if not self.chain.loops:
            return {}
        function = self._passive_angles
        _, *angles = function.call([np.asarray(q, dtype=float)])
        return dict(zip(function.name_out()[1:], map(float, angles), strict=True))

    def open_loops(self, q: FloatArray) -> FloatArray:
        """(n,) how far apart the ends of closed loops stay, m, at readings (n, joints).

        About zero where all loops close; a metre of a loop that is drawn a millimetre off may stay
        open by that.
        """
        if not self.chain.loops:
            return np.zeros(len(q))
        gaps = self._passive_angles.map(len(q))(np.asarray(q, dtype=float).T)[0]
        farthest: FloatArray = np.array(gaps, dtype=float).max(axis=0)
        return farthest

    @cached_property
    def _passive_angles(self) -> Any:
        nominal = {p.name: p.nominal for p in self.offered.values()}
        return passive_angles(self.closed, nominal, len(self.readings))

    @cached_property
    def closed(self) -> tuple[ClosedLoop, ...]:
        """The closed loops that move joints of the chain, in the order in which they are solved."""
        segments = (*self.segments, *self.loop_segments)
        joints = (*self.chain.joints, *self.chain.beside)
        by_joint = {j.name: s for j, s in zip(joints, segments, strict=True)}
        return tuple(closed_loop(loop, by_joint) for loop in self.chain.loops)

    @property
    def tip(self) -> str:
        """The name the tip's own parameters carry."""
        return self.chain.tip

    @cached_property
    def geometric(self) -> frozenset[str]:
        """Names the word ``geometric`` stands for: placements of moving joints and of the tip.

        Where the chain climbs, the joint that carries the base is to its first moving joint what
        the tip's is to its last.
        """
        first, last = self.segments[0], self.segments[-1]
        ends = [s for s, its in ((first, first.climbed), (last, not last.climbed)) if its]
        loops = (s for loop in self.closed for branch in loop.branches for s in branch)
        owners = {s.owner for s in (*self.movers, *ends, *loops)}
        return frozenset(
            p.name for p in self.parameters.values() if p.owner in owners and p.key != OFFSET
        )

    @cached_property
    def loads(self) -> tuple[Load, ...]:
        """The masses on the moving joints, base → tip, as the URDF has them."""
        bodies = [self.model.inertias[self.model.getJointId(name)] for name in self._moving]
        pairs = zip(self._moving, bodies, strict=True)
        return tuple(Load(name, float(body.mass), body.lever.copy()) for name, body in pairs)

    def check_masses(self, names: Iterable[str]) -> None:
        """Refuse joints on which nothing hangs: their compliance would do nothing."""
        movers, climbed = [s.owner for s in self.movers], [s.climbed for s in self.movers]
        for parameter in (self.offered[n] for n in names if n not in self.beside):
            if parameter.key not in (COMPLIANCE, *BENDING):
                continue
            if self.chain.loops:
                raise UrdfError(
                    f"{parameter.name}, but the arm has a closed loop",
                    "compliances of arms without closed loops only, because a loop carries part of "
                    "the load",
                    file=self.chain.path,
                    where=parameter.name,
                )
            hanging = self.loads[beyond(climbed, movers.index(parameter.owner))]
            if not any(load.mass > 0 for load in hanging):
                raise UrdfError(
                    f"no mass in any link behind {parameter.owner}",
                    "<inertial> with <mass> in the links, from which the torque of gravity is "
                    "computed",
                    file=self.chain.path,
                    where=parameter.name,
                    hint="add the masses, or do not select this parameter",
                )

    def masses_felt(self, chosen: Container[str]) -> set[str]:
        """Names of the masses beyond its joints that yield."""
        owners, climbed = [s.owner for s in self.movers], [s.climbed for s in self.movers]
        yielding = {
            p.owner
            for p in self.nongeometric.values()
            if p.key in (COMPLIANCE, *BENDING) and (p.nominal or p.name in chosen)
        }
        return {
            f"{owner}.{MASS}"
            for k, joint in enumerate(owners)
            if joint in yielding
            for owner in owners[beyond(climbed, k)]
        }

    def function(
        self, names: Sequence[str], conditions: Iterable[Condition] = (), rows: int | None = None
    ) -> Symbol:
        """CasADi function of `kinematics.forward_kinematics`, built once for each set of names.

        Args:
            names: of parameters that become inputs.
            conditions: what is said of a sample beside its readings.
            rows: of the Jacobian, of so many parameters, the first ones; of all by default. Each
                costs as much as the pose.
        """
        for name in names:
            if name not in self.beside:
                _ = self.offered[name]
        return _kinematics(self, tuple(names), tuple(conditions), rows)

    def swing(self, names: Sequence[str], conditions: Iterable[Condition] = ()) -> Symbol:
        """CasADi function of how fast the tip moves while the readings change.

        Args:
            names: of parameters that become inputs.
            conditions: what is said of a sample beside its readings.

        Returns:
            ``ca.Function(theta, q, rate (readings), conditions…) -> velocity (6)``: of the tip's
            origin, then angular, along the axes of the base, per unit of what the rate is per.
        """
        return _swing(self, tuple(names), tuple(conditions))

    def forward(
        self,
        q: ArrayLike,
        values: Mapping[str, float] | None = None,
        conditions: Mapping[Condition, FloatArray] | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Tip poses ``T_base_tip`` for readings and parameter values (nominal where not given).

        Args:
            q: (n, joints) or (joints,) readings.
            values: parameter values by name; names of other things than this arm are ignored.
            conditions: beside the readings, as `Samples.conditions` has them: the ``direction``
                (n, joints) of each reading's last motion, -1, 0 or 1 (without it a joint with
                backlash is in the middle of its play); the ``warmth`` (n, 1), K above 20 °C
                (without it nothing has grown); the ``payload`` (n, 4), kg and its centre in the
                frame of the tip, m (without it the tip carries nothing); the ``tilt`` (n, 3 for
                each of `tilted`), unit vectors that sensors felt (without it no link leans).

        Returns:
            Rotations (n, 3, 3) and positions (n, 3), m; without n for a single reading.
        """
        try:
            readings = np.asarray(q, dtype=float)
        except (TypeError, ValueError) as problem:
            raise ParameterError(
                f"no readings ({problem})", "an array (n, joints) of numbers"
            ) from None
        # What is no geometry and stays as it is needs no masses, which it may not have.
        beside = self.nongeometric
        arm_values = {
            name: value
            for name, value in (values or {}).items()
            if name in self.parameters or (name in beside and value != beside[name].nominal)
        }
        if all(value == self.offered[name].nominal for name, value in arm_values.items()):
            arm_values = {}
        rows = np.atleast_2d(readings)
        if rows.shape[1] != (count := len(self.joints)):
            given = f"readings of {rows.shape[1]} joints"
            raise ParameterError(given, f"{count}: {self.joints}")
        beside_readings = conditions or {}
        batch = Batched(self.function(list(arm_values), beside_readings, 0), len(rows), shared=[0])
        inputs = (np.array([*arm_values.values()]), rows, *beside_readings.values())
        for place, numbers in zip(batch.inputs, inputs, strict=True):
            place[:] = numbers
        flat, position, _ = batch()
        rotation = np.swapaxes(flat.reshape(-1, 3, 3), 1, 2).copy()
        if readings.ndim == 1:
            return rotation[0], position[0]
        return rotation, position

    def skeleton(self, q: ArrayLike) -> Skeleton:
        """Joints and tip for readings (joints,), rad or m, in the base: the nominal geometry."""
        ends = self.chain.base, self._moving
        return Skeleton.of(self.model, *ends, self.configuration(q), self.forward(q)[1])

    def scene(self, q: ArrayLike | None = None) -> Scene:
        """The arm in one posture, to be drawn.

        Args:
            q: (joints,) readings; zero by default.
        """
        readings = np.zeros(len(self.joints)) if q is None else q
        return self.skeleton(readings).scene(self.chain.robot or "arm")

    def plot(self, q: ArrayLike | None = None, ax: Any = None) -> Any:
        """Draw links, joint axes and tip in three dimensions, mm.

        Args:
            q: (joints,) readings, rad (m for prismatic joints); zero by default.
            ax: `Axes3D` to draw on; those of a new figure by default.

        Returns:
            The `Axes3D`.
        """
        return plotting.draw_scene(self.scene(q), ax)

    @property
    def in_a_line(self) -> str:
        """Its ends and how many joints it has."""
        count, chain = len(self.own_joints), self.chain
        joints = f"{count} joint{'s' * (count != 1)}"
        return f"{chain.base} → {self.tip}, {joints} of {chain.path.name}"

    def origins(self, values: Mapping[str, float]) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Position (3,), m, and rpy (3,), rad, of every joint's origin as in `calibrated_urdf`."""
        origins = {}
        joints = (*self.chain.joints, *self.chain.beside)
        for joint, segment in zip(joints, (*self.segments, *self.loop_segments), strict=True):
            names = segment.names(*segment.keys)
            x = np.array([values.get(n, self.parameters[n].nominal) for n in names])
            offset = float(x[6]) if segment.read else 0.0
            origins[joint.name] = folded_origin(joint, x[:3], x[3:6], offset)
        return origins


@lru_cache(maxsize=16)
def _kinematics(
    arm: ArmModel, names: tuple[str, ...], conditions: tuple[Condition, ...], rows: int | None
) -> Symbol:
    """`forward_kinematics` of this arm."""
    arm.check_masses(names)
    nominal = {p.name: p.nominal for p in (*arm.beside.values(), *arm.offered.values())}
    width = len(arm.readings)
    chain = arm.segments, names, nominal, arm.loads, arm.down, conditions, rows, width
    leaning = arm.tilted, arm.root_axes
    return _kinematics_of(pickle.dumps((*chain, arm.closed, arm.hung, *leaning)))


@lru_cache(maxsize=16)
def _swing(arm: ArmModel, names: tuple[str, ...], conditions: tuple[Condition, ...]) -> Symbol:
    """`ArmModel.swing` of this arm."""
    kinematics = arm.function(names, conditions, 0)
    symbols = [ca.SX.sym(f"in{k}", kinematics.size1_in(k)) for k in range(kinematics.n_in())]
    rate = ca.SX.sym("rate", symbols[1].numel())
    rotation, position, _ = kinematics(*symbols)
    turn = ca.reshape(ca.jtimes(rotation, symbols[1], rate), 3, 3) @ ca.reshape(rotation, 3, 3).T
    velocity = ca.vertcat(ca.jtimes(position, symbols[1], rate), ca.inv_skew(turn))
    inputs = [*symbols[:2], rate, *symbols[2:]]
    return ca.Function("swing", inputs, [ca.densify(velocity)])


# A URDF is read again by every job over it, and its kinematics would be composed again.
@lru_cache(maxsize=64)
def _kinematics_of(chain: bytes) -> Symbol:
    """`forward_kinematics` of pickled arguments, which arms that are alike have alike."""
    return forward_kinematics(*pickle.loads(chain))
