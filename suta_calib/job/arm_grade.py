"""How an arm was made: what that says of its errors, and how a URDF gives it away."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.errors import JobError, did_you_mean
from suta_calib.model.arm import ArmModel
from suta_calib.model.robot import AnyArm
from suta_calib.model.urdf_tree import children, finite_numbers, read_tree
from suta_calib.terms import KINDS, Term, first_kind
from suta_calib.words import listed


@dataclass(frozen=True)
class ArmGrade:
    """How an arm was made, and what a new job for such an arm starts from.

    Attributes:
        name: as of ``init --grade``.
        about: such an arm, in a few words.
        made: the grade of `measurements.scale.GRADES` of its parts.
        offset_deg: standard deviation of a joint's zero.
        length_mm: of each coordinate of a joint's placement, and of the zero of one that slides.
        tilt_deg: of each angle of a joint's placement.
        kinds: of observation that its owner is likely to have.
        sheet: whether what it touches is likely to be printed on paper.
        hand_error: what the play of its joints leaves of the hand's place and turn from one rest to
            another, mm and deg, standard deviations; None where there is hardly any.
    """

    name: str
    about: str
    made: str
    offset_deg: float
    length_mm: float
    tilt_deg: float
    kinds: tuple[str, ...]
    sheet: bool = False
    hand_error: tuple[float, float] | None = None


def finds_places(kind: type[Term]) -> bool:
    """Whether the pose of an artefact wherever it stood is an unknown of a kind."""
    return kind.needs_artefact and kind.has_angles


_TOUCHED: Final = tuple(first_kind(artefact=on_it).kind for on_it in (True, False))
# Crosses are met as such: in their distances, all that a sheet says of where it lies is lost.
_MET: Final = (next(kind for kind in KINDS.values() if finds_places(kind)).kind,)
# Of servos with 1.5° of play, a quarter of which is left (tests/test_hobby_arm.py).
_PLAY: Final = (0.5, 0.1)
ARM_GRADES: Final[Mapping[str, ArmGrade]] = {
    grade.name: grade
    for grade in (
        ArmGrade("printed", "3-D printed parts, servos", "printed", 3, 1.5, 0.7, _MET, True, _PLAY),
        ArmGrade("hobby", "a kit, servos", "printed", 3, 1.5, 0.5, _MET, True, _PLAY),
        ArmGrade("industrial", "machined parts", "machined", 2, 1, 0.3, _TOUCHED),
        ArmGrade("certified", "all dimensions measured", "certified", 0.2, 0.1, 0.05, _TOUCHED),
    )
}
# Words in the names of robots, and the grade of such robots.
_NAMES: Final[Mapping[str, tuple[str, ...]]] = {
    "printed": ("so100", "so101", "so_arm", "so-arm", "koch", "lerobot", "moveo", "printed"),
    "hobby": ("hobby", "widowx", "viperx", "px100", "openmanipulator", "braccio", "mycobot"),
}


def arm_grade(name: str) -> ArmGrade:
    """The grade of a name.

    Raises:
        JobError: there is none of that name.
    """
    if name not in ARM_GRADES:
        expected, hint = f"one of {', '.join(ARM_GRADES)}", did_you_mean(name, ARM_GRADES)
        raise JobError(f"grade '{name}'", expected, where="--grade", hint=hint)
    return ARM_GRADES[name]


def guessed_grade(arm: AnyArm) -> tuple[ArmGrade, str]:
    """How an arm was probably made, and why.

    The robot's name decides where it is that of a printed arm or of a kit. Otherwise reach, masses,
    efforts and number of joints have one vote each, those of a robot's first chain. A draw goes to
    the wider priors, which cost nothing where the data determine the arm.
    """
    names = f"{arm.robot} {arm.urdf[0].name}".lower()
    for name, words in _NAMES.items():
        for word in words:
            if word in names:
                return ARM_GRADES[name], f"the name of the robot or of its file has {word!r} in it"
    votes: dict[str, list[str]] = {"hobby": [], "industrial": []}
    for name, reason in _votes(arm.arms[0]):
        votes[name].append(reason)
    hobby, industrial = votes.values()
    if len(industrial) > len(hobby):
        return ARM_GRADES["industrial"], listed(industrial)
    if hobby and len(hobby) > len(industrial):
        return ARM_GRADES["hobby"], listed(hobby)
    return ARM_GRADES["hobby"], "the URDF does not show it, and wide priors are the safe choice"


def _votes(arm: ArmModel) -> Iterator[tuple[str, str]]:
    """What a URDF says of the size of an arm, as a vote for a grade and its reason."""
    joints = arm.chain.joints
    first = next(k for k, joint in enumerate(joints) if joint.moving)
    tree = read_tree(*arm.urdf)
    elements = [tree.joints[joint.name].element for joint in arm.chain.moving]
    limits = [limit for element in elements for limit in children(element, "limit")]
    efforts = [n for limit in limits for n in finite_numbers(limit.get("effort", "0"))]
    # What is measured, and what a kit has at most and an industrial arm at least: arms of
    # LeRobot, Robotis and Trossen on one side, of Universal Robots, Franka and KUKA on the other.
    # An effort of 1 is a place holder.
    reach = sum(float(np.linalg.norm(joint.xyz)) for joint in joints[first + 1 :])
    mass = sum(load.mass for load in arm.loads)
    for value, small, large, reason in (
        (reach, 0.6, 0.8, f"a reach of {reach:.2f} m"),
        (mass, 1.5, 4.0, f"moving masses of {mass:.1f} kg"),
        (max(efforts, default=0.0), 12.0, 25.0, f"efforts up to {max(efforts, default=0):g} Nm"),
    ):
        if 0 < value <= small and value != 1.0:
            yield "hobby", reason
        elif value >= large:
            yield "industrial", reason
    if len(arm.own_joints) <= 5:
        yield "hobby", f"{len(arm.own_joints)} joints"
