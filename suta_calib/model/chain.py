"""The serial chain from base to tip, as the user's URDF writes it, checked.

What a calibration needs of a URDF is little: the joints between two links, their origins, axes
and limits. They are taken from the file's own text, so that a message can name its line and a
calibrated value can go back to where the nominal one stood.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import UrdfError
from suta_calib.model.urdf_tree import (
    Element,
    TreeJoint,
    UrdfTree,
    attribute,
    children,
    quoted,
    read_tree,
    refusal,
    suggestion,
)
from suta_calib.units import FARTHEST

_MOVING_TYPES: Final = ("revolute", "continuous", "prismatic")
_SUPPORTED_TYPES: Final = (*_MOVING_TYPES, "fixed")
# float() takes more than a URDF may say: 'nan', '1_000', digits of other scripts.
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_SHORTEST_AXIS: Final = 1e-12


@dataclass(frozen=True, eq=False)
class ChainJoint:
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

    @property
    def moving(self) -> bool:
        """Whether the joint has a reading."""
        return self.type in _MOVING_TYPES


@dataclass(frozen=True, eq=False)
class Chain:
    """The joints from a base link to a tip, and where they were read.

    Attributes:
        path: the URDF file.
        robot: name of the robot.
        base: name of the link the chain starts at.
        tip: the tip as the user named it: a link, or a joint for the link it carries.
        tip_link: name of the link the chain ends at.
        joints: every joint from base to tip, fixed ones included.
    """

    path: Path
    robot: str
    base: str
    tip: str
    tip_link: str
    joints: tuple[ChainJoint, ...]

    @property
    def moving(self) -> tuple[ChainJoint, ...]:
        """The joints that have a reading, from base to tip."""
        return tuple(joint for joint in self.joints if joint.moving)


def read_chain(path: str | Path, tip: str, base: str | None = None) -> Chain:
    """Read and check the chain from ``base`` to ``tip``.

    Joints off the chain may be of any type; their origins, axes and limits are not looked at.

    Args:
        path: of the URDF.
        tip: name of a link, or of a joint, which stands for its child link; both mean the link.
        base: name of a link above the tip; the root link by default.

    Raises:
        UrdfError: the file is no usable URDF (`urdf_tree.read_tree`), a name is unknown, the base
            is not above the tip, no joint between them moves, or a joint between them is of a
            type that has no single reading of its own or has unusable numbers.
    """
    tree = read_tree(path)
    joint_named = None if tip in tree.links else tree.joints.get(tip)
    tip_link = _known_link(tree, tip, "tip") if joint_named is None else joint_named.child
    base_link = tree.root if base is None else _known_link(tree, base, "base")
    joints = tuple(_chain_joint(tree.path, j) for j in _joints_between(tree, base_link, tip_link))
    if not any(joint.moving for joint in joints):
        found = f"only fixed joints between {quoted(base_link)} and {quoted(tip)}"
        raise UrdfError(found, "at least one joint that moves", file=tree.path, where="tip")
    return Chain(tree.path, tree.robot, base_link, tip, tip_link, joints)


def _known_link(tree: UrdfTree, name: str, where: str) -> str:
    if name in tree.links:
        return name
    expected = "a link" if where == "base" else "a link or a joint"
    names = tree.links if where == "base" else (*tree.links, *tree.joints)
    hint = suggestion(name, names, "links" if where == "base" else "links and joints")
    raise UrdfError(quoted(name), f"{expected} of the file", file=tree.path, where=where, hint=hint)


def _joints_between(tree: UrdfTree, base: str, tip: str) -> list[TreeJoint]:
    """The joints from base to tip."""
    if base == tip:
        found = f"{quoted(tip)} as both base and tip"
        raise UrdfError(found, "joints between them", file=tree.path, where="tip")
    upwards = tree.path_to_root(tip)
    parents = [joint.parent for joint in upwards]
    if base not in parents:
        found = f"{quoted(base)}, which is not above the tip {quoted(tip)}"
        hint = f"above it are: {', '.join(map(quoted, parents[:8]))}" if parents else ""
        hint = hint or f"{quoted(tip)} is the root link: choose another tip"
        raise UrdfError(found, "a link above it", file=tree.path, where="base", hint=hint)
    return upwards[parents.index(base) :: -1]


def _chain_joint(path: Path, joint: TreeJoint) -> ChainJoint:
    where, element = f"joint {quoted(joint.name)}", joint.element
    kind = attribute(path, element, "type", where)
    if kind not in _SUPPORTED_TYPES:
        expected = f"{', '.join(_SUPPORTED_TYPES[:-1])} or fixed on the chain"
        raise refusal(path, element, f"the type {quoted(kind)}", expected, where)
    for mimic in children(element, "mimic"):
        found = f"<mimic> of joint {quoted(mimic.get('joint', ''))}"
        raise refusal(path, mimic, found, "joints with a reading of their own on the chain", where)
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
        joint.name, kind, joint.parent, joint.child, xyz, rpy, axis, lower, upper, joint.line
    )


def _axis(path: Path, element: Element, where: str) -> FloatArray:
    for axis in children(element, "axis")[:1]:
        place = f"{where}: <axis>"
        vector = _numbers(path, axis, "xyz", place, (1.0, 0.0, 0.0))
        largest = np.abs(vector).max()
        if largest < _SHORTEST_AXIS:
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
    if not given and kind in ("revolute", "prismatic"):
        expected = "<limit lower=… upper=… effort=… velocity=…>, which URDF asks for"
        hint = "add it, or make a revolute joint continuous"
        raise refusal(path, element, f"a {kind} joint without <limit>", expected, where, hint)
    if kind == "continuous" or not given or not {"lower", "upper"} & set(given[0].keys()):
        return -math.inf, math.inf
    place = f"{where}: <limit>"
    lower, upper = (
        float(_numbers(path, given[0], key, place, (0.0,))[0]) for key in ("lower", "upper")
    )
    if lower > upper:
        found = f"lower={lower!r} above upper={upper!r}"
        raise refusal(path, given[0], found, "lower at most upper", place)
    return lower, upper


def _numbers(
    path: Path, element: Element, key: str, where: str, default: tuple[float, ...]
) -> FloatArray:
    """The numbers of an attribute, as many as its default has."""
    text = element.get(key)
    if text is None:
        return np.array(default)
    words = text.split()
    numbers = [float(word) for word in words if _NUMBER.fullmatch(word)]
    if len(words) == len(numbers) == len(default) and all(map(math.isfinite, numbers)):
        return np.array(numbers)
    expected = "a finite number" if len(default) == 1 else f"{len(default)} finite numbers"
    hint = "run xacro first" if "${" in text or "$(" in text else ""
    raise refusal(path, element, f"{key}={quoted(text)}", expected, where, hint)
