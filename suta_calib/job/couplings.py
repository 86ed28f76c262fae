"""The key ``couplings`` of a job's arm: joints that the readings of others move too, as it says."""

from __future__ import annotations

from dataclasses import dataclass, field

from suta_calib.measurements import YamlSection
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import Selection, coupling_key


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

    def on(self, arm: ArmModel) -> ArmModel:
        """The arm with its joints coupled so.

        Raises:
            JobError: the arm has no such joints, or they cannot be coupled.
        """
        for joint, masters in self.section.data.items():
            possible = [arm.couplings[n] for n in arm.couplings if arm.offered[n].owner == joint]
            if not possible:
                joints = dict.fromkeys(arm.offered[n].owner for n in arm.couplings)
                expected = f"one of {', '.join(joints)}" if joints else "an arm with two joints"
                raise self.section.refuse("no joint that can be coupled", expected, at=(joint,))
            for other in masters:
                if other not in possible:
                    raise self.section.refuse(
                        f"no joint whose reading can move {joint} too",
                        f"one of {', '.join(possible)}: another joint of the chain, which turns "
                        "or slides as this one does",
                        at=(joint, other),
                    )
        return arm.at(self.ratios)
