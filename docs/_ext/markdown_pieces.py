"""Pieces of Markdown, and of docstrings."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable


def table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A Markdown table."""
    heads = tuple(heads)
    lines = [heads, ["---"] * len(heads), *rows]
    return "".join(f"| {' | '.join(map(cell, line))} |\n" for line in lines) + "\n"


def cell(text: str) -> str:
    """Text inside a table."""
    return text.replace("|", "\\|").replace("\n", " ")


def anchor(name: str) -> str:
    """The target of a heading."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower())


def sentence(text: str) -> str:
    """With a capital and a full stop."""
    return f"{text[0].upper()}{text[1:].rstrip('.')}."


def first_paragraph(thing: object) -> str:
    """The first paragraph of a docstring."""
    return " ".join((inspect.getdoc(thing) or "").split("\n\n")[0].split())


def first_code(thing: object) -> str:
    """The first indented block of a docstring."""
    (block,) = re.findall(r"::\n\n((?:    .*\n)+)", inspect.getdoc(thing) or "")[:1]
    return inspect.cleandoc(block) + "\n"
