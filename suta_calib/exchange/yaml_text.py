"""YAML that other programs read: plain mappings, every number with all its digits."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any


def yaml_bytes(data: Mapping[str, Any], comment: str = "") -> bytes:
    """A mapping as YAML in block style, short lists on one line.

    YAML 1.1, which ROS and PyYAML read, takes an exponent for a number only behind a dot: so they
    are written.

    Args:
        data: mappings, lists, texts, numbers and truth values.
        comment: above it, one line or several.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.representer import SafeRepresenter

    class Plain(SafeRepresenter):
        """Floats as YAML 1.1 reads them."""

    def number(representer: SafeRepresenter, value: float) -> Any:
        text = repr(value)
        text = text.replace("e", ".0e") if "e" in text and "." not in text else text
        return representer.represent_scalar("tag:yaml.org,2002:float", text)

    Plain.add_representer(float, number)
    writer = YAML(typ="safe", pure=True)
    writer.Representer = Plain
    writer.default_flow_style = None
    writer.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    # One line for each innermost mapping, however long.
    writer.width, writer.allow_unicode = 10_000, True
    stream = io.BytesIO()
    stream.write("".join(f"# {line}\n" for line in comment.splitlines()).encode())
    writer.dump(dict(data), stream)
    return stream.getvalue()
