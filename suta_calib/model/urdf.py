"""Calibrated values back into the user's own URDF, and nothing else changed in it.

An XML library that reads and writes loses what it does not model: attribute order, quotes, line
ends, blank lines. So the file is not written from a tree. Expat tells at which bytes the start
tags stand, and the numbers are exchanged between the quotes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.parsers import expat

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
_OTHERWISE: Final = "the formats xacro and xacro-yaml tell joints apart by their whole names"
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
            raise UrdfError(
                f"the joint name {quoted(name)} a second time",
                "one joint of that name",
                file=path,
                line=tags.line,
            )
        by_name[name] = tags
    return by_name


def urdf_bytes(source: Path, data: bytes, origins: Mapping[str, Origin]) -> bytes:
    """A URDF byte for byte, with new numbers in the ``<origin>`` of the named joints.

    A number that keeps its value, to 1e-12, keeps its spelling; a new one is rounded to that. A
    joint without ``<origin>`` gets one. Relative mesh paths are copied as they stand.

    Args:
        source: the user's URDF, for messages.
        data: its bytes, in UTF-8, Latin-1 or another one-byte encoding it declares.
        origins: for each joint ``(xyz, rpy)``: (3,) m in the parent link's frame, and (3,) rad.

    Raises:
        UrdfError: the source cannot be edited, or has no joint of a name that was asked for.
        OutputError: a number is not finite.
    """
    tags = _urdf_tags(source, data)
    splices: list[_Splice] = []
    for name, (xyz, rpy) in origins.items():
        if name not in tags:
            hint = suggestion(name, tags, "joints")
            raise UrdfError("no joint of that name", file=source, where=quoted(name), hint=hint)
        values = {b"xyz": _finite(name, xyz), b"rpy": _finite(name, rpy)}
        splices += _origin_splices(data, tags[name], values)
    return _spliced(data, splices)


def xacro_bytes(
    source: Path, data: bytes, origins: Mapping[str, Origin]
) -> tuple[bytes, frozenset[str]]:
    """A xacro file byte for byte, with numbers in the ``<origin>`` of the joints that it makes.

    A joint stands at any depth, in a macro too; ``${prefix}`` in its name stands for any text.

    Args:
        source: the file, for messages.
        data: its bytes.
        origins: as for `urdf_bytes`.

    Returns:
        The new bytes, and which of the joints are in this file.

    Raises:
        UrdfError: a joint that may be several of these, or the other way round; or one whose
            origin a macro puts in.
        OutputError: a number is not finite.
    """
    splices, placed = list[_Splice](), dict[str, int]()
    for pattern, tags in _joint_tags(source, data):
        parts = [re.escape(part) for part in _EXPRESSION.split(pattern)]
        made = [name for name in origins if re.fullmatch(".*".join(parts), name, re.DOTALL)]
        if not made:
            continue
        where = f"joint {quoted(pattern)}"
        if len(made) > 1:
            raise UrdfError(
                f"what may be the joints {quoted(made[0])} and {quoted(made[1])}",
                "a joint of its own for each",
                file=source,
                line=tags.line,
                where=where,
                hint=_OTHERWISE,
            )
        (name,) = made
        if name in placed:
            problem = f"what may be {quoted(name)}, as line {placed[name]} may"
            expected = "one joint of that name"
            raise UrdfError(
                problem, expected, file=source, line=tags.line, where=where, hint=_OTHERWISE
            )
        placed[name] = tags.line
        if tags.filled and tags.origin is None:
            problem, expected = "an origin that a macro puts in", "an <origin> of its own"
            raise UrdfError(
                problem, expected, file=source, line=tags.line, where=where, hint=_OTHERWISE
            )
        xyz, rpy = origins[name]
        splices += _origin_splices(
            data, tags, {b"xyz": _finite(name, xyz), b"rpy": _finite(name, rpy)}
        )
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
    reading, and its offset is ignored.

    Args:
        joint: the nominal joint.
        xyz: (3,) calibrated position of the origin in the parent link's frame, m.
        rotation_vector: (3,) ``r``, rad, in the joint's frame; nominal 0.
        offset: added to the reading, rad (m for prismatic).

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


def _origin_splices(
    data: bytes, tags: _JointTags, values: Mapping[bytes, list[float]]
) -> Iterator[_Splice]:
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


def number_text(value: float) -> str:
    """A length or an angle as a description has it: to 1e-12 m or rad, beyond which is rounding."""
    return repr(rounded(value))


def rounded(value: float) -> float:
    """A length or an angle to 1e-12 m or rad, and never -0.0."""
    return round(float(value), _DECIMALS) + 0.0
