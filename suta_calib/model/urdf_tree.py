"""A URDF file: its elements with line numbers, and its links and joints as a checked tree.

URDF readers know no namespaces and no entities, so neither means anything here. Only direct
children of ``<robot>`` count: transmissions and gazebo tags hold ``<joint name=…>`` elements of
their own. Format: http://wiki.ros.org/urdf/XML.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from lxml import etree

from suta_calib.atomic import note_input
from suta_calib.errors import UrdfError
from suta_calib.inputs import XacroFile, read_input
from suta_calib.model.xacro_file import expanded, is_xacro

# lxml ships without type information.
Element = Any

# What messages call a URDF that was given as text.
_TEXT: Final = Path("the text of a URDF")
_ENCODING: Final = re.compile(r"""<\?xml[^>]*?\bencoding\s*=\s*["']([A-Za-z][\w.-]*)""", re.ASCII)
_LONGEST_QUOTE: Final = 60
# float() takes more than a URDF may say: 'nan', '1_000', digits of other scripts.
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


@dataclass(frozen=True, eq=False)
class TreeJoint:
    """One ``<joint>`` that is a direct child of ``<robot>``, of any type, between declared links.

    Its name is unique, and so is its child. What else it says is in the lxml element, of whose
    line, from 1, messages tell.
    """

    name: str
    parent: str
    child: str
    element: Element
    line: int

    @property
    def moves(self) -> bool:
        """Whether it is not fixed."""
        return bool(self.element.get("type") != "fixed")


@dataclass(frozen=True, eq=False)
class UrdfTree:
    """Everything a URDF connects: one root link, every other link the child of one joint.

    Attributes:
        path: the file, or what messages call a URDF that was given as text.
        data: its bytes, of a ``.xacro`` file what xacro made of it.
        robot: name of the ``<robot>``; empty where it has none.
        links: names of all links that joints connect, in the file's order.
        joints: all joints by name, in the file's order.
        into: the joint into each link, by the link's name; the root link has none.
        root: the link that is no joint's child.
        element: ``<robot>`` itself, for what is no part of the tree.
        leftover: elements that xacro has not expanded; none of them makes a link or joint here.
        loose: elements of links that no joint connects with anything; they are not in `links`.
    """

    path: Path
    data: bytes
    robot: str
    links: tuple[str, ...]
    joints: Mapping[str, TreeJoint]
    into: Mapping[str, TreeJoint]
    root: str
    element: Element
    leftover: tuple[Element, ...] = ()
    loose: tuple[Element, ...] = ()

    @property
    def leaves(self) -> tuple[str, ...]:
        """Links that carry no other, in the file's order: where chains usually end."""
        carrying = {joint.parent for joint in self.joints.values()}
        return tuple(link for link in self.links if link not in carrying)

    def path_to_root(self, link: str) -> list[TreeJoint]:
        """The joints passed on the way from ``link`` up to the root, in that order."""
        passed = []
        while link in self.into:
            passed.append(self.into[link])
            link = passed[-1].parent
        return passed


def read_tree(path: str | Path | XacroFile, data: bytes | None = None) -> UrdfTree:
    """Read a URDF, or what xacro makes of one, and check that its joints and links make one tree.

    It is given by its path, with its content where that is known, or as text.

    Raises:
        UrdfError: the file cannot be read or is not XML, its root is not ``<robot>``, xacro was
            not run, a name is missing or used twice, a joint connects a link that is not
            declared, or the joints make a loop, a cycle or several trees.
    """
    if data is None:
        path, data = _given(path)
    path = Path(path)
    robot = _parsed(path, data)
    if tag_of(robot) != "robot":
        problem = f"the root element <{tag_of(robot)[:_LONGEST_QUOTE]}>"
        raise refusal(path, robot, problem, "<robot>")
    leftover = tuple(e for e in robot.iter() if tag_of(e).startswith("xacro:"))
    try:
        return tree_of(path, data, robot, leftover)
    except UrdfError as problem:
        # What is wrong may be what xacro would have made right.
        raise unexpanded(path, leftover) or problem from None


def unexpanded(path: Path, leftover: Sequence[Element]) -> UrdfError | None:
    """The error that xacro was not run, where something of it is left in a file."""
    for element in leftover[:1]:
        tag = f"<{tag_of(element)[:_LONGEST_QUOTE]}>, which xacro has not expanded"
        hint = "run xacro first, or name the file .xacro: then it is expanded here"
        return refusal(path, element, tag, "plain URDF", hint=hint)
    return None


def _given(urdf: str | Path | XacroFile) -> tuple[Path, bytes]:
    """The name and the bytes of a URDF that was given as a path or as text."""
    if not isinstance(urdf, str | Path | XacroFile):
        raise UrdfError(f"{type(urdf).__name__}", "the path or the text of a URDF", where="urdf")
    text = urdf.lstrip("\ufeff \t\r\n") if isinstance(urdf, str) else ""
    if not text.startswith("<"):
        return Path(urdf), read_urdf_bytes(urdf)
    declared = _ENCODING.match(text)
    try:
        return _TEXT, text.encode(declared[1] if declared else "utf-8")
    except (LookupError, UnicodeError) as error:
        expected = "text in the encoding that it declares"
        raise UrdfError(f"text that cannot be encoded ({error})", expected, file=_TEXT) from None


def tree_of(path: Path, data: bytes, robot: Element, leftover: tuple[Element, ...]) -> UrdfTree:
    """The checked tree of a ``<robot>``, as `read_tree` gives it."""
    links = _by_name(path, robot, "link")
    elements = _by_name(path, robot, "joint")
    if not elements:
        raise refusal(path, robot, "no <joint> in <robot>", "a chain of joints")
    joints: dict[str, TreeJoint] = {}
    into: dict[str, TreeJoint] = {}
    for name, element in elements.items():
        parent, child = (_linked(path, name, element, tag, links) for tag in ("parent", "child"))
        joint = joints[name] = TreeJoint(name, parent, child, element, element.sourceline)
        other = into.setdefault(child, joint)
        if other is not joint:
            both = f"{quoted(other.name)} (line {other.line}) and {quoted(name)}"
            problem = f"two joints, {both}, that have this link as their child: a closed loop"
            raise refusal(path, element, problem, "a serial chain", f"link {quoted(child)}")
    _refuse_cycle(path, into)
    joined = {*into, *(joint.parent for joint in joints.values())}
    loose = tuple(element for link, element in links.items() if link not in joined)
    links = {link: element for link, element in links.items() if link in joined}
    root, *more = [link for link in links if link not in into]
    if more:
        problem = f"{1 + len(more)} links without a parent: {quoted(root)}, {quoted(more[0])}"
        problem += ", …" if len(more) > 1 else ""
        hint = "connect them by joints or remove the unused ones: base and tip must be in one tree"
        raise refusal(path, links[more[0]], problem, "one root link", hint=hint)
    name = robot.get("name", "")
    return UrdfTree(path, data, name, tuple(links), joints, into, root, robot, leftover, loose)


def _by_name(path: Path, robot: Element, tag: str) -> dict[str, Element]:
    named: dict[str, Element] = {}
    for element in children(robot, tag):
        name = attribute(path, element, "name", f"<{tag}>")
        if name in named:
            first = named[name].sourceline
            problem = f"the {tag} name {quoted(name)}, already used in line {first}"
            raise refusal(path, element, problem, f"every {tag} to have its own name")
        named[name] = element
    return named


def _linked(
    path: Path, joint: str, element: Element, tag: str, links: Mapping[str, Element]
) -> str:
    where = f"joint {quoted(joint)}"
    ends_named = children(element, tag)
    if not ends_named:
        raise refusal(path, element, f"no <{tag}>", f'<{tag} link="…"/>', where)
    link = attribute(path, ends_named[0], "link", f"{where}: <{tag}>")
    if link not in links:
        unknown = f"the {tag} link {quoted(link)}, which is not defined"
        hint = suggestion(link, links, "links")
        raise refusal(path, ends_named[0], unknown, where=where, hint=hint)
    return link


def _refuse_cycle(path: Path, into: Mapping[str, TreeJoint]) -> None:
    """Walk up from every link; a walk that meets itself before known ground is a cycle."""
    grounded: set[str] = set()
    for start in into:
        walk: dict[str, TreeJoint] = {}
        link = start
        while link in into and link not in grounded:
            if link in walk:
                joint = walk[link]
                cycle = f"a cycle: the parents of link {quoted(link)} lead back to it"
                raise refusal(path, joint.element, cycle, "a tree", f"joint {quoted(joint.name)}")
            walk[link] = into[link]
            link = into[link].parent
        grounded.update(walk)


# ── elements ─────────────────────────────────────────────────────────────────────────────────
def read_urdf_bytes(path: str | Path | XacroFile) -> bytes:
    """The bytes of a URDF file, in an encoding that contains ASCII; xacro is run on ``.xacro``."""
    if isinstance(path, XacroFile):
        return expanded(path)
    path = Path(path)
    if is_xacro(path):
        return expanded(path)
    try:
        note_input(path)
        data = read_input(path)
    except (OSError, ValueError) as error:
        problem = f"an unreadable file ({getattr(error, 'strerror', None) or error})"
        for kind, name in ((FileNotFoundError, "no such file"), (IsADirectoryError, "a directory")):
            problem = name if isinstance(error, kind) else problem
        raise UrdfError(problem, "a URDF file", file=path) from None
    if not data.strip():
        raise UrdfError("an empty file", "a URDF file", file=path)
    if b"\0" in data[:4] or data.startswith((b"\xff\xfe", b"\xfe\xff")):
        hint = "save it as UTF-8, which other URDF readers need too"
        raise UrdfError("UTF-16 or UTF-32 text", "UTF-8 or Latin-1", file=path, hint=hint)
    return data


def children(element: Element, tag: str) -> list[Element]:
    """The direct children called ``tag``, in order: no comments, no processing instructions."""
    return [child for child in element if tag_of(child) == tag]


def tag_of(element: Element) -> str:
    """The element's name as the file writes it, with its prefix; '' for comments and the like.

    URDF knows no namespaces, so a default namespace on ``<robot>`` changes nothing.
    """
    if not isinstance(element.tag, str):
        return ""
    local = str(element.tag.rpartition("}")[2])
    return f"{element.prefix}:{local}" if element.prefix else local


def attribute(path: Path, element: Element, name: str, where: str) -> str:
    """A text attribute that must be there and not be empty."""
    text = element.get(name)
    if not text:
        problem = f"no {name}" if text is None else f"an empty {name}"
        raise refusal(path, element, problem, f'{name}="…"', where)
    return str(text)


def finite_numbers(text: str) -> list[float]:
    """The numbers of an attribute, as a URDF may write them; none where one of its words is not."""
    words = text.split()
    numbers = [float(word) for word in words if _NUMBER.fullmatch(word)]
    return numbers if len(words) == len(numbers) and all(map(math.isfinite, numbers)) else []


def refusal(
    path: Path, element: Element, problem: str, expected: str = "", where: str = "", hint: str = ""
) -> UrdfError:
    """Error about an element, with its line, to be raised by the caller."""
    return UrdfError(problem, expected, file=path, line=element.sourceline, where=where, hint=hint)


def quoted(text: str) -> str:
    """Text from a file as part of a one-line message: quoted, escaped, not too long."""
    return repr(text if len(text) <= _LONGEST_QUOTE else text[: _LONGEST_QUOTE - 1] + "…")


def suggestion(name: str, available: Iterable[str], kind: str) -> str:
    """A hint for a name that is not there: what looks like it, and some of what there is."""
    names = [candidate for candidate in available if candidate != name]
    close = " or ".join(map(quoted, difflib.get_close_matches(name, names, n=3)))
    shown = ", ".join(map(quoted, names[:8])) + (", …" if len(names) > 8 else "")
    listed = f"{kind} in the file: {shown or 'none'}"
    return f"did you mean {close}? {listed}" if close else listed


def _parsed(path: Path, data: bytes) -> Element:
    """The root element; a prefix nobody declared is forgiven, nothing else is.

    Simulator tags often carry such prefixes, and URDF readers know no namespaces.
    """
    strict, lenient = (
        etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, recover=recover)
        for recover in (False, True)
    )
    try:
        return etree.fromstring(data, strict)
    except etree.XMLSyntaxError as error:
        root = etree.fromstring(data, lenient)
        if root is not None and all(e.type_name.startswith("NS_") for e in lenient.error_log):
            return root
        problem = f"text that is not XML ({' '.join(error.msg.split())})"
        line = error.lineno or None
        raise UrdfError(problem, "a well-formed URDF file", file=path, line=line) from None
