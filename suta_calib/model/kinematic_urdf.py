"""The part of a URDF that is kinematics, for Pinocchio, and notes on the rest.

URDF readers refuse a whole file for what no chain depends on: a limit of effort below zero, a
material that is declared twice, a shape without a size. So Pinocchio gets the chain's joints as the
file writes them, every other joint fixed where it is, and the links with their masses.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any, Final
from xml.sax.saxutils import quoteattr

import pinocchio as pin

from suta_calib.errors import UrdfError
from suta_calib.model.urdf_tree import (
    Element,
    TreeJoint,
    UrdfTree,
    children,
    finite_numbers,
    quoted,
)
from suta_calib.words import listed

# Nothing here asks for limits, and URDF readers do.
_LIMIT: Final = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
_LIMITED: Final = ("revolute", "prismatic")


def pinocchio_model(tree: UrdfTree, moving: Collection[str]) -> Any:
    """The `pin.Model` in which these joints move, and all others are fixed."""
    try:
        return pin.buildModelFromXML("\n".join(_lines(tree, moving)))
    except (ValueError, RuntimeError) as error:
        problem = f"a model that Pinocchio rejects ({str(error).strip().splitlines()[0]})"
        raise UrdfError(problem, "a URDF that Pinocchio can load", file=tree.path) from error


def moving_model(tree: UrdfTree, chain: Any) -> Any:
    """`pinocchio_model` in which the joints of a chain and of its closed loops move."""
    moving = {joint.name for joint in (*chain.joints, *chain.beside) if joint.moving}
    return pinocchio_model(tree, moving)


def _lines(tree: UrdfTree, moving: Collection[str]) -> Iterator[str]:
    yield f'<?xml version="1.0" encoding="utf-8"?>\n<robot name={quoteattr(tree.robot or "robot")}>'
    inertial = {link.get("name"): _inertial(link) for link in children(tree.element, "link")}
    for link in tree.links:
        yield f"<link name={quoteattr(link)}>{inertial[link]}</link>"
    for joint in tree.joints.values():
        kind = str(joint.element.get("type")) if joint.name in moving else "fixed"
        axis = _element(joint.element, "axis", "xyz") if kind != "fixed" else ""
        yield (
            f"<joint name={quoteattr(joint.name)} type={quoteattr(kind)}>"
            f"<parent link={quoteattr(joint.parent)}/><child link={quoteattr(joint.child)}/>"
            f"{_element(joint.element, 'origin', 'xyz', 'rpy')}{axis}"
            f"{_LIMIT if kind in _LIMITED else ''}</joint>"
        )
    yield "</robot>"


def _element(parent: Element, tag: str, *names: str) -> str:
    """The first child of a tag with those of its attributes that are three finite numbers."""
    for element in children(parent, tag)[:1]:
        numeric = [n for n in names if len(finite_numbers(element.get(n, ""))) == 3]
        return f"<{tag} {' '.join(f'{n}={quoteattr(element.get(n))}' for n in numeric)}/>"
    return ""


def _mass(inertial: Element) -> float | None:
    """The mass of a link, kg; None where it is no number, or below zero."""
    masses = [finite_numbers(e.get("value", "")) for e in children(inertial, "mass")[:1]]
    return masses[0][0] if masses and len(masses[0]) == 1 and masses[0][0] >= 0 else None


def _inertial(link: Element) -> str:
    """Mass and centre; moments of inertia turn nothing that is at rest."""
    for inertial in children(link, "inertial")[:1]:
        if mass := _mass(inertial):
            return (
                f"<inertial>{_element(inertial, 'origin', 'xyz', 'rpy')}<mass value='{mass!r}'/>"
                '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
            )
    return ""


def notes(tree: UrdfTree, chain: Collection[TreeJoint]) -> tuple[str, ...]:
    """What the file has that other readers may refuse, and that no pose of the chain depends on."""
    places: dict[str, list[Element]] = {}
    for note, element in _notes(tree, {joint.name for joint in chain}):
        places.setdefault(note, []).append(element)
    return tuple(f"{note} ({_lines_of(elements)})" for note, elements in places.items())


def _notes(tree: UrdfTree, chain: Collection[str]) -> Iterator[tuple[str, Element]]:
    """Each with its element; of a joint off the chain nothing but its place in the tree is used."""
    if not tree.robot:
        yield "<robot> has no name", tree.element
    for link in tree.loose:
        yield (
            f"link {quoted(link.get('name'))}, which is not connected to any joint, is ignored",
            link,
        )
    for element in tree.leftover:
        tag = f"<{element.prefix}:{element.tag.rpartition('}')[2].rpartition(':')[2]}>"
        yield f"{tag}, which xacro did not expand, is ignored", element
    for joint in tree.joints.values():
        yield from _joint_notes(joint, joint.name in chain)
    for link in children(tree.element, "link"):
        for inertial in children(link, "inertial")[:1]:
            if _mass(inertial) is None:
                yield "an impossible mass is ignored", inertial


def _joint_notes(joint: TreeJoint, checked: bool) -> Iterator[tuple[str, Element]]:
    limited = joint.element.get("type") in _LIMITED and checked
    limits = children(joint.element, "limit")[:1]
    if limited and not limits:
        yield "a joint without <limit> is treated as unlimited", joint.element
    for limit in limits:
        values = {n: finite_numbers(limit.get(n, "0")) for n in limit.keys()}  # noqa: SIM118
        one = {name: v[0] for name, v in values.items() if len(v) == 1}
        empty = {"lower", "upper"} & set(one) and one.get("lower", 0.0) >= one.get("upper", 0.0)
        if limited and empty:
            note = "a joint whose lower limit is not below its upper limit is treated as unlimited"
            yield note, limit
        for name in ("effort", "velocity"):
            if one.get(name, 0.0) < 0 or (name in values and name not in one):
                yield f"an impossible limit of {name} is ignored", limit
    for origin in children(joint.element, "origin")[:1]:
        texts = [text for n in ("xyz", "rpy") if (text := origin.get(n)) is not None]
        if any(len(finite_numbers(text)) != 3 for text in texts):
            note = "the <origin> of a joint outside the chain is not three numbers, and is ignored"
            yield note, origin


def _lines_of(elements: list[Element]) -> str:
    lines = list(dict.fromkeys(str(element.sourceline) for element in elements))
    return f"line{'s' * (len(lines) > 1)} {listed(lines, 3)}"
