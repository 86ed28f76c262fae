"""What napoleon takes wrongly of this package's docstrings, put right before it reads them."""

from __future__ import annotations

import re
from typing import Any

SEVERAL = re.compile(r"^( +)(\w+(?:, \w+)+)(: .*)$")


def prepared(_app: Any, what: str, _name: str, _of: Any, _options: Any, lines: list[str]) -> None:
    """Handle ``autodoc-process-docstring``, earlier than napoleon."""
    if what in ("property", "attribute", "data"):
        # Of "Exit code: 0, or 1", the first half would be a type. This line ends in nothing.
        lines.insert(0, "\\")
    lines[:] = one_name_each(lines)


def one_name_each(lines: list[str]) -> list[str]:
    """``lower, upper: text`` below *Attributes* as an entry each, as napoleon has for *Args*."""
    found: list[str] = []
    within, at = False, 0
    while at < len(lines):
        line = lines[at]
        if line and not line.startswith(" "):
            within = line == "Attributes:"
        several = SEVERAL.match(line) if within else None
        end = at + 1
        if several is None:
            found.append(line)
        else:
            indent, names, text = several.groups()
            while end < len(lines) and lines[end].startswith(indent + " "):
                end += 1
            for name in names.split(", "):
                found += [f"{indent}{name}{text}", *lines[at + 1 : end]]
        at = end
    return found
