"""A URDF file as XML elements with line numbers, and the words of messages about them.

URDF readers know no namespaces and no entities, so neither means anything here.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from lxml import etree

from suta_calib.errors import UrdfError

# lxml ships without type information.
Element = Any

_XACRO_HINT: Final = "run xacro first: xacro FILE.xacro > FILE.urdf"
_LONGEST_QUOTE: Final = 60


def read_robot(path: Path) -> Element:
    """The ``<robot>`` element of a URDF file.

    Raises:
        UrdfError: the file cannot be read (`read_urdf_bytes`) or is not XML, its root is not a
            ``<robot>`` with a name, or xacro was not run.
    """
    root = _parse(path, read_urdf_bytes(path))
    if tag_of(root) != "robot":
        found = f"the root element <{tag_of(root)[:_LONGEST_QUOTE]}>"
        raise UrdfError(found, "<robot>", file=path, line=root.sourceline)
    for element in root.iter():
        if tag_of(element).startswith("xacro:"):
            found = f"<{tag_of(element)[:_LONGEST_QUOTE]}>, which xacro has not expanded"
            line = element.sourceline
            raise UrdfError(found, "plain URDF", file=path, line=line, hint=_XACRO_HINT)
    attribute(path, root, "name", "<robot>")
    return root


def read_urdf_bytes(path: str | Path) -> bytes:
    """The bytes of a URDF file, in an encoding that contains ASCII.

    Raises:
        UrdfError: the file is missing, unreadable, a directory, empty, or UTF-16 or UTF-32.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise UrdfError("no such file", "a URDF file", file=path) from None
    except IsADirectoryError:
        raise UrdfError("a directory", "a URDF file", file=path) from None
    except (OSError, ValueError) as error:
        raise UrdfError(f"an unreadable file ({error})", "a URDF file", file=path) from None
    if not data.strip():
        raise UrdfError("an empty file", "a URDF file", file=path)
    if b"\0" in data[:4] or data.startswith((b"\xff\xfe", b"\xfe\xff")):
        hint = "save it as UTF-8, as other URDF readers need it too"
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
        found = f"no {name}" if text is None else f"an empty {name}"
        expected = f'{name}="…"'
        raise UrdfError(found, expected, file=path, line=element.sourceline, where=where)
    return str(text)


def quoted(text: str) -> str:
    """Text from a file as part of a one-line message: quoted, escaped, not too long."""
    return repr(text if len(text) <= _LONGEST_QUOTE else text[: _LONGEST_QUOTE - 1] + "…")


def suggestion(name: str, known: Iterable[str], kind: str) -> str:
    """A hint for a name that is not there: what looks like it, and some of what there is."""
    names = list(known)
    close = " or ".join(map(quoted, difflib.get_close_matches(name, names, n=3)))
    shown = ", ".join(map(quoted, names[:8])) + (", …" if len(names) > 8 else "")
    listed = f"{kind} in the file: {shown or 'none'}"
    return f"did you mean {close}? {listed}" if close else listed


def _parse(path: Path, data: bytes) -> Element:
    try:
        return _parsed(data)
    except etree.XMLSyntaxError as error:
        found = f"text that is not XML ({' '.join(error.msg.split())})"
        line = error.lineno or None
        raise UrdfError(found, "a well-formed URDF file", file=path, line=line) from None


def _parsed(data: bytes) -> Element:
    """The root element; a prefix nobody declared is forgiven, nothing else is.

    Simulator tags often carry such prefixes, and URDF readers know no namespaces.
    """
    try:
        return etree.fromstring(data, _parser(recover=False))
    except etree.XMLSyntaxError as error:
        lenient = _parser(recover=True)
        root = etree.fromstring(data, lenient)
        if root is None or any(not e.type_name.startswith("NS_") for e in lenient.error_log):
            raise error from None
        return root


def _parser(*, recover: bool) -> Any:
    return etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False, recover=recover
    )
