"""The key ``arm`` of a job or a simulation: a robot and its chains."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Final, Protocol, TypeVar

import numpy as np

from suta_calib.arm_additions import (
    LOOP_KEYS,
    TILT_KEYS,
    TIP_OFFSET_KEYS,
    AnyMechanism,
    Couplings,
    GearRatios,
    TipOffset,
    read_loop,
    read_tilt_sensor,
)
from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import UrdfError, did_you_mean
from suta_calib.inputs import UrdfFile
from suta_calib.measurements import YamlSection
from suta_calib.measurements.fields import (
    BASE,
    GRAVITY,
    TEXT,
    TIP,
    URDF,
    Field,
    Fields,
    Value,
    choice,
    fields_of,
    keyed,
    read_as,
    rows,
)
from suta_calib.measurements.scale import GRADES
from suta_calib.model.arm import ArmModel
from suta_calib.model.cell import within
from suta_calib.model.loop import LOOP, Loop
from suta_calib.model.parameters import (
    POSITION,
    ROTATION,
    Selection,
    base_owner,
)
from suta_calib.model.robot import Robot, chosen_chain
from suta_calib.model.tilt import MOUNT, UP, TiltSensor
from suta_calib.model.urdf_tree import read_tree
from suta_calib.terms.given_pose import POSE_KEYS, GivenPose
from suta_calib.words import seen_from


class _OfChain(Protocol):
    """A row of a job or a set of a simulation, as `CHAIN_KEYS` say."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def chain(self) -> str: ...
    @property
    def link(self) -> str: ...


_Row = TypeVar("_Row", bound=_OfChain)

CHAIN_KEYS: Final = Fields(
    Field(
        "link",
        TEXT,
        "Link that carries what is seen or felt in this row, in place of the tip: a sensor that is "
        "strapped to the forearm.",
    ),
    Field("chain", TEXT, "Chain that the samples are of, where the arm has several (arm.chains)."),
    Field(
        "base_chain",
        TEXT,
        "Chain from whose tip it is seen or touched, in place of the base: a camera on the head "
        "that sees a board in the hand, or two hands.",
    ),
)

_TIP_OFFSET: Final = Field(
    "tip_offset_mm",
    Value("x, y, z in mm, or a mapping", TipOffset.read, TIP_OFFSET_KEYS),
    "Position of the tip in that frame, for a probe that the URDF does not have. Three numbers are "
    "fixed; with bound_mm or prior_mm the position is estimated.",
)


@dataclass(frozen=True)
class ChainSpec(Displayable):
    """One of several chains of a robot: an entry of ``arm: {chains: …}``."""

    tip: str = keyed(TIP)
    base: str | None = keyed(BASE, "", None)
    tip_offset: TipOffset | None = keyed(_TIP_OFFSET, "", None)


def _chains(arm: YamlSection, key: str) -> dict[str, ChainSpec]:
    """Chains by name, no two of them with the same ends."""
    below = arm.section(key)
    chains = {str(name): read_as(ChainSpec, below.section(name)) for name in below.data}
    names = dict[tuple[str, str | None], str]()
    for name, chain in chains.items():
        other = names.setdefault((chain.tip, chain.base), name)
        if other != name:
            problem = f"the tip '{chain.tip}', which is the tip of the chain {other} too"
            hint = "name one chain in both rows of the observations"
            raise below.refuse(problem, "another tip or base", at=(name,), hint=hint)
    return chains


@dataclass(frozen=True)
class RobotSpec(Displayable):
    """What a job says of a robot: of its only one, or of each in a cell."""

    urdf: UrdfFile = keyed(URDF)
    tip: str = keyed(replace(TIP, required=False), "", "")
    base: str | None = keyed(BASE, "", None)
    chains: Mapping[str, ChainSpec] = keyed(
        Value("chains by name", _chains, fields_of(ChainSpec)),
        "Several chains that share joints, in place of tip: {left: {tip: left_hand}, right: {tip: "
        "right_hand}}. Every row of observations and validation then names its chain.",
        dict,
    )
    tip_offset: TipOffset | None = keyed(_TIP_OFFSET, "", None)
    couplings: Couplings | None = keyed(
        Value("by joint, numbers by joint", Couplings.read),
        "Joints that the readings of other joints move too, as through a parallelogram: "
        "{joint_3: {joint_2: -1}} turns joint_3 by -1 times the reading of joint_2 as well. The "
        "number is fixed, unless a row estimates joint_3.coupling[joint_2].",
        None,
    )
    gear_ratios: GearRatios | None = keyed(
        Value("by joint, a number", GearRatios.read),
        "How often the input of a strain wave gear turns with its joint: {joint_2: 100}. Rows may "
        "then estimate joint_2.ripple_c and joint_2.ripple_s, which come twice with each turn of "
        "the input.",
        None,
    )
    loops: tuple[Loop, ...] = keyed(
        rows(read_loop, LOOP_KEYS),
        "Closed loops beside the tree of the URDF, such as the four-bar of a palletizing arm: "
        "two frames that a pin joins, and the two joints without an encoder.",
        (),
    )
    gravity: FloatArray | None = keyed(GRAVITY, "", None)
    tilt_sensors: tuple[TiltSensor, ...] = keyed(
        rows(read_tilt_sensor, TILT_KEYS),
        "Accelerometers on links that sink or bend: {link: base_link, columns: [base_ax, base_ay, "
        "base_az]}. In each row the link is turned by what its sensor felt beyond the model, about "
        "a point whose share of the way to the joints that it carries is estimated.",
        (),
    )
    grade: str = keyed(
        choice(GRADES, "certified, machined or printed"),
        "How the arm was made. It sets the tolerance of the dimensions that are not estimated, and "
        "of a common scale of all lengths. Every ± that depends on them includes this tolerance. "
        "If it is not given, the errors of the estimated dimensions set the tolerance, but never "
        "less than that of machined parts.",
        "",
    )


@dataclass(frozen=True, eq=False)
class CellRobot(RobotSpec):
    """One of several robots in one cell: an entry of ``robots``."""

    pose: GivenPose | None = keyed(
        Value("mapping", lambda row, key: GivenPose.read(row.section(key)), POSE_KEYS),
        "Where its base stands in the base of the first robot; without it, it is estimated.",
        None,
    )

    def in_cell(self, name: str) -> dict[str, ChainSpec]:
        """Its chains, as the cell calls them."""
        if self.tip:
            chains = {name: ChainSpec(self.tip, None, self.tip_offset)}
        else:
            chains = {f"{name}_{chain}": spec for chain, spec in self.chains.items()}
        return {
            chain: replace(spec, tip=within(name, spec.tip), base=base and within(name, base))
            for chain, spec in chains.items()
            for base in [spec.base or self.base]
        }

    def selections(self, name: str) -> list[Selection]:
        """Rows of the placement of its base among a job's parameters."""
        at, turn = (
            tuple(f"{base_owner(name)}.{key}" for key in keys) for keys in (POSITION, ROTATION)
        )
        pose = self.pose
        if pose is None:
            return [Selection((*at, *turn))]
        prior = None if pose.position_std is None else float(pose.position_std[0])
        rows = [Selection(at, prior_m=prior, fixed=True, line=pose.line)]
        if pose.rotation is None:
            return [*rows, Selection(turn)]
        std = pose.rotation_std
        return [*rows, Selection(turn, prior_rad=std, fixed=True, line=pose.line)]


@dataclass(frozen=True)
class ArmSpec(RobotSpec):
    """The key ``arm`` of a job; ``section`` is where it stands, None for no job.

    Attributes:
        robots: of a cell, by name (the key ``robots`` in place of ``arm``); its chains are then
            those of all of them.
        joined: whether the URDF has all robots of the cell in it, as a calibrated one.
    """

    section: YamlSection | None = field(default=None, repr=False, compare=False)
    robots: Mapping[str, CellRobot] = field(default_factory=dict)
    joined: bool = False

    @property
    def selections(self) -> tuple[Selection, ...]:
        """Rows among a job's parameters, before its own, of what it says of the arm."""
        bases = [] if self.joined else [*self.robots.items()][1:]
        return (
            *(offset.selection(tip) for tip, offset in self.tips.items() if offset is not None),
            *(stated.selection for stated in self._of_joints),
            *(row for sensor in self._tilt_sensors for row in sensor.selections),
            *(row for name, robot in bases for row in robot.selections(name)),
        )

    @property
    def _said(self) -> dict[str, RobotSpec]:
        """What is said of the only robot, by no name, or of each in a cell."""
        return {**self.robots} or {"": self}

    @property
    def _of_joints(self) -> list[Couplings | GearRatios]:
        return [
            replace(stated, robot=name)
            for name, spec in self._said.items()
            for stated in (spec.couplings, spec.gear_ratios)
            if stated is not None
        ]

    @property
    def _loops(self) -> tuple[Loop, ...]:
        return tuple(loop.within(name) for name, s in self._said.items() for loop in s.loops)

    @property
    def _tilt_sensors(self) -> tuple[TiltSensor, ...]:
        if self.joined:
            return self.tilt_sensors
        return tuple(
            replace(sensor, link=within(name, sensor.link))
            for name, spec in self._said.items()
            for sensor in spec.tilt_sensors
        )

    @property
    def tips(self) -> dict[str, TipOffset | None]:
        """What is said of the place of every tip, by the tip's name."""
        if self.chains:
            return {chain.tip: chain.tip_offset for chain in self.chains.values()}
        return {self.tip: self.tip_offset}

    def ends(self, pairs: Iterable[tuple[str, str]] = ()) -> dict[str, tuple[str, str | None]]:
        """Tip and base of every chain by name, and of chains that are seen from another's tip."""
        chains = {n: (c.tip, c.base or self.base) for n, c in self.chains.items()}
        for seen, seeing in pairs:
            if seeing:
                chains[seen_from(seen, seeing)] = (chains[seen][0], chains[seeing][0])
        return chains

    def check_chain(self, row: YamlSection, chain: str, base_chain: str) -> None:
        """Refuse a row of a chain that is not there, and one that does not say its chain.

        Raises:
            InputError: of the row's file, at its key.
        """
        names = tuple(self.chains)
        for key, name in (("chain", chain), ("base_chain", base_chain)):
            if name and name not in names:
                one_tip = "no such key: the arm has one tip"
                expected = f"one of {', '.join(names)}" if names else one_tip
                hint = did_you_mean(name, names)
                raise row.refuse(f"'{name}'", expected, at=(key,), hint=hint)
        if names and not chain:
            expected = f"the chain that its samples are of: {', '.join(names)}"
            raise row.refuse("no such key", expected, at=("chain",))
        if chain and chain == base_chain:
            raise row.refuse(f"'{chain}' as both", "two chains", at=("base_chain",))

    def on_links(self, rows: Sequence[_Row]) -> tuple[ArmSpec, list[_Row]]:
        """The same with a chain to each link that rows name, and the rows of these chains."""
        if not any(row.link for row in rows):
            return self, list(rows)
        main = self.chains or {self.tip: ChainSpec(self.tip, self.base, self.tip_offset)}
        chains, of_chains = dict(main), list[_Row]()
        for row in rows:
            name = row.chain or self.tip
            if row.link not in ("", main[name].tip):
                base, name = main[name].base, f"{row.link} of {name}" if row.chain else row.link
                chains[name] = ChainSpec(row.link, base)
            of_chains.append(replace(row, chain=name))
        return replace(self, tip="", tip_offset=None, chains=chains), of_chains

    def one(self, chain: str = "") -> tuple[str, str | None]:
        """Tip and base of the arm, or of the chain of this name.

        Raises:
            ParameterError: it has no such chain, or several and none was chosen.
        """
        names = self.ends() or {"": (self.tip, self.base)}
        return names[chosen_chain(names, chain)]

    def mechanism(self, pairs: Iterable[tuple[str, str]] = ()) -> ArmModel | Robot:
        """The arm, or the robot with its chains, at nominal.

        Args:
            pairs: chains that rows name, each with the one from whose tip it is seen, or nothing.

        Raises:
            UrdfError: the file cannot be used, or has no place for the tip's offset.
            JobError: it has no such tip, base or joints; names the job's line.
        """
        return self.model() if not self.chains else self._completed(partial(self._robot, pairs))

    def _robot(self, pairs: Iterable[tuple[str, str]]) -> Robot:
        ends = self.ends(pairs)
        if not self.robots or self.joined:
            return Robot.from_urdf(self.urdf, ends, self._loops)
        given = {name: robot.pose for name, robot in self.robots.items() if robot.pose is not None}
        poses = {
            name: (np.eye(3) if pose.rotation is None else pose.rotation, pose.position)
            for name, pose in given.items()
        }
        urdfs = {name: robot.urdf for name, robot in self.robots.items()}
        cell = Robot.of_cell(urdfs, ends, poses, self._loops)
        passed = {parameter.owner for parameter in cell.parameters.values()}
        for name in [*self.robots][1:]:
            if base_owner(name) not in passed and self.section is not None:
                raise self.section.refuse(
                    f"chains of {name} that all begin at a link of its own",
                    f"one that begins at the base of {next(iter(self.robots))}",
                    at=(name,),
                    hint="leave out base, or name a base_chain of the other robot in a row",
                )
        return cell

    def model(self, chain: str = "", base_chain: str = "") -> ArmModel:
        """The arm at nominal; of several chains the one of this name, as a row names it.

        Raises:
            UrdfError: the file cannot be used, or has no place for the tip's offset.
            JobError: it has no such tip, base or joints; names the job's line.
            ParameterError: it has no such chain, or several and none was chosen.
        """
        if not self.chains:
            read = partial(ArmModel.from_urdf, self.urdf, self.tip, self.base, self.loops)
            return self._completed(read)
        chain = chosen_chain(self.chains, chain)
        robot = self._completed(partial(self._robot, ((chain, base_chain),)))
        return robot.chains[seen_from(chain, base_chain)]

    def _completed(self, read: Callable[[], AnyMechanism]) -> AnyMechanism:
        """What was read from the URDF, with what else the job says of it."""
        try:
            arm = read()
        except UrdfError as problem:
            if self.section is not None and (problem.where or "").startswith(LOOP):
                at = ("loops",) if "loops" in self.section else ()
                found = f"{problem.where}: {problem.found}"
                raise self.section.refuse(
                    found, problem.expected, at=at, hint=problem.hint
                ) from None
            if self.section is None or problem.where not in ("tip", "base"):
                raise
            expected = f"{problem.expected} {self.urdf}"
            in_section = problem.where in self.section and not self.chains
            at, hint = (problem.where,) if in_section else (), problem.hint
            raise self.section.refuse(problem.found, expected, at=at, hint=hint) from None
        for stated in self._of_joints:
            arm = stated.on(arm)
        if self.gravity is not None:
            arm = arm.with_gravity(self.gravity)
        if self._tilt_sensors:
            try:
                arm = arm.with_tilt_sensors(self._tilt_sensors)
            except UrdfError as problem:
                if self.section is None:
                    raise
                at = () if self.robots else ("tilt_sensors",)
                raise self.section.refuse(
                    problem.found, problem.expected, at=at, hint=problem.hint
                ) from None
        grades = {name: spec.grade for name, spec in self._said.items()}
        return self.with_offsets(arm.of_grade(grades))

    def with_offsets(self, arm: AnyMechanism) -> AnyMechanism:
        """The arm with its tips where `tips` says.

        Raises:
            JobError: a tip is on a link that moves, and so has no placement of its own.
        """
        for tip, offset in self.tips.items():
            arm = arm if offset is None else offset.on(arm, tip)
        return arm

    def mechanism_of(
        self,
        urdf: UrdfFile,
        nominal: ArmModel | Robot,
        pairs: Iterable[tuple[str, str]] = (),
    ) -> ArmModel | Robot:
        """`mechanism` as another URDF has it, such as the calibrated one.

        Args:
            urdf: the other.
            nominal: the job's arm, whose tilt sensors are mounted as its samples have it.
            pairs: as of `mechanism`.

        Raises:
            UrdfError: the file cannot be used, or has no such tip or base.
            JobError: it has no joints that are coupled so.
        """
        # The tip's offset is in the URDF already; couplings and gears are in none.
        sensors = nominal.tilt_sensors
        arm = replace(self._of(urdf), tilt_sensors=sensors).mechanism(pairs)
        mounted = {name for s in sensors for name in (*s.names(*MOUNT), *UP)}
        return arm.at({name: nominal.nongeometric[name].nominal for name in mounted})

    def tracked(
        self, urdf: UrdfFile, chain: str = "", tip: str | None = None, base: str | None = None
    ) -> ArmModel:
        """`model` as a calibrated URDF has it, for readings alone: without tilt sensors.

        Args:
            urdf: the calibrated one; of a cell that of all robots.
            chain: as of `model`.
            tip: in place of that of the job.
            base: likewise.

        Raises:
            UrdfError: the file cannot be used, or has no such tip or base.
            JobError: it has no joints that are coupled so.
            ParameterError: as of `model`.
        """
        spec = replace(self._of(urdf), tilt_sensors=())
        first = within(next(iter(self.robots), ""), "")
        if first and not any(joint.startswith(first) for joint in read_tree(urdf).joints):
            expected, hint = "that of the whole cell", "give the calibrated.urdf beside it"
            raise UrdfError("the URDF of one robot of a cell", expected, file=Path(urdf), hint=hint)
        if tip is None and base is None:
            return spec.model(chain)
        tip, base = tip or spec.one(chain)[0], base or (None if tip else spec.one(chain)[1])
        # Another chain need not have the joints that are coupled; a result has their values.
        arm = ArmModel.from_urdf(urdf, tip, base, spec._loops)
        return arm if spec.gravity is None else arm.with_gravity(spec.gravity)

    def _of(self, urdf: UrdfFile) -> ArmSpec:
        chains = {n: replace(chain, tip_offset=None) for n, chain in self.chains.items()}
        more: dict[str, Any] = {"tip_offset": None, "section": None, "joined": bool(self.robots)}
        return replace(self, urdf=urdf, chains=chains, tilt_sensors=self._tilt_sensors, **more)


def read_arm(top: YamlSection, urdf: UrdfFile | None = None) -> ArmSpec:
    """The key ``arm`` of a job or a simulation, ``urdf`` in place of the file that it names."""
    if "robots" in top:
        return _read_cell(top, urdf)
    section = top.section("arm")
    # A calibrated one has the offset in it.
    other: dict[str, Any] = {} if urdf is None else {"urdf": urdf, "tip_offset": None}
    arm = read_as(ArmSpec, section, section=section, **other)
    if not arm.tip and not arm.chains:
        raise section.refuse("no such key", "tip: the link or frame of the tip", at=("tip",))
    for key in ("tip", "tip_offset_mm"):
        if arm.chains and key in section:
            hint = "write it into the entry of its chain"
            raise section.refuse(f"{key} beside chains", "one or the other", at=(key,), hint=hint)
    return arm


ROBOTS: Final = Field(
    "robots",
    Value("robots by name", inside=fields_of(CellRobot)),
    "Several robots in one cell, in place of arm: {a: {urdf: a.urdf, tip: tool0}, b: {urdf: "
    "b.urdf, tip: tool0}}. Every row names its chain: the robot's name, or NAME_CHAIN. Links, "
    "joints and parameters are called after the robot: a/joint_1.offset.",
)


def _read_cell(top: YamlSection, urdf: UrdfFile | None) -> ArmSpec:
    """The key ``robots``: the chains of all of them."""
    section = top.section("robots")
    if "arm" in top:
        raise top.refuse("arm beside robots", "one or the other", at=("arm",))
    names = [str(name) for name in section.data]
    if len(names) < 2:
        hint = "one robot is written under arm"
        raise top.refuse(f"{len(names)} robot", "two robots at least", at=("robots",), hint=hint)
    robots = {name: read_as(CellRobot, section.section(name)) for name in names}
    for name, robot in robots.items():
        where = section.section(name)
        if bool(robot.tip) == bool(robot.chains):
            found = "both tip and chains" if robot.tip else "neither tip nor chains"
            raise where.refuse(found, "one of them")
    for name in names[1:]:
        if robots[name].gravity is not None:
            hint = "gravity points along the axes of the first robot's base, which is the cell's"
            where = section.section(name)
            expected = f"gravity in the entry of {names[0]}"
            raise where.refuse(
                f"gravity in that of {name}", expected, at=(GRAVITY.name,), hint=hint
            )
    if robots[names[0]].pose is not None:
        expected = "none: its base is that of the cell"
        hint = "give the pose of the other robot's base in it"
        where = section.section(names[0])
        raise where.refuse("a pose of the first robot", expected, at=("pose",), hint=hint)
    chains = {c: spec for name, robot in robots.items() for c, spec in robot.in_cell(name).items()}
    spec = ArmSpec(
        robots[names[0]].urdf,
        chains=chains,
        gravity=robots[names[0]].gravity,
        section=section,
        robots=robots,
    )
    return spec if urdf is None else replace(spec._of(urdf), section=section)
