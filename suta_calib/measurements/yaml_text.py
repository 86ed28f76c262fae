"""Plain data as YAML text that every reader takes the same way, of YAML 1.1 or 1.2."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from suta_calib.measurements.yaml_nodes import add_rules

# Quotes a text that YAML 1.1 or YAML 1.2 would take for a number, a flag or nothing.
_DUMPER: Any = type("Dumper", (yaml.SafeDumper,), {})
add_rules(_DUMPER)


def yaml_text(data: Mapping[str, Any], comment: str = "", *, one_line: bool = False) -> str:
    """A mapping as YAML; a list or mapping below it that holds no mapping is on one line."""
    lines = "".join(f"# {line}\n" for line in comment.splitlines())
    node = _node(data, top=not one_line)
    # Long texts are not folded.
    text: str = yaml.serialize(node, Dumper=_DUMPER, width=1_000_000, allow_unicode=True)
    return lines + (text.strip() if one_line else text)


def _node(value: Any, *, top: bool = False) -> yaml.Node:
    if isinstance(value, Mapping):
        pairs = [(_node(key), _node(item)) for key, item in value.items()]
        block = top or any(isinstance(item, Mapping) for item in value.values())
        return yaml.MappingNode("tag:yaml.org,2002:map", pairs, flow_style=not block)
    if isinstance(value, (list, tuple)):
        block = any(isinstance(item, Mapping) for item in value)
        items = [_node(item) for item in value]
        return yaml.SequenceNode("tag:yaml.org,2002:seq", items, flow_style=not block)
    scalar: yaml.Node = yaml.representer.SafeRepresenter().represent_data(value)
    if isinstance(value, str) and not value.isprintable():
        scalar.style = '"'
    return scalar


def rounded(value: Any) -> Any:
    """The same with every float rounded to 1e-9, without negative zeros."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [rounded(item) for item in value]
    return round(float(value), 9) + 0.0 if isinstance(value, float) else value
