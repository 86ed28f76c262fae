"""What no URDF says of an arm: its probe, tilt sensors, loops, coupled joints and gears."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, TypeVar

from suta_calib.errors import JobError, ParameterError
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.measurements import YamlSection
from suta_calib.measurements.fields import (
    LENGTH,
    TEXT,
    XYZ_MM,
    Field,
    Fields,
    Value,
)
from suta_calib.measurements.fields import ROTATION as ROTATED
from suta_calib.model.arm import ArmModel
from suta_calib.model.cell import within
from suta_calib.model.loop import Loop
from suta_calib.model.parameters import (
    GEAR_RATIO,
    POSITION,
    Selection,
    coupling_key,
)
from suta_calib.model.robot import Robot
from suta_calib.model.tilt import TiltSensor
from suta_calib.units import from_mm

AnyMechanism = TypeVar("AnyMechanism", ArmModel, Robot, ArmModel | Robot)

TIP_OFFSET_KEYS: Final = Fields(
    Field("position_mm", XYZ_MM, "Approximate position of the tip.", required=True),
    Field("bound_mm", LENGTH, "Largest distance from there.", given_attribute="bound"),
    Field(
        "prior_mm",
        LENGTH,
        "Standard deviation of its distance from there.",
        given_attribute="prior",
    ),
)


@dataclass(frozen=True)
class TipOffset:
    """Where the tip is in the frame that the URDF says it is.

    It becomes part of the tip's own placement ``tip.x|y|z``, and so of a calibrated URDF.

    Attributes:
        position: x, y, z along the axes of the URDF's tip, m.
        bound, prior: half-width of the bounds and standard deviation of a prior about it, m, where
            it is to be found; without either it is taken as given.
        file, line: of the job, for messages.
    """

    position: tuple[float, float, float]
    bound: float | None = None
    prior: float | None = None
    file: Path | None = None
    line: int | None = None

    @classmethod
    def read(cls, arm: YamlSection, key: str) -> TipOffset:
        """``[x, y, z]``, or ``{position_mm, bound_mm, prior_mm}``.

        Raises:
            JobError: a key that is unknown, missing or unusable.
        """
        if isinstance(arm.data[key], list):
            x, y, z = (from_mm(coordinate) for coordinate in arm.numbers(key, 3))
            return cls((x, y, z), file=arm.document.path, line=arm.line)
        section = arm.section(key)
        values = TIP_OFFSET_KEYS.read(section)
        x, y, z = values.pop("position").tolist()
        if not values:
            raise section.refuse(
                "an offset to be estimated, without bound_mm or prior_mm",
                "bound_mm or prior_mm beside position_mm",
                hint=f"a known one is {key}: [x, y, z]",
            )
        return cls((x, y, z), **values, file=section.document.path, line=section.line)

    def selection(self, tip: str) -> Selection:
        """The row that names it among a job's parameters."""
        names = tuple(f"{tip}.{key}" for key in POSITION)
        given = self.bound is None and self.prior is None
        return Selection(names, bound_m=self.bound, prior_m=self.prior, fixed=given, line=self.line)

    def on(self, arm: AnyMechanism, tip: str) -> AnyMechanism:
        """The arm, or the robot, with a tip there.

        Args:
            arm: at nominal.
            tip: name of the tip, of whichever chain.

        Raises:
            JobError: the tip is on a link that moves, and so has no placement of its own.
        """
        chain = next(chain for chain in arm.arms if chain.tip == tip)
        try:
            moved = chain.with_tip_moved(self.position).parameters
            names = [f"{tip}.{key}" for key in POSITION]
            return arm.at({name: moved[name].nominal for name in names})
        except ParameterError as problem:
            raise JobError.of(problem, self.file, self.line) from None


TILT_KEYS: Final = Fields(
    Field("link", TEXT, "The link that the sensor is on.", required=True),
    Field(
        "columns",
        Value("three columns", YamlSection.texts),
        "Columns of the samples with what it felt at rest along its own x, y and z, in any one "
        "unit. A cell may be empty.",
        required=True,
    ),
    replace(
        ROTATED,
        about="How it is turned in the link, as in a URDF. Without it, its turn about the "
        "vertical is estimated. In either case its mean lean is taken as that of the model.",
    ),
)


def read_tilt_sensor(row: YamlSection) -> TiltSensor:
    """A row of ``tilt_sensors``.

    Raises:
        InputError: a key that is unknown, missing or unusable.
    """
    values = TILT_KEYS.read(row)
    columns = tuple(values["columns"])
    if len({*columns}) != 3:
        expected = "three columns: x, y, z"
        raise row.refuse(f"{len({*columns})} columns", expected, at=("columns",))
    turned = values.get("rotation")
    rpy = None if turned is None else tuple(rpy_from_rotation(turned).tolist())
    return TiltSensor(values["link"], columns, rpy)


LOOP_KEYS: Final = Fields(
    Field(
        "frames",
        Value("two links", YamlSection.texts),
        "Two links or frames of the URDF whose origins coincide on the pin that closes the loop.",
        required=True,
    ),
    Field(
        "passive",
        Value("two joints", YamlSection.texts),
        "The two joints of the loop that have no encoder: they follow the others.",
        required=True,
    ),
)


def read_loop(row: YamlSection) -> Loop:
    """One row of ``loops``.

    Raises:
        JobError: a key that is unknown or missing, or another number of names than two.
    """
    values = LOOP_KEYS.read(row)
    for key, names in values.items():
        if len(names) != 2:
            raise row.refuse(f"{len(names)} names", "two names", at=(key,))
    return Loop(**values, line=row.line)


@dataclass(frozen=True)
class Couplings:
    """How far readings of other joints move a joint, where that is known beforehand.

    They are nominal values of ``joint.coupling[other]``, which a job's rows may free like any
    other parameter.

    Attributes:
        ratios: by joint and other joint, as the URDF calls them: what the joint turns (or slides)
            for one unit of the other's reading, beside its own.
        section: where the job says so, for messages.
        robot: of a cell, whose joints they are; empty for that of a job with one.
    """

    ratios: dict[tuple[str, str], float]
    section: YamlSection = field(repr=False, compare=False)
    robot: str = ""

    @classmethod
    def read(cls, arm: YamlSection, key: str) -> Couplings:
        """``couplings: {joint_3: {joint_2: -1}}``.

        Raises:
            JobError: not a mapping of joints to mappings of joints to numbers.
        """
        section = arm.section(key)
        ratios = {
            (joint, other): of_joint.number(other)
            for joint in section.data
            for of_joint in [section.section(joint)]
            for other in of_joint.data
        }
        return cls(ratios, section)

    @property
    def values(self) -> dict[str, float]:
        """The same by name of the parameter."""
        return {
            f"{within(self.robot, joint)}.{coupling_key(within(self.robot, other))}": ratio
            for (joint, other), ratio in self.ratios.items()
        }

    @property
    def selection(self) -> Selection:
        """The row that names them among a job's parameters, so that a result says what they are."""
        return Selection(tuple(self.values), fixed=True, line=self.section.line)

    def on(self, arm: AnyMechanism) -> AnyMechanism:
        """The arm with its joints coupled so.

        Raises:
            JobError: the arm has no such joints, or they cannot be coupled.
        """
        prefix = within(self.robot, "")
        pairs = [
            (arm.offered[name].owner.removeprefix(prefix), other.removeprefix(prefix))
            for name, other in arm.couplings.items()
            if name.startswith(prefix)
        ]
        for joint, other in self.ratios:
            possible = [o for owner, o in pairs if owner == joint]
            if not possible:
                joints = dict.fromkeys(owner for owner, _ in pairs)
                expected = f"one of {', '.join(joints)}" if joints else "an arm with two joints"
                raise self.section.refuse(
                    "no joint that can be coupled to it", expected, at=(joint,)
                )
            if other not in possible:
                raise self.section.refuse(
                    f"no joint whose reading can also move {joint}",
                    f"one of {', '.join(possible)}: another joint of the chain that turns "
                    "or slides as this one does",
                    at=(joint, other),
                )
        return arm.at(self.values)


@dataclass(frozen=True)
class GearRatios:
    """How often the inputs of strain wave gears turn with their joints, where that is known.

    They are nominal values of ``joint.gear_ratio``: ``joint.ripple_c`` and ``joint.ripple_s`` come
    twice with each of these turns.

    Attributes:
        ratios: by joint, as the URDF calls it.
        section: where the job says so, for messages.
        robot: of a cell, whose joints they are; empty for that of a job with one.
    """

    ratios: dict[str, float]
    section: YamlSection = field(repr=False, compare=False)
    robot: str = ""

    @classmethod
    def read(cls, arm: YamlSection, key: str) -> GearRatios:
        """``gear_ratios: {joint_2: 100}``.

        Raises:
            JobError: not a mapping of joints to numbers above zero.
        """
        section = arm.section(key)
        return cls({joint: section.number(joint, "positive") for joint in section.data}, section)

    @property
    def values(self) -> dict[str, float]:
        """The same by name of the parameter."""
        names = {joint: f"{within(self.robot, joint)}.{GEAR_RATIO}" for joint in self.ratios}
        return {names[joint]: ratio for joint, ratio in self.ratios.items()}

    @property
    def selection(self) -> Selection:
        """The row that names them among a job's parameters, so that a result says what they are."""
        return Selection(tuple(self.values), fixed=True, line=self.section.line)

    def on(self, arm: AnyMechanism) -> AnyMechanism:
        """The arm with gears of these ratios.

        Raises:
            JobError: the arm has no such joint that turns.
        """
        for joint, name in zip(self.ratios, self.values, strict=True):
            if name not in arm.offered:
                turning = [n.removesuffix(f".{GEAR_RATIO}") for n in arm.offered if GEAR_RATIO in n]
                expected = f"a joint of the chain that turns: {', '.join(turning)}"
                raise self.section.refuse(f"the joint {joint}", expected, at=(joint,))
        return arm.at(self.values)
