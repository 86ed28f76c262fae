"""Fenced blocks of Markdown pages: what is shown there is run, or its options are looked up."""

from __future__ import annotations

import pkgutil
import re
import shlex
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

# Packages with public names; the command line is no library.
PACKAGES = sorted(
    module.name
    for parent in ("suta_calib", "suta_calib.analysis")
    for module in pkgutil.iter_modules(import_module(parent).__path__, f"{parent}.")
    if module.ispkg and module.name != "suta_calib.cli"
)
ROOT = Path(__file__).resolve().parents[2]
# What people read: the README, and the pages of the site that are written by hand.
PAGES = (
    ROOT / "README.md",
    *sorted(ROOT.glob("docs/*.md")),
    *sorted(ROOT.glob("docs/start/*.md")),
    *sorted(ROOT.glob("docs/tutorials/*.md")),
    *sorted(ROOT.glob("docs/guides/*.md")),
)


class Block(NamedTuple):
    """A fenced block of a page."""

    page: str
    language: str
    text: str

    @property
    def lines(self) -> list[str]:
        """Without continuations and indentation."""
        joined = re.sub(r" *\\\n *", " ", self.text)
        return [line.strip() for line in joined.splitlines()]

    @property
    def commands(self) -> list[str]:
        """The lines that call `suta-calib`."""
        return [line for line in self.lines if line.startswith("suta-calib ")]


def blocks_of(page: Path) -> list[Block]:
    """The fenced blocks of a page, in order."""
    found = re.findall(r"^```(\w*)\n(.*?)^```$", page.read_text(encoding="utf-8"), re.M | re.S)
    return [Block(page.relative_to(ROOT).as_posix(), *block) for block in found]


BLOCKS = [block for page in PAGES for block in blocks_of(page)]
SHELL = [block for block in BLOCKS if block.language in ("", "sh") and block.commands]


def words(line: str) -> list[str]:
    """A command line without the program's name, comments and shell syntax."""
    found = shlex.split(line, comments=True)[1:]
    return [word for word in found if word not in ("&", "&&")]
