"""Calibrated values back into the user's own URDF, and nothing else changed in it.

An XML library that reads and writes loses what it does not model: attribute order, quotes, line
ends, blank lines. So the file is not written from a tree. Expat tells at which bytes the start
tags stand, and the numbers are exchanged between the quotes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray
from suta_calib.atomic import write_bytes_atomically
from suta_calib.errors import OutputError, UrdfError
from suta_calib.geometry.numbers import rotation_from_rpy, rotation_from_vector, rpy_from_rotation
from suta_calib.model.chain import ChainJoint
from suta_calib.model.urdf_tree import quoted, read_urdf_bytes, suggestion

Origin = tuple[ArrayLike, ArrayLike]

# A quoted value is swallowed whole, so neither '>' nor 'xyz=' inside one is taken for markup.
_ATTRIBUTE: Final = re.compile(rb"""([^\s=<>"'/]+)\s*=\s*("[^"]*"|'[^']*')""")
# What xacro puts a text in place of.
_EXPRESSION: Final = re.compile(r"\$\{[^}]*\}|\$\([^)]*\)")
# Picometres: what is less comes of the rounding of sines and products, not of a measurement.
_DECIMALS: Final = 12
_ROUNDING: Final = 0.5 * 10.0**-_DECIMALS
_TAG: Final = re.compile(rb"""<[^\s<>"'/]+(?:[^<>"']|"[^"]*"|'[^']*')*>""")


@dataclass
class _JointTags:
    """Where a joint's start tag and its first origin's start tag begin, in bytes.

    And its line, its depth below the root, and whether xacro puts something into it.
    """

    joint: int
    line: int = 0
    depth: int = 1
    origin: int | None = None
    filled: bool = False


# ``data[start:stop]`` becomes the text.
_Splice = tuple[int, int, bytes]


def _joint_tags(path: Path, data: bytes) -> list[tuple[str, _JointTags]]:
    """The tags of every joint with its name, as Expat comes by them."""
    tags: list[tuple[str, _JointTags]] = []
    around: list[_JointTags | None] = []  # every open element: the joint that it is, if it is one
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        joint, position = None, parser.CurrentByteIndex
        inside = around[-1] if around else None
        if tag == "joint":
            joint = _JointTags(position, parser.CurrentLineNumber, len(around))
            tags.append((attributes.get("name", ""), joint))
        elif tag == "origin" and inside and inside.origin is None:
            # The first counts where there are several, as in URDF readers.
            inside.origin = position
        elif tag.startswith("xacro:") and inside:
            inside.filled = True
        around.append(joint)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: around.pop()
    # With a default handler expat leaves entities alone: their text has no place in the file.
    parser.DefaultHandler = lambda _: None
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        line = getattr(error, "lineno", None)
        problem = f"text that cannot be edited in place ({error})"
        raise UrdfError(problem, "XML in UTF-8 or Latin-1", file=path, line=line) from None
    return tags


def _urdf_tags(path: Path, data: bytes) -> dict[str, _JointTags]:
    """The tags of every joint directly under the root, by its name."""
    by_name: dict[str, _JointTags] = {}
    for name, tags in _joint_tags(path, data):
        if tags.depth != 1:
            continue
        if name in by_name:
            problem = f"the joint name {quoted(name)} twice"
            raise UrdfError(problem, "one joint of that name", file=path, line=tags.line)
        by_name[name] = tags
    return by_name


def urdf_bytes(source: Path, data: bytes, origins: Mapping[str, Origin]) -> bytes:
    """A URDF byte for byte, with new numbers in the ``<origin>`` of the named joints.

    A number that keeps its value, to 1e-12, keeps its spelling; a new one is rounded to that. A
    joint without ``<origin>`` gets one. Relative mesh paths are copied as they stand. An origin is
    ``(xyz, rpy)``: (3,) m in the parent link's frame, and (3,) rad.

    Raises:
        UrdfError: the source cannot be edited, or has no joint of a name that was asked for.
        OutputError: a number is not finite.
    """
    tags = _urdf_tags(source, data)
    splices: list[_Splice] = []
    for name, origin in origins.items():
        if name not in tags:
            hint = suggestion(name, tags, "joints")
            raise UrdfError("no joint of this name", file=source, where=quoted(name), hint=hint)
        splices += _origin_splices(data, tags[name], name, origin)
    return _spliced(data, splices)


def xacro_bytes(
    source: Path, data: bytes, origins: Mapping[str, Origin]
) -> tuple[bytes, frozenset[str]]:
    """A xacro file byte for byte, with numbers in the ``<origin>`` of the joints that it makes.

    A joint stands at any depth, in a macro too; ``${prefix}`` in its name stands for any text.
    """
    splices, placed = list[_Splice](), dict[str, int]()
    for pattern, tags in _joint_tags(source, data):
        parts = [re.escape(part) for part in _EXPRESSION.split(pattern)]
        made = [name for name in origins if re.fullmatch(".*".join(parts), name, re.DOTALL)]
        if not made:
            continue
        problem, expected = "", "one joint of that name"
        if len(made) > 1:
            problem = f"a joint that could be both {quoted(made[0])} and {quoted(made[1])}"
            expected = "a separate joint for each"
        elif made[0] in placed:
            problem = (
                f"a joint that could be {quoted(made[0])}, as the one in line {placed[made[0]]}"
            )
        elif tags.filled and tags.origin is None:
            problem, expected = "an origin that a macro inserts", "its own <origin>"
        if problem:
            hint = "use the format xacro or xacro-yaml, which identify joints by their full names"
            where = f"joint {quoted(pattern)}"
            raise UrdfError(problem, expected, file=source, line=tags.line, where=where, hint=hint)
        placed[made[0]] = tags.line
        splices += _origin_splices(data, tags, made[0], origins[made[0]])
    return _spliced(data, splices), frozenset(placed)


def _spliced(data: bytes, splices: list[_Splice]) -> bytes:
    pieces, position = [], 0
    for start, stop, text in sorted(splices, key=lambda splice: splice[0]):
        pieces += [data[position:start], text]
        position = stop
    return b"".join([*pieces, data[position:]])


def write_urdf(source: str | Path, destination: str | Path, origins: Mapping[str, Origin]) -> None:
    """Write `urdf_bytes` of a source in one step to a destination, which may be the source.

    Raises:
        UrdfError, OutputError: as there, or the destination cannot be written.
    """
    made = urdf_bytes(Path(source), read_urdf_bytes(source), origins)
    write_bytes_atomically(destination, made)


def folded_origin(
    joint: ChainJoint, xyz: ArrayLike, rotation_vector: ArrayLike, offset: float
) -> tuple[FloatArray, FloatArray]:
    """The origin with which raw readings give what the calibrated joint gives with its offset.

    ``R = R(rpy_nominal) · exp(r) · Rot(axis, offset)`` for a joint that turns; for one that
    slides ``R = R(rpy_nominal) · exp(r)`` and ``xyz + R · axis · offset``. A fixed joint has no
    reading, and its offset is ignored. The calibrated position is in the parent link's frame, m;
    the rotation vector ``r``, nominal 0, in the joint's; the offset is in rad, or m.

    Returns:
        ``(xyz, rpy)``: (3,) m and (3,) rad. Where nothing turns, rpy is the nominal one exactly.
    """
    position = np.array(xyz, dtype=float)
    vector = np.asarray(rotation_vector, dtype=float)
    turn = joint.axis * (offset if joint.type in ("revolute", "continuous") else 0.0)
    nominal = rotation_from_rpy(joint.rpy) @ rotation_from_vector(vector)
    if joint.type == "prismatic":
        position = position + nominal @ joint.axis * offset
    if not vector.any() and not turn.any():
        return position, joint.rpy.copy()
    return position, rpy_from_rotation(nominal @ rotation_from_vector(turn))


def _finite(joint: str, numbers: ArrayLike) -> list[float]:
    values = [float(value) for value in np.asarray(numbers, dtype=float).reshape(3)]
    if not all(map(math.isfinite, values)):
        raise OutputError(f"joint {quoted(joint)}: the origin {values} is not finite; not written")
    return values


def _origin_splices(data: bytes, tags: _JointTags, joint: str, origin: Origin) -> Iterator[_Splice]:
    values = {
        key: _finite(joint, three) for key, three in zip((b"xyz", b"rpy"), origin, strict=True)
    }
    if tags.origin is None:
        if any(abs(number) > _ROUNDING for three in values.values() for number in three):
            yield _new_origin(data, tags.joint, values)
        return
    start, stop = _tag_span(data, tags.origin)
    written = {match[1]: match for match in _ATTRIBUTE.finditer(data, start, stop)}
    end_of_name = start + len(b"<origin")
    end = max((match.end() for match in written.values()), default=end_of_name)
    for key, numbers in values.items():
        if key in written:
            first, last = written[key].span(2)
            text = _numbers_text(numbers, data[first + 1 : last - 1])
            yield first + 1, last - 1, text
        elif any(abs(number) > _ROUNDING for number in numbers):
            yield end, end, b" " + _attribute_text(key, numbers)


def _new_origin(data: bytes, joint: int, values: Mapping[bytes, list[float]]) -> _Splice:
    """An origin on a line of its own where the joint's first child has one."""
    _, stop = _tag_span(data, joint)
    blank = re.compile(rb"\s*").match(data, stop)
    last_line = re.search(rb"\r?\n[ \t]*\Z", blank[0]) if blank else None
    attributes = b" ".join(_attribute_text(key, values[key]) for key in values)
    indentation = last_line[0] if last_line else b""
    return stop, stop, indentation + b"<origin " + attributes + b"/>"


def _tag_span(data: bytes, start: int) -> tuple[int, int]:
    match = _TAG.match(data, start)
    assert match is not None, "expat reported a start tag here"
    return match.span()


def _attribute_text(key: bytes, numbers: list[float]) -> bytes:
    return key + b'="' + _numbers_text(numbers, b"") + b'"'


def _numbers_text(numbers: list[float], old: bytes) -> bytes:
    """New text of an attribute, in which a number that did not change is spelled as before."""
    words = old.split()
    try:
        before = [float(word) for word in words]
    except ValueError:
        before = []
    if len(before) != len(numbers):
        return " ".join(map(number_text, numbers)).encode()
    same = [abs(was - new) <= _ROUNDING for was, new in zip(before, numbers, strict=True)]
    if all(same):
        return old
    compared = zip(words, same, numbers, strict=True)
    return b" ".join(
        word if is_same else number_text(new).encode() for word, is_same, new in compared
    )


def joint_text(
    name: str,
    motion: str,
    parent: str,
    child: str,
    pose: FloatArray,
    *,
    axis: str = "",
    limits: tuple[float, float] | None = None,
    number: Callable[[float], str] | None = None,
) -> str:
    """A ``<joint>`` of a URDF that is made here, with its origin (4, 4) in the parent link."""
    xyz, rpy = (
        " ".join(map(number or number_text, numbers))
        for numbers in (pose[:3, 3], rpy_from_rotation(pose[:3, :3]))
    )
    lines = [
        f"  <joint name={quoteattr(name)} type={quoteattr(motion)}>",
        f'    <origin xyz="{xyz}" rpy="{rpy}"/>',
        f"    <parent link={quoteattr(parent)}/>",
        f"    <child link={quoteattr(child)}/>",
    ]
    if axis:
        lines.append(f'    <axis xyz="{axis}"/>')
    if limits is not None:
        lower, upper = limits
        lines.append(f'    <limit lower="{lower!r}" upper="{upper!r}" effort="0" velocity="1"/>')
    return "\n".join([*lines, "  </joint>"])


def number_text(value: float) -> str:
    """A length or an angle as a description has it: to 1e-12 m or rad, beyond which is rounding."""
    return repr(rounded(value))


def rounded(value: float) -> float:
    """A length or an angle to 1e-12 m or rad, and never -0.0."""
    return round(float(value), _DECIMALS) + 0.0
