"""Several robots in one cell, each with a URDF of its own, joined into one tree.

A fixed joint carries the base of every other robot in the base of the first. What is joined so is
one mechanism, and nothing beneath knows that it was several. Links and joints are called as in
their own URDF, after the name of the robot: ``a/joint_1``.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping
from copy import deepcopy
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final

import numpy as np
from lxml import etree

from suta_calib.arrays import FloatArray
from suta_calib.errors import UrdfError, did_you_mean
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.inputs import XacroFile
from suta_calib.model.parameters import base_owner
from suta_calib.model.urdf_tree import Element, UrdfTree, children, read_tree, tag_of, tree_of

# Rotation (3, 3) and position (3,), m.
BasePose = tuple[FloatArray, FloatArray]
# A name stands before a slash, in names of files and in brackets.
_NAME: Final = re.compile(r"[A-Za-z0-9][\w-]*")
# Children of a robot whose links and joints are named; simulators' tags are not looked at.
_NAMED: Final = ("link", "joint", "transmission", "ros2_control")
# By tag, the attribute that names a link or a joint.
_CALLED: Final = {
    "link": "name",
    "joint": "name",
    "parent": "link",
    "child": "link",
    "mimic": "joint",
}


@dataclass(frozen=True, eq=False)
class CellTree(UrdfTree):
    """The tree of several robots.

    Attributes:
        members: each robot's own tree, by its name; the first one's base is that of the cell.
        placed: names of those whose base stands where somebody says.
    """

    members: Mapping[str, UrdfTree] = None  # type: ignore[assignment]
    placed: tuple[str, ...] = ()


def within(name: str, of_robot: str) -> str:
    """What a link or joint of one robot is called in the cell; as its URDF does without a name."""
    return f"{name}/{of_robot}" if name else of_robot


def own_names(names: Collection[str]) -> dict[str, str]:
    """What joints of a cell may be called too: as the URDF of their robot does, where it is clear.

    Of joints of two robots the same name may be of either.
    """
    alone = {name: name.rpartition("/")[2] for name in names if "/" in name}
    times = Counter(alone.values())
    return {n: short for n, short in alone.items() if times[short] == 1 and short not in names}


def joined_tree(
    urdfs: Mapping[str, str | Path | XacroFile], poses: Mapping[str, BasePose]
) -> CellTree:
    """Join the URDFs of several robots, by name, at poses of their bases in the first one's.

    Raises:
        UrdfError: fewer than two robots, a name that cannot stand before others, a pose of no
            robot or of the first one, or a URDF that cannot be read.
    """
    if len(urdfs) < 2:
        raise UrdfError(f"{len(urdfs)} robot", "two robots at least, by name", where="robots")
    for name in urdfs:
        if not _NAME.fullmatch(str(name)):
            expected = "letters, digits, '_' and '-'"
            raise UrdfError(f"the robot {str(name)!r}", expected, where="robots")
    first, *rest = urdfs
    for name in poses:
        if name not in rest:
            hint = did_you_mean(name, rest)
            found = f"a pose of the base of {name!r}"
            expected = f"of {' or '.join(rest)}, in the base of {first}"
            raise UrdfError(found, expected, where="robots", hint=hint)
    trees = {name: read_tree(urdf) for name, urdf in urdfs.items()}
    cell = etree.Element("robot", name=" and ".join(urdfs))
    for name, tree in trees.items():
        for tag in _NAMED:
            for element in children(tree.element, tag):
                cell.append(_renamed(element, name))
    for name in rest:
        cell.append(_carrying(trees[first].root, trees[name].root, (first, name), poses.get(name)))
    path = trees[first].path.with_name(" + ".join(tree.path.name for tree in trees.values()))
    tree = tree_of(path, etree.tostring(cell, pretty_print=True), cell, ())
    of_tree = {field.name: getattr(tree, field.name) for field in fields(tree)}
    return CellTree(**of_tree, members=trees, placed=tuple(poses))


def _renamed(element: Element, robot: str) -> Element:
    """A copy in which all links and joints are called after their robot."""
    copied = deepcopy(element)
    copied.tail = None
    for child in copied.iter():
        key = _CALLED.get(tag_of(child))
        if key and child.get(key):
            child.set(key, within(robot, child.get(key)))
    return copied


def _carrying(first: str, other: str, names: tuple[str, str], pose: BasePose | None) -> Element:
    """The fixed joint between two bases."""
    rotation, position = (np.eye(3), np.zeros(3)) if pose is None else pose
    joint = etree.Element("joint", name=base_owner(names[1]), type="fixed")
    etree.SubElement(joint, "parent", link=within(names[0], first))
    etree.SubElement(joint, "child", link=within(names[1], other))
    xyz, rpy = (
        " ".join(repr(float(v)) for v in vector)
        for vector in (position, rpy_from_rotation(rotation))
    )
    etree.SubElement(joint, "origin", xyz=xyz, rpy=rpy)
    return joint
