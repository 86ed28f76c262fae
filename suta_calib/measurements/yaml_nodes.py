"""YAML text as plain data, with the line of every key.

The node graph is read instead of constructed objects: nothing a file says is ever executed, a
key such as ``01`` or ``null`` keeps its text, and every scalar has a line to point at.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from itertools import accumulate
from pathlib import Path
from typing import Any, Final

import yaml

from suta_calib.errors import InputError

KeyPath = tuple[str | int, ...]
Node = Any
_SPECIAL_FLOATS = {".inf": "inf", "+.inf": "inf", "-.inf": "-inf", ".nan": "nan"}

MOST_BYTES: Final = 8_000_000
MOST_LEVELS: Final = 50

# What is no text where it is not quoted, in YAML 1.2: PyYAML's own rules are those of YAML 1.1,
# where ``no`` is false and 1:30 a number.
_PLAIN: Final = {
    "bool": (r"true|True|TRUE|false|False|FALSE", "tTfF"),
    "int": (r"[-+]?0b[0-1_]+|[-+]?0o?[0-7_]+|[-+]?[0-9_]+|[-+]?0x[0-9a-fA-F_]+", "-+0123456789"),
    "float": (
        r"[-+]?(?:[0-9][0-9_]*)\.[0-9_]*(?:[eE][-+]?[0-9]+)?"
        r"|[-+]?(?:[0-9][0-9_]*)(?:[eE][-+]?[0-9]+)"
        r"|[-+]?\.[0-9_]+(?:[eE][-+][0-9]+)?"
        r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
        "-+0123456789.",
    ),
    "null": (r"~|null|Null|NULL|", ["~", "n", "N", ""]),
}


def plain_data(
    path: Path, text: str, error: type[InputError]
) -> tuple[dict[str, Any], dict[KeyPath, int]]:
    """What a YAML text says, whose top level is a mapping, and the line of every key, from 1."""
    if len(text) > MOST_BYTES:
        excess, expected = f"{len(text):,} characters", f"at most {MOST_BYTES:,}"
        raise error(excess, expected, file=path, hint="write long tables into a CSV file")
    # OpenCV writes its own first line, with a colon, which no YAML reader takes.
    text = f"#{text}" if text.startswith(("%YAML:", "%YAML 1.0")) else text
    lines: dict[KeyPath, int] = {}
    try:
        data = _Plain(path, error, lines).value(_graph(path, text, error), (), ())
    except RecursionError:
        raise error("lists nested too deeply", "a few levels", file=path) from None
    if not isinstance(data, dict):
        raise error("no keys at the top level", "a mapping of keys to values", file=path, line=1)
    return data, lines


def _graph(path: Path, text: str, error: type[InputError]) -> Node:
    """The graph, by libyaml where it is installed; or what is wrong, and where."""
    refused = yaml.YAMLError()
    # What libyaml refuses, the reader in Python refuses with better words.
    for base in (*([yaml.CSafeLoader] if yaml.__with_libyaml__ else []), yaml.SafeLoader):
        loader = _loader(base)
        try:
            # What composes the graph would end the process where lists are nested in thousands.
            events = (type(event).__name__ for event in yaml.parse(text, loader))
            ways = (name.endswith("StartEvent") - name.endswith("EndEvent") for name in events)
            if any(level > 10 * MOST_LEVELS for level in accumulate(ways)):
                raise RecursionError
            node = yaml.compose(text, loader)
        except yaml.YAMLError as problem:
            refused = problem
        else:
            if node is None:
                raise error("an empty file", "a mapping of keys to values", file=path)
            return node
    mark = getattr(refused, "problem_mark", None)
    words = str(getattr(refused, "problem", None) or refused).splitlines()
    found = f"text that is not YAML ({words[0]})" if words else "text that is not YAML"
    # PyYAML's words for it say nothing without their context.
    found = "an anchor that is defined twice" if words == ["second occurrence"] else found
    raise error(found, "YAML", file=path, line=None if mark is None else mark.line + 1) from None


@cache
def _loader(base: Any) -> Any:
    """A loader of PyYAML with `_PLAIN` in place of its own rules."""
    loader: Any = type("Loader", (base,), {"yaml_implicit_resolvers": {}})
    add_rules(loader)
    return loader


def add_rules(resolver: Any) -> None:
    """Have a loader or dumper of PyYAML tell values from texts by `_PLAIN`."""
    for kind, (form, first) in _PLAIN.items():
        rule = re.compile(rf"^(?:{form})$")
        resolver.add_implicit_resolver(f"tag:yaml.org,2002:{kind}", rule, list(first))


@dataclass(frozen=True)
class _Plain:
    """Turns YAML nodes into plain values and records their lines."""

    path: Path
    error: type[InputError]
    lines: dict[KeyPath, int]

    def value(self, node: Node, keys: KeyPath, inside: tuple[Node, ...]) -> Any:
        if keys:  # what is missing from the whole file is on no line of it
            self.lines.setdefault(keys, node.start_mark.line + 1)
        if any(node is outer for outer in inside):
            raise self._refuse("a reference to itself", "a value", node)
        if len(inside) > MOST_LEVELS:
            raise self._refuse("lists nested too deeply", f"at most {MOST_LEVELS} levels", node)
        # A file of this field has a few thousand values, of which aliases may make many more.
        most_values = 200_000
        if len(self.lines) > most_values:
            most = f"at most {most_values:,} values, with aliases counted as often as they are used"
            raise self._refuse("too many values", most, node)
        if node.id == "mapping":
            return self._mapping(node, keys, (*inside, node))
        if node.id == "sequence":
            items = enumerate(node.value)
            return [self.value(item, (*keys, i), (*inside, node)) for i, item in items]
        return self._scalar(node)

    def _mapping(self, node: Node, keys: KeyPath, inside: tuple[Node, ...]) -> Any:
        mapping: dict[str, Any] = {}
        for key, value in node.value:
            if key.id != "scalar":
                raise self._refuse("a list or mapping as a key", "a word as a key", key)
            if key.value in mapping:
                raise self._refuse(f"the key {key.value!r} twice", "each key only once", key)
            self.lines[(*keys, key.value)] = key.start_mark.line + 1
            mapping[key.value] = self.value(value, (*keys, key.value), inside)
        return mapping

    def _scalar(self, node: Node) -> Any:
        kind, text = str(node.tag).rpartition(":")[2], str(node.value)
        try:
            if kind == "int":
                return int(text.replace("_", ""))
            if kind == "float":
                return float(_SPECIAL_FLOATS.get(text.lower(), text.replace("_", "")))
        except ValueError:
            raise self._refuse(repr(text), "a decimal number", node) from None
        if kind == "bool":
            return text.lower() in ("true", "yes", "on", "y")
        return None if kind == "null" else text

    def _refuse(self, problem: str, expected: str, node: Node) -> InputError:
        return self.error(problem, expected, file=self.path, line=node.start_mark.line + 1)
