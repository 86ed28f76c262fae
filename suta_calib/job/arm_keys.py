"""Keys of a job's arm: ``tip_offset_mm``, a probe that no URDF knows, and ``couplings``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, TypeVar

from suta_calib.errors import JobError, ParameterError
from suta_calib.measurements import YamlSection
from suta_calib.measurements.fields import LENGTH, XYZ_MM, Field, Fields, Value
from suta_calib.model.arm import ArmModel
from suta_calib.model.loop import Loop
from suta_calib.model.parameters import POSITION, Selection, coupling_key
from suta_calib.model.robot import Robot
from suta_calib.units import from_mm

_AnyMechanism = TypeVar("_AnyMechanism", ArmModel, Robot)

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

    def on(self, arm: _AnyMechanism, tip: str) -> _AnyMechanism:
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
        ratios: by name of the parameter: what the joint turns (or slides) for one unit of the
            other's reading, beside its own.
        section: where the job says so, for messages.
    """

    ratios: dict[str, float]
    section: YamlSection = field(repr=False, compare=False)

    @classmethod
    def read(cls, arm: YamlSection, key: str) -> Couplings:
        """``couplings: {joint_3: {joint_2: -1}}``.

        Raises:
            JobError: not a mapping of joints to mappings of joints to numbers.
        """
        section = arm.section(key)
        ratios = {
            f"{joint}.{coupling_key(other)}": of_joint.number(other)
            for joint in section.data
            for of_joint in [section.section(joint)]
            for other in of_joint.data
        }
        return cls(ratios, section)

    @property
    def selection(self) -> Selection:
        """The row that names them among a job's parameters, so that a result says what they are."""
        return Selection(tuple(self.ratios), fixed=True, line=self.section.line)

    def on(self, arm: _AnyMechanism) -> _AnyMechanism:
        """The arm with its joints coupled so.

        Raises:
            JobError: the arm has no such joints, or they cannot be coupled.
        """
        for joint, masters in self.section.data.items():
            possible = [arm.couplings[n] for n in arm.couplings if arm.offered[n].owner == joint]
            if not possible:
                joints = dict.fromkeys(arm.offered[n].owner for n in arm.couplings)
                expected = f"one of {', '.join(joints)}" if joints else "an arm with two joints"
                raise self.section.refuse(
                    "no joint that can be coupled to it", expected, at=(joint,)
                )
            for other in masters:
                if other not in possible:
                    raise self.section.refuse(
                        f"no joint whose reading can also move {joint}",
                        f"one of {', '.join(possible)}: another joint of the chain that turns "
                        "or slides as this one does",
                        at=(joint, other),
                    )
        return arm.at(self.ratios)
