"""YAML text as plain data, with the line of every key.

The node graph is read instead of constructed objects: nothing a file says is ever executed, a
key such as ``01`` or ``null`` keeps its text, and every scalar has a line to point at.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from suta_calib.errors import InputError

KeyPath = tuple[str | int, ...]
_SPECIAL_FLOATS = {".inf": "inf", "+.inf": "inf", "-.inf": "-inf", ".nan": "nan"}

# A file of this field has a few thousand values, of which aliases may make many more.
MOST_VALUES: Final = 200_000
MOST_BYTES: Final = 8_000_000
MOST_LEVELS: Final = 50


def plain_data(
    path: Path, text: str, error: type[InputError]
) -> tuple[dict[str, Any], dict[KeyPath, int]]:
    """What a YAML text says, whose top level is a mapping, and the line of every key, from 1.

    Args:
        path: of the file, for messages.
        text: of it.
        error: what is raised.

    Raises:
        InputError: as of `yaml_file.read_yaml`.
    """
    if len(text) > MOST_BYTES:
        found, expected = f"{len(text):,} characters", f"at most {MOST_BYTES:,}"
        raise error(found, expected, file=path, hint="long tables belong into a CSV file")
    try:
        # Comments, which the round-trip reader keeps, are not asked for.
        yaml = YAML(typ="safe", pure=True)
        yaml.composer.warn_double_anchors = False
        # OpenCV writes its own first line, with a colon, which no YAML reader takes.
        node: Node | None = yaml.compose(
            f"#{text}" if text.startswith(("%YAML:", "%YAML 1.0")) else text
        )
        if node is None:
            raise error("an empty file", "a mapping of keys to values", file=path)
        lines: dict[KeyPath, int] = {}
        data = _Plain(path, error, lines).value(node, (), ())
    except RecursionError:
        raise error("lists nested too deeply", "a few levels", file=path) from None
    except MarkedYAMLError as problem:
        mark = problem.problem_mark
        line = None if mark is None else mark.line + 1
        raise error(_not_yaml(problem.problem), "YAML", file=path, line=line) from None
    except YAMLError as problem:
        raise error(_not_yaml(problem), "YAML", file=path) from None
    if not isinstance(data, dict):
        raise error("no keys at the top level", "a mapping of keys to values", file=path, line=1)
    return data, lines


def _not_yaml(problem: object) -> str:
    lines = str(problem).splitlines()
    return f"text that is not YAML ({lines[0]})" if lines else "text that is not YAML"


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
        if len(self.lines) > MOST_VALUES:
            most = f"at most {MOST_VALUES:,} values, aliases counted as often as they are used"
            raise self._refuse("a file that says too much", most, node)
        if isinstance(node, MappingNode):
            return self._mapping(node, keys, (*inside, node))
        if isinstance(node, SequenceNode):
            items = enumerate(node.value)
            return [self.value(item, (*keys, i), (*inside, node)) for i, item in items]
        return self._scalar(node)

    def _mapping(self, node: MappingNode, keys: KeyPath, inside: tuple[Node, ...]) -> Any:
        mapping: dict[str, Any] = {}
        for key, value in node.value:
            if not isinstance(key, ScalarNode):
                raise self._refuse("a list or mapping as a key", "a word as a key", key)
            if key.value in mapping:
                raise self._refuse(f"the key {key.value!r} a second time", "each key once", key)
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

    def _refuse(self, found: str, expected: str, node: Node) -> InputError:
        return self.error(found, expected, file=self.path, line=node.start_mark.line + 1)
