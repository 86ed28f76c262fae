"""The links and joints of a URDF as a checked tree, before anything is said about one chain.

Only direct children of ``<robot>`` count: transmissions and gazebo tags hold ``<joint name=…>``
elements of their own. Format: http://wiki.ros.org/urdf/XML.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from suta_calib.errors import UrdfError
from suta_calib.model.urdf_xml import (
    Element,
    attribute,
    children,
    quoted,
    read_robot,
    suggestion,
)


@dataclass(frozen=True, eq=False)
class TreeJoint:
    """One ``<joint>`` that is a direct child of ``<robot>``, of any type.

    Attributes:
        name: unique in the file.
        parent: name of a declared link.
        child: name of a declared link; no other joint has it as its child.
        element: the lxml element, for what only a joint on the chain must satisfy.
        line: line of the element in the file, from 1.
    """

    name: str
    parent: str
    child: str
    element: Element
    line: int


@dataclass(frozen=True, eq=False)
class UrdfTree:
    """Everything a URDF connects: one root link, every other link the child of one joint.

    Attributes:
        path: the file.
        robot: name of the ``<robot>``.
        links: names of all links, in the file's order.
        joints: all joints by name, in the file's order.
        into: the joint into each link, by the link's name; the root link has none.
        root: the link that is no joint's child.
    """

    path: Path
    robot: str
    links: tuple[str, ...]
    joints: Mapping[str, TreeJoint]
    into: Mapping[str, TreeJoint]
    root: str

    def path_to_root(self, link: str) -> list[TreeJoint]:
        """The joints passed on the way from ``link`` up to the root, in that order."""
        passed = []
        while link in self.into:
            passed.append(self.into[link])
            link = passed[-1].parent
        return passed


def read_tree(path: str | Path) -> UrdfTree:
    """Read a URDF and check that its joints and links make one tree.

    Args:
        path: a URDF file (not a xacro file).

    Raises:
        UrdfError: the file cannot be read or is not XML, its root is not ``<robot>``, xacro was
            not run, a name is missing or used twice, a joint connects a link that is not
            declared, or the joints make a loop, a cycle or several trees.
    """
    path = Path(path)
    robot = read_robot(path)
    links = _by_name(path, robot, "link")
    elements = _by_name(path, robot, "joint")
    if not elements:
        line = robot.sourceline
        raise UrdfError("no <joint> in <robot>", "a chain of joints", file=path, line=line)
    joints = {name: _tree_joint(path, name, elements[name], links) for name in elements}
    into = _joint_into_each_link(path, joints.values())
    root = _root(path, links, into)
    return UrdfTree(path, robot.get("name"), tuple(links), joints, into, root)


def _by_name(path: Path, robot: Element, tag: str) -> dict[str, Element]:
    named: dict[str, Element] = {}
    for element in children(robot, tag):
        name = attribute(path, element, "name", f"<{tag}>")
        if name in named:
            found = f"the {tag} name {quoted(name)}, already used in line {named[name].sourceline}"
            expected = f"every {tag} to have its own name"
            raise UrdfError(found, expected, file=path, line=element.sourceline)
        named[name] = element
    return named


def _tree_joint(path: Path, name: str, element: Element, links: Mapping[str, Element]) -> TreeJoint:
    parent, child = (_linked(path, name, element, tag, links) for tag in ("parent", "child"))
    return TreeJoint(name, parent, child, element, element.sourceline)


def _linked(
    path: Path, joint: str, element: Element, tag: str, links: Mapping[str, Element]
) -> str:
    where = f"joint {quoted(joint)}"
    found = children(element, tag)
    if not found:
        expected = f'<{tag} link="…"/>'
        raise UrdfError(f"no <{tag}>", expected, file=path, line=element.sourceline, where=where)
    link = attribute(path, found[0], "link", f"{where}: <{tag}>")
    if link not in links:
        raise UrdfError(
            f"the {tag} link {quoted(link)}, which no <link> declares",
            file=path,
            line=found[0].sourceline,
            where=where,
            hint=suggestion(link, links, "links"),
        )
    return link


def _joint_into_each_link(path: Path, joints: Iterable[TreeJoint]) -> dict[str, TreeJoint]:
    into: dict[str, TreeJoint] = {}
    for joint in joints:
        other = into.setdefault(joint.child, joint)
        if other is not joint:
            found = (
                f"two joints into it, {quoted(other.name)} (line {other.line}) and "
                f"{quoted(joint.name)}: a closed loop"
            )
            where = f"link {quoted(joint.child)}"
            raise UrdfError(found, "a serial chain", file=path, line=joint.line, where=where)
    return into


def _root(path: Path, links: Mapping[str, Element], into: Mapping[str, TreeJoint]) -> str:
    _refuse_cycle(path, into)
    first, *others = [link for link in links if link not in into]
    if others:
        found = f"{1 + len(others)} links without a parent: {quoted(first)}, {quoted(others[0])}"
        found += ", …" if len(others) > 1 else ""
        hint = "connect them by joints or remove what is not used"
        line = links[others[0]].sourceline
        raise UrdfError(found, "one root link", file=path, line=line, hint=hint)
    return first


def _refuse_cycle(path: Path, into: Mapping[str, TreeJoint]) -> None:
    """Walk up from every link; a walk that meets itself before known ground is a cycle."""
    grounded: set[str] = set()
    for start in into:
        walk: dict[str, TreeJoint] = {}
        link = start
        while link in into and link not in grounded:
            if link in walk:
                joint = walk[link]
                found = f"a cycle: following parents from link {quoted(link)} leads back to it"
                where = f"joint {quoted(joint.name)}"
                raise UrdfError(found, "a tree", file=path, line=joint.line, where=where)
            walk[link] = into[link]
            link = into[link].parent
        grounded.update(walk)
