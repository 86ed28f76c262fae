"""Several chains of one URDF, or of a cell, that share joints: two arms on a torso, two robots."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from functools import cached_property, lru_cache
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray
from suta_calib.errors import ParameterError, UrdfError, close_words, did_you_mean
from suta_calib.inputs import XacroFile
from suta_calib.model.arm import ArmModel, tip_owner
from suta_calib.model.bodies import Bodies
from suta_calib.model.cell import BasePose, CellTree, joined_tree, within
from suta_calib.model.chain import Chain, ChainJoint, chain_of
from suta_calib.model.kinematic_urdf import moving_model
from suta_calib.model.kinematics import Segment
from suta_calib.model.loop import Loop, with_loops
from suta_calib.model.mechanism import Mechanism, Origins, union
from suta_calib.model.parameters import MASS, ParameterSet, base_owner, is_base
from suta_calib.model.tilt import TiltSensor
from suta_calib.model.urdf import urdf_bytes
from suta_calib.model.urdf_tree import UrdfTree, read_tree


@final
class Robot(Mechanism):
    """Chains of one URDF: what they share is one unknown.

    ::

        robot = Robot.from_urdf("robot.urdf")
        left, right = robot.chain(tip="left_hand"), robot.chain(tip="right_hand")
        terms = [TrackedPoint.from_arrays(left, q, position=p),
                 TrackedPoint.from_arrays(right, q2, position=p2)]
        result = calibrate(robot, terms)

    Readings of a chain are those of its own joints, as of any `ArmModel`. `arms` are the same
    chains with the columns of `readings`, which all of them share: the terms of one problem are
    over these (`terms.several_chains`).

    Attributes:
        chains: by name, as they were asked for.
    """

    def __init__(
        self,
        chains: Mapping[str, ArmModel],
        tree: UrdfTree | None = None,
        loops: Sequence[Loop] = (),
    ) -> None:
        self.chains = dict(chains)
        self._tree, self._loops = tree, tuple(loops)

    @classmethod
    def from_urdf(
        cls,
        urdf: str | Path | XacroFile,
        chains: Mapping[str, tuple[str, str | None]] | None = None,
        loops: Sequence[Loop] = (),
    ) -> Robot:
        """Read a robot.

        Args:
            urdf: as of `ArmModel.from_urdf`.
            chains: tip and base of each chain, by name; None as base is the root link. `chain` adds
                others.
            loops: closed loops that hang on the tree, as of `ArmModel.from_urdf`.

        Raises:
            UrdfError: no such file or link, or a chain that cannot be used (`chain.read_chain`).
        """
        robot = cls({}, read_tree(urdf), loops)
        robot._add({name: robot._read(*ends) for name, ends in (chains or {}).items()})
        return robot

    @classmethod
    def of_cell(
        cls,
        urdfs: Mapping[str, str | Path | XacroFile],
        chains: Mapping[str, tuple[str, str | None]] | None = None,
        poses: Mapping[str, BasePose] | None = None,
        loops: Sequence[Loop] = (),
    ) -> Robot:
        """Read several robots in one cell.

        ::

            cell = Robot.of_cell({"a": "left.urdf", "b": "right.urdf"})
            left, right = cell.chain(tip="a/tool0"), cell.chain(tip="b/tool0")

        Links, joints and parameters are called as in their own URDF, after the name of the robot:
        ``a/joint_1.offset``. The base of the first robot is that of the cell. The bases of the
        others stand in it at ``robot[b].x … robot[b].rz``.

        Args:
            urdfs: by the name of the robot, as of `from_urdf`.
            chains: as of `from_urdf`; the base of the first robot by default.
            poses: rotation (3, 3) and position (3,), m, of a robot's base in that of the first one.
                `calibrate` estimates the poses that are not given.
            loops: as of `from_urdf`; the cell calls links and joints after the robot
                (`Loop.within`).

        Raises:
            UrdfError: as of `from_urdf`, or a name or a pose of no robot.
        """
        robot = cls({}, joined_tree(urdfs, poses or {}), loops)
        robot._add({name: robot._read(*ends) for name, ends in (chains or {}).items()})
        return robot

    @property
    def unplaced(self) -> tuple[str, ...]:
        """Names of the placements of bases in a cell that nobody gave and that chains pass."""
        if not isinstance(self._tree, CellTree):
            return ()
        given = {base_owner(name) for name in self._tree.placed}
        every = self.parameters.items()
        return tuple(n for n, p in every if is_base(p.owner) and p.owner not in given)

    def calibrated_urdfs(self, values: Mapping[str, float]) -> dict[str, bytes]:
        """Of each robot of a cell."""
        if not isinstance(self._tree, CellTree):
            return {}
        origins = self.origins(values)
        return {
            name: urdf_bytes(
                tree.path,
                tree.data,
                {j: origins[k] for j in tree.joints for k in [within(name, j)] if k in origins},
            )
            for name, tree in self._tree.members.items()
        }

    def chain(self, tip: str, base: str | None = None, name: str = "") -> ArmModel:
        """The chain from ``base`` to ``tip``, as part of this robot.

        Args:
            tip: any link or frame, as of `ArmModel.from_urdf`.
            base: the same; the root link by default.
            name: what results and labels call it; the tip's name by default.

        Raises:
            UrdfError: no such link, or a chain that cannot be used.
            ParameterError: the name is that of another chain.
        """
        try:
            chain = self._read(tip, base)
        except UrdfError as error:
            near = tip if tip in self.chains else next(iter(close_words(tip, self.chains)), "")
            if error.where != "tip" or not near:
                raise
            hint = f"robot.chains[{near!r}] is the chain of that name; {error.hint}"
            raise UrdfError.of(error, error.file, error.line, hint=hint) from None
        for existing in self.chains.values():
            if existing.chain.ends == chain.ends:
                return existing
        name = name or (tip if tip not in self.chains else f"{chain.base} to {tip}")
        if name in self.chains:
            hint = "give it another name"
            raise ParameterError(repr(name), "a name for one chain", where="chain", hint=hint)
        self._add({name: chain})
        return self.chains[name]

    def _read(self, tip: str, base: str | None) -> Chain:
        if self._tree is None:
            raise ParameterError("a robot of given chains", "one of Robot.from_urdf", where="chain")
        return with_loops(self._tree, chain_of(self._tree, tip, base), self._loops)

    def _add(self, chains: Mapping[str, Chain]) -> None:
        tips = dict[str, str]()
        # What a chain has called a joint, the next ones call it too.
        for arm in self.chains.values():
            tips |= {
                joint.name: segment.owner
                for joint, segment in zip(arm.chain.joints, arm.segments, strict=True)
                if segment.owner != joint.name
            }
        for chain in chains.values():
            tips = tip_owner(chain) | tips
        for name, chain in chains.items():
            assert self._tree is not None
            self.chains[name] = ArmModel(chain, moving_model(self._tree, chain), tips)
        for key in [*vars(self)]:
            if isinstance(getattr(type(self), key, None), cached_property):
                del self.__dict__[key]

    @cached_property
    def laid_out(self) -> dict[str, ArmModel]:
        """The chains by name, with the columns of `readings`."""
        if len(self.chains) == 1:
            return dict(self.chains)
        bodies, every = _bodies(self.chains), union([a.offered for a in self.chains.values()])
        laid = {}
        for name, arm in self.chains.items():
            beside = ParameterSet(p for n, p in every.items() if n not in arm.offered)
            same = [j.name for j in arm.readings] == [j.name for j in self.readings]
            already = same and arm.bodies.tip and set(beside) <= set(arm.beside)
            laid[name] = arm if already else arm.laid_out(self.readings, bodies[name], beside)
        return {
            name: arm
            if arm is self.chains[name]
            else arm.carrying([other for n, other in laid.items() if n != name])
            for name, arm in laid.items()
        }

    def chosen(self, chain: str = "") -> ArmModel:
        """The chain of this name, with the columns of `readings`."""
        return self.laid_out[chosen_chain(self.chains, chain)]

    @property
    def chained(self) -> tuple[Chain, ...]:
        """Of all chains."""
        return tuple(arm.chain for arm in self.chains.values())

    @property
    def arms(self) -> tuple[ArmModel, ...]:
        """The chains, all with the columns of `readings`."""
        return tuple(self.laid_out.values())

    @cached_property
    def readings(self) -> tuple[ChainJoint, ...]:  # type: ignore[override]
        """The joints that have a reading, those of the first chain first."""
        joints = (joint for arm in self.chains.values() for joint in arm.readings)
        return tuple({joint.name: joint for joint in joints}.values())

    @cached_property
    def segments(self) -> tuple[Segment, ...]:  # type: ignore[override]
        """The joints of all chains, each once."""
        every = (segment for arm in self.arms for segment in arm.segments)
        by_owner = dict[str, Segment]()
        for segment in every:
            by_owner.setdefault(segment.owner, segment)
        return tuple(by_owner.values())

    @cached_property
    def loop_segments(self) -> tuple[Segment, ...]:  # type: ignore[override]
        """The joints of closed loops that are on no chain, each once."""
        on_chains = {segment.owner for segment in self.segments}
        every = (segment for arm in self.arms for segment in arm.loop_segments)
        return tuple({s.owner: s for s in every if s.owner not in on_chains}.values())

    @cached_property
    def parameters(self) -> ParameterSet:  # type: ignore[override]
        """Every placement and offset that could be unknown, each once."""
        return union([arm.parameters for arm in self.chains.values()])

    @cached_property
    def nongeometric(self) -> ParameterSet:  # type: ignore[override]
        """Errors beside the geometry, each once."""
        return union([arm.nongeometric for arm in self.chains.values()])

    @cached_property
    def geometric(self) -> frozenset[str]:
        """Of all chains."""
        return frozenset().union(*(arm.geometric for arm in self.chains.values()))

    @property
    def grades(self) -> dict[str, str]:  # type: ignore[override]
        """Of all chains."""
        return {robot: grade for a in self.chains.values() for robot, grade in a.grades.items()}

    @property
    def urdf(self) -> tuple[Path, bytes]:
        """The URDF it was read from."""
        if self._tree is not None:
            return self._tree.path, self._tree.data
        return self.arms[0].urdf

    @property
    def robot(self) -> str:
        """Name of the robot in its URDF."""
        return self.chained[0].robot if self._tree is None else self._tree.robot

    def at(self, values: Mapping[str, float]) -> Robot:
        """The same robot with these values as its nominal ones (`ArmModel.at`)."""
        moved = {name: arm.at(values) for name, arm in self.chains.items()}
        return Robot(moved, self._tree, self._loops)

    def of_grade(self, grade: str | Mapping[str, str]) -> Robot:
        """The same robot, made like this (as of `ArmModel`)."""
        made = {name: arm.of_grade(grade) for name, arm in self.chains.items()}
        return Robot(made, self._tree, self._loops)

    def with_gravity(self, direction: ArrayLike) -> Robot:
        """The same robot, mounted so that gravity points in this direction (as of `ArmModel`)."""
        made = {name: arm.with_gravity(direction) for name, arm in self.chains.items()}
        return Robot(made, self._tree, self._loops)

    def with_tilt_sensors(self, sensors: Sequence[TiltSensor]) -> Robot:
        """The same robot, whose links lean by what accelerometers on them felt (`model.tilt`).

        Call it once all chains are there: a link leans about one point, whichever of them it
        carries.

        Args:
            sensors: at most one for each link.

        Raises:
            UrdfError: a link of no chain, and what `ArmModel.with_tilt_sensors` refuses.
        """
        on = {name: [s for s in sensors if s.link in c.links] for name, c in self.chains.items()}
        reaches = dict[str, FloatArray]()
        for sensor in sensors:
            carried = [c.carried_by(sensor.link) for n, c in self.chains.items() if sensor in on[n]]
            if carried:
                reaches[sensor.link] = np.mean([*dict(carried).values()], axis=0)
            else:
                # Some chain says which links there are.
                next(iter(self.chains.values())).with_tilt_sensors([sensor])
        made = {n: arm.with_tilt_sensors(on[n], reaches) for n, arm in self.chains.items()}
        return Robot(made, self._tree, self._loops)

    @property
    def tilt_sensors(self) -> tuple[TiltSensor, ...]:
        """Of all chains, each once."""
        every = (sensor for arm in self.chains.values() for sensor in arm.tilt_sensors)
        return tuple(dict.fromkeys(every))

    def check_masses(self, names: Iterable[str]) -> None:
        """As of `ArmModel`, by every chain that has the joint."""
        asked = list(names)
        for arm in self.chains.values():
            arm.check_masses(name for name in asked if name in arm.nongeometric)

    def masses_felt(self, chosen: Container[str]) -> set[str]:
        """Of all chains."""
        return set[str]().union(*(arm.masses_felt(chosen) for arm in self.chains.values()))

    def origins(self, values: Mapping[str, float]) -> Origins:
        """Of the joints of all chains."""
        return {k: v for arm in self.arms for k, v in arm.origins(values).items()}

    def motions(self, q: ArrayLike) -> dict[str, float]:
        """As of `ArmModel`, of all chains."""
        return {joint: amount for arm in self.arms for joint, amount in arm.motions(q).items()}

    @property
    def in_a_line(self) -> str:
        """Its chains."""
        chains = "; ".join(f"{name}: {arm.in_a_line}" for name, arm in self.chains.items())
        return chains or "no chain yet"


def chosen_chain(names: Iterable[str], chain: str) -> str:
    """The name that was chosen among those of chains, which need not be where there is only one.

    Raises:
        ParameterError: none was chosen of several, or one that does not exist.
    """
    names = list(names)
    if chain and names == [""]:
        raise ParameterError(f"the chain '{chain}'", "no name: the arm has one chain")
    if chain in names or (len(names) == 1 and not chain):
        return chain or names[0]
    if chain:
        found, hint = f"the chain '{chain}'", did_you_mean(chain, names)
    else:
        found, hint = "several chains", "choose one: --chain NAME, in Python chain=…"
    raise ParameterError(found, f"the name of one of {', '.join(names)}", hint=hint)


# One chain, or several that share joints.
AnyArm = ArmModel | Robot


def same_chain(arm: ArmModel, mechanism: AnyArm) -> ArmModel:
    """The chain of another mechanism that has the ends of this one, with all its columns."""
    return next(other for other in mechanism.arms if other.chain.ends == arm.chain.ends)


def placed_joints(arm: AnyArm) -> tuple[tuple[ChainJoint, Segment], ...]:
    """The joints of all chains with their segments, each joint once."""
    pairs = (pair for one in arm.arms for pair in zip(one.chain.joints, one.segments, strict=True))
    return tuple({joint.name: (joint, segment) for joint, segment in pairs}.values())


def _bodies(chains: Mapping[str, ArmModel]) -> dict[str, Bodies]:
    """What labels call the ends of each chain: a tip is called as the first chain that ends there.

    What stands in the base of the first chain needs no name.
    """
    called = {next(iter(chains.values())).chain.base: ""}
    for name, arm in chains.items():
        called.setdefault(arm.chain.tip_link, name)
    return {
        name: Bodies(
            called.get(arm.chain.base, arm.chain.base),
            called[arm.chain.tip_link] or arm.chain.tip_link,
            name,
        )
        for name, arm in chains.items()
    }


@lru_cache(maxsize=64)
def joined(arms: tuple[ArmModel, ...]) -> ArmModel | Robot:
    """One mechanism of the different chains that terms are over.

    Raises:
        ParameterError: chains of different URDFs, or that give one parameter different values.
    """
    different = tuple(dict.fromkeys(arms))
    if len(different) == 1:
        return different[0]
    _check_one_robot(different)
    names = dict[str, ArmModel]()
    for arm in different:
        name = arm.bodies.name or arm.chain.tip
        names[name if name not in names else f"{arm.chain.base} to {name}"] = arm
    return Robot(names)


def _check_one_robot(arms: Sequence[ArmModel]) -> None:
    first = arms[0]
    for arm in arms[1:]:
        other_ends = [other.chain.ends for other in arms if other is not arm]
        if arm.urdf != first.urdf or arm.chain.ends in other_ends:
            hint = "read the robot once: Robot.from_urdf(path), and robot.chain(tip=…) for each tip"
            raise ParameterError(
                "terms over different arms", "one arm, or chains of one robot", hint=hint
            )
        for name, p in arm.offered.items():
            # What a joint carries has the chains beyond it in it that are not looked at.
            if p.key == MASS or name not in first.offered:
                continue
            if first.offered[name].nominal != p.nominal:
                expected = "chains of one robot at the same values"
                raise ParameterError(f"two values of {name}", expected)
