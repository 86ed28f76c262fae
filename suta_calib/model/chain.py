"""The chain from base to tip, as the user's URDF writes it, checked.

What a calibration needs of a URDF is little: the joints between two links, their origins, axes
and limits. They are taken from the file's own text, so that a message can name its line and a
calibrated value can go back to where the nominal one stood.

Base and tip are any two links of one tree. The way between them climbs from the base to the link
that is above both, against the direction of the joints, and descends from there to the tip.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import UrdfError
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.model.kinematic_urdf import notes
from suta_calib.model.urdf_tree import (
    Element,
    TreeJoint,
    UrdfTree,
    attribute,
    children,
    finite_numbers,
    quoted,
    read_tree,
    refusal,
    suggestion,
    tag_of,
    unexpanded,
)
from suta_calib.units import FARTHEST
from suta_calib.words import listed

_MOVING_TYPES: Final = ("revolute", "continuous", "prismatic")
_SUPPORTED_TYPES: Final = (*_MOVING_TYPES, "fixed")


@dataclass(frozen=True)
class Mimic:
    """What moves a joint that has no reading of its own: ``multiplier · reading + offset``.

    Attributes:
        joint: name of the joint whose reading it follows; one that follows nobody.
        multiplier: rad or m per rad or m of that reading.
        offset: where the joint is when that reading is zero, rad (m for prismatic).
    """

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True, eq=False)
class ChainJoint(Displayable):
    """One joint of the chain, moving or fixed.

    Attributes:
        name: the joint's name.
        type: ``revolute``, ``continuous``, ``prismatic`` or ``fixed``.
        parent: the link it hangs on.
        child: the link it carries.
        xyz: (3,) position of its origin in the parent link's frame, m; zeros without ``<origin>``.
        rpy: (3,) fixed-axis roll, pitch, yaw of its origin, rad; zeros without ``<origin>``.
        axis: (3,) unit vector in the joint's own frame; 1 0 0 where the file gives none.
        lower: lowest reading, rad (m for prismatic); -inf for continuous and where not given, 0
            for fixed.
        upper: highest reading, likewise.
        line: line of the ``<joint>`` in the file, from 1.
        mimic: whose reading it follows; None for a joint with a reading of its own.
        climbed: whether the chain passes it from its child link to its parent link.
        passive: whether it has no encoder, and follows from a closed loop (`model.loop`).
    """

    name: str
    type: str
    parent: str
    child: str
    xyz: FloatArray
    rpy: FloatArray
    axis: FloatArray
    lower: float
    upper: float
    line: int
    mimic: Mimic | None = None
    climbed: bool = False
    passive: bool = False

    @property
    def moving(self) -> bool:
        """Whether the joint moves, by a reading of its own or by another's."""
        return self.type in _MOVING_TYPES


@dataclass(frozen=True, eq=False)
class LoopJoints:
    """The joints of a closed loop that hangs on the tree (`model.loop`).

    Attributes:
        passive: names of the two that have no encoder, and follow the others.
        branches: the joints from the link above both ends of the loop down to each of them.
        axis: (3,) common axis of the joints that turn, in the frame of that link.
    """

    passive: tuple[str, str]
    branches: tuple[tuple[ChainJoint, ...], tuple[ChainJoint, ...]]
    axis: FloatArray

    @property
    def drawn_senses(self) -> dict[str, float]:
        """Whether joints turn about the loop's axis or against it, 1 or -1, by name."""
        senses = dict[str, float]()
        for branch in self.branches:
            rotation = np.eye(3)
            for joint in branch:
                rotation = rotation @ rotation_from_rpy(joint.rpy)
                senses[joint.name] = float(np.sign(rotation @ joint.axis @ self.axis))
        return senses

    @property
    def joints(self) -> tuple[ChainJoint, ...]:
        """Of both branches."""
        return (*self.branches[0], *self.branches[1])


@dataclass(frozen=True, eq=False)
class Chain(Displayable):
    """The joints from a base link to a tip, and where they were read.

    Attributes:
        path: the URDF file, or what messages call a URDF that was given as text.
        data: its bytes, which a calibrated URDF is made of.
        robot: name of the robot.
        base: name of the link the chain starts at.
        tip: the tip as the user named it: a link, or a joint for the link it carries.
        tip_link: name of the link the chain ends at.
        top: name of the link above both, where climbing ends: the base itself for most arms.
        joints: every joint from base to tip, fixed ones included.
        moving: the joints that have a reading, in the order in which the chain first needs them:
            those of `joints` that follow nobody, and those that others of `joints` follow, which
            need not be on the chain.
        coupled: by joint of the robot, those that move it too by a ``<transmission>``.
        notes: what the file has that other readers may refuse, and no pose depends on.
        loops: closed loops that move joints of the chain, in the order in which they are solved.
    """

    path: Path
    data: bytes
    robot: str
    base: str
    tip: str
    tip_link: str
    top: str
    joints: tuple[ChainJoint, ...]
    moving: tuple[ChainJoint, ...]
    coupled: Mapping[str, tuple[str, ...]]
    notes: tuple[str, ...] = ()
    loops: tuple[LoopJoints, ...] = ()

    @property
    def ends(self) -> tuple[str, str]:
        """Base and tip: what tells chains of one robot apart."""
        return self.base, self.tip

    @property
    def beside(self) -> tuple[ChainJoint, ...]:
        """The joints of the loops that are not on the way from base to tip."""
        on_the_way = {joint.name for joint in self.joints}
        every = {joint.name: joint for loop in self.loops for joint in loop.joints}
        return tuple(joint for name, joint in every.items() if name not in on_the_way)


def read_chain(path: str | Path, tip: str, base: str | None = None) -> Chain:
    """Read and check the chain from ``base`` to ``tip``.

    Joints off the chain may be of any type; their origins, axes and limits are not looked at.

    Args:
        path: of the URDF, or its text.
        tip: name of a link, or of a joint, which stands for its child link; both mean the link.
        base: the same; the root link by default.

    Raises:
        UrdfError: the file is no usable URDF (`urdf_tree.read_tree`), a name is unknown, no joint
            between base and tip moves, or a joint between them is of a type that has no single
            reading, has unusable numbers, or follows a joint that is not there, has no reading,
            or follows it.
    """
    return chain_of(read_tree(path), tip, base)


def chain_of(tree: UrdfTree, tip: str, base: str | None = None) -> Chain:
    """`read_chain` of a URDF that was read."""
    base_link = tree.root if base is None else _known_link(tree, base, "base")
    tip_link = _known_link(tree, tip, "tip")
    climbed, descended = _joints_between(tree, base_link, tip_link)
    inside = {joint.element for joint in (*climbed, *descended)}
    if problem := unexpanded(tree.path, [e for e in tree.leftover if e.getparent() in inside]):
        raise problem
    joints = tuple(chain_joint(tree, joint, climbed=True) for joint in climbed)
    joints += tuple(chain_joint(tree, joint) for joint in descended)
    if not any(joint.moving for joint in joints):
        description = f"only fixed joints between {quoted(base or base_link)} and {quoted(tip)}"
        raise UrdfError(description, "at least one joint that moves", file=tree.path, where="tip")
    top = climbed[-1].parent if climbed else base_link
    by_name = {joint.name: joint for joint in joints}
    read = dict.fromkeys(j.mimic.joint if j.mimic else j.name for j in joints if j.moving)
    moving = tuple(by_name.get(name) or chain_joint(tree, tree.joints[name]) for name in read)
    # Couplings of every two joints are offered: of 200 joints 40,000, for which a second is enough.
    most_joints = 250
    if len(moving) > most_joints:
        ends_named = f"{quoted(base_link)} and {quoted(tip)}"
        excess = f"{len(moving)} joints that move between {ends_named}"
        raise UrdfError(excess, f"at most {most_joints}", file=tree.path, where="tip")
    return Chain(
        *(tree.path, tree.data, tree.robot or tree.path.stem, base_link, tip, tip_link, top),
        *(joints, moving, coupled_joints(tree.element), notes(tree, [*climbed, *descended])),
    )


def _known_link(tree: UrdfTree, given: str, where: str) -> str:
    name = str(given)  # Python lets a caller give anything.
    if name in tree.links:
        return name
    if name in tree.joints:
        return tree.joints[name].child
    if (problem := unexpanded(tree.path, tree.leftover)) is not None:
        raise problem
    hint = suggestion(name, (*tree.links, *tree.joints), "links and joints")
    if where == "tip":
        hint += f"; {ends(tree)}"
    expected = "a link or a joint of the file"
    raise UrdfError(quoted(name), expected, file=tree.path, where=where, hint=hint)


def ends(tree: UrdfTree) -> str:
    """A hint for who looks for a tip: links that carry no other, beyond the most joints first."""

    def moving(link: str) -> int:
        return sum(joint.moves for joint in tree.path_to_root(link))

    links = sorted(tree.leaves, key=moving, reverse=True)
    return f"the chains of the file end at {listed([quoted(link) for link in links], 12)}"


def other_chains(tree: UrdfTree, tip: str) -> list[str]:
    """Links at the ends of what may be other arms or legs, one for each.

    Args:
        tree: of the robot.
        tip: the link at the end of the chain; what it carries, such as fingers, is no other arm.
    """
    # A gripper beside the tip has fewer joints.
    joints_of_an_arm = 3
    paths = sorted((tree.path_to_root(link)[::-1] for link in tree.leaves), key=len, reverse=True)
    passed = {joint.name for joint in tree.path_to_root(tip)}
    chains = []
    for path in paths:
        moving = [joint for joint in path if joint.moves and joint.name not in passed]
        carried = any(joint.parent == tip for joint in path)
        if len(moving) >= joints_of_an_arm and not carried:
            chains.append(path[-1].child)
            passed |= {joint.name for joint in path}
    return chains


def _joints_between(tree: UrdfTree, base: str, tip: str) -> tuple[list[TreeJoint], list[TreeJoint]]:
    """The joints from the base up to the link above both, and from there down to the tip."""
    if base == tip:
        same = f"{quoted(tip)} as both base and tip"
        raise UrdfError(
            same, "two links of the file, with joints between them", file=tree.path, where="tip"
        )
    climbed, descended = tree.path_to_root(base), tree.path_to_root(tip)
    while climbed and descended and climbed[-1] is descended[-1]:
        climbed.pop()
        descended.pop()
    return climbed, descended[::-1]


def chain_joint(tree: UrdfTree, joint: TreeJoint, *, climbed: bool = False) -> ChainJoint:
    """One joint of the tree, checked."""
    path = tree.path
    where, element = f"joint {quoted(joint.name)}", joint.element
    kind = attribute(path, element, "type", where)
    if kind not in _SUPPORTED_TYPES:
        expected = f"{', '.join(_SUPPORTED_TYPES[:-1])} or fixed in the chain"
        # The base of a robot that stands free, or drives.
        free = kind in ("floating", "planar") and not climbed
        hint = f"choose its child as the base: {quoted(joint.child)}" if free else ""
        raise refusal(path, element, f"the type {quoted(kind)}", expected, where, hint)
    xyz, rpy = np.zeros(3), np.zeros(3)
    for origin in children(element, "origin")[:1]:
        place = f"{where}: <origin>"
        xyz, rpy = (_numbers(path, origin, key, place, (0.0,) * 3) for key in ("xyz", "rpy"))
        for key, numbers in (("xyz", xyz), ("rpy", rpy)):
            if np.abs(numbers).max() > FARTHEST:
                expected = f"numbers within {FARTHEST:g}"
                raise refusal(path, origin, f"{key}={quoted(origin.get(key))}", expected, place)
    moving = kind in _MOVING_TYPES
    axis = _axis(path, element, where) if moving else np.array([1.0, 0.0, 0.0])
    lower, upper = _limits(path, element, kind, where)
    return ChainJoint(
        *(joint.name, kind, joint.parent, joint.child, xyz, rpy, axis, lower, upper, joint.line),
        _mimic(tree, joint) if moving else None,
        climbed,
    )


def _mimic(tree: UrdfTree, joint: TreeJoint) -> Mimic | None:
    """What a joint follows: where that follows another itself, the one at the end."""
    follower, multiplier, offset = joint, 1.0, 0.0
    passed = [joint.name]
    while mimics := children(follower.element, "mimic")[:1]:
        mimic, place = mimics[0], f"joint {quoted(follower.name)}: <mimic>"
        name = attribute(tree.path, mimic, "joint", place)
        m, b = (
            float(_numbers(tree.path, mimic, key, place, (default,))[0])
            for key, default in (("multiplier", 1.0), ("offset", 0.0))
        )
        multiplier, offset = multiplier * m, multiplier * b + offset
        if name not in tree.joints:
            unknown = f"the joint {quoted(name)}, which is not defined"
            hint = suggestion(name, tree.joints, "joints")
            raise refusal(tree.path, mimic, unknown, "a joint of the file", place, hint)
        if name in passed:
            loop = " follows ".join(map(quoted, [*passed[passed.index(name) :], name]))
            expected = "a joint with its own reading at the end"
            raise refusal(tree.path, mimic, f"a loop: {loop}", expected, place)
        follower = tree.joints[name]
        kind = attribute(tree.path, follower.element, "type", f"joint {quoted(name)}")
        if kind not in _MOVING_TYPES:
            expected = f"a {', '.join(_MOVING_TYPES[:-1])} or {_MOVING_TYPES[-1]} joint"
            what = f"the joint {quoted(name)}, which is {kind} and has no single reading"
            raise refusal(tree.path, mimic, what, expected, place)
        passed.append(name)
    return Mimic(follower.name, multiplier, offset) if follower is not joint else None


def _axis(path: Path, element: Element, where: str) -> FloatArray:
    for axis in children(element, "axis")[:1]:
        place = f"{where}: <axis>"
        vector = _numbers(path, axis, "xyz", place, (1.0, 0.0, 0.0))
        largest = np.abs(vector).max()
        if largest < 1e-12:
            raise refusal(path, axis, f"xyz={quoted(axis.get('xyz'))}", "a direction", place)
        # Scaled first, so that the squares of very large numbers do not overflow.
        scaled = vector / largest
        return np.asarray(scaled / np.linalg.norm(scaled), dtype=float)
    return np.array([1.0, 0.0, 0.0])


def _limits(path: Path, element: Element, kind: str, where: str) -> tuple[float, float]:
    """Lowest and highest reading; a limit given alone has 0 as its other side, as URDF says."""
    if kind == "fixed":
        return 0.0, 0.0
    given = children(element, "limit")[:1]
    if kind == "continuous" or not given or not {"lower", "upper"} & set(given[0].keys()):
        return -math.inf, math.inf
    place = f"{where}: <limit>"
    lower, upper = (
        float(_numbers(path, given[0], key, place, (0.0,))[0]) for key in ("lower", "upper")
    )
    # Public files say so that a joint has no limit: exporters write two zeros, others -1 for both.
    return (lower, upper) if lower < upper else (-math.inf, math.inf)


def _numbers(
    path: Path, element: Element, key: str, where: str, default: tuple[float, ...]
) -> FloatArray:
    """The numbers of an attribute, as many as its default has."""
    text = element.get(key)
    if text is None:
        return np.array(default)
    numbers = finite_numbers(text)
    if len(numbers) == len(default):
        return np.array(numbers)
    expected = "a finite number" if len(default) == 1 else f"{len(default)} finite numbers"
    hint = "run xacro first" if "${" in text or "$(" in text else ""
    raise refusal(path, element, f"{key}={quoted(text)}", expected, where, hint)


# Roles of the joints that are moved too, each with the role of the one whose motor does it.
MOVED: Final[Mapping[str, tuple[tuple[str, str], ...]]] = {
    "DifferentialTransmission": (("joint1", "joint2"), ("joint2", "joint1")),
    # The first bar turns the frame in which the second one's motor stands.
    "FourBarLinkageTransmission": (("joint2", "joint1"),),
}


def coupled_joints(robot: Element) -> dict[str, tuple[str, ...]]:
    """By joint: those whose motors move it too, by a ``<transmission>`` of ros_control (or 2).

    A transmission of another type, or one that names no two joints, couples nothing: what a
    controller would refuse is nothing to a chain. Readings mostly have the coupling taken out of
    them already: these joints are offered for what is wrong with it, and nothing is moved.
    """
    coupled: dict[str, tuple[str, ...]] = {}
    places = [robot, *children(robot, "ros2_control")]
    for transmission in (t for place in places for t in children(place, "transmission")):
        kind = _text(transmission, "type", "plugin").rpartition("/")[2]
        # A role is an element in ROS 1, an attribute in ROS 2; without one the order counts.
        joints = {
            joint.get("role") or _text(joint, "role") or f"joint{place}": joint.get("name")
            for place, joint in enumerate(children(transmission, "joint"), 1)
            if joint.get("name")
        }
        for moved, by in MOVED.get(kind, ()):
            if moved in joints and by in joints and joints[moved] != joints[by]:
                before = coupled.get(joints[moved], ())
                coupled[joints[moved]] = tuple(dict.fromkeys([*before, joints[by]]))
    return coupled


def _text(element: Element, *tags: str) -> str:
    """The text of the first child that is called so, or nothing."""
    texts = (child.text for child in element if tag_of(child) in tags)
    return (next(texts, "") or "").strip()
