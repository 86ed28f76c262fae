"""Universal Robots: joint positions and poses in URScript."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, Final

from suta_calib.arrays import FloatArray
from suta_calib.exchange.robot_program import NUMBER, ProgramReader
from suta_calib.exchange.rotations import rotations_from

_SIX: Final = rf"\[((?:\s*{NUMBER}\s*,){{5}}\s*{NUMBER}\s*)\]"


class UrScriptReader(ProgramReader):
    """``[q1, …, q6]`` in rad, and ``p[x, y, z, rx, ry, rz]`` in m with a rotation vector."""

    name: ClassVar[str] = "ur-script"
    summary: ClassVar[str] = "URScript: lists of six joint angles, or poses p[…]"
    example: ClassVar[str] = "program.script --what joints --out samples.csv"
    suffixes: ClassVar[tuple[str, ...]] = (".script", ".urscript", ".txt")
    joint_pattern: ClassVar[re.Pattern[str]] = re.compile(rf"(?<![\w.]){_SIX}", re.ASCII)
    pose_pattern: ClassVar[re.Pattern[str]] = re.compile(rf"(?<!\w)p{_SIX}", re.ASCII)
    comment: ClassVar[str] = "#"
    opening: ClassVar[re.Pattern[str]] = re.compile(r"(?:def|thread|sec|if|while|for)\b.*:$")
    closing: ClassVar[re.Pattern[str]] = re.compile(r"end$")
    # A tool's frame and a payload's inertia have as many numbers as a position.
    settings: ClassVar[re.Pattern[str] | None] = re.compile(r"\bset_\w+\s*\([^()]*\)")

    def recognises(self, path: Path, head: str) -> bool:
        """A motion, or a pose."""
        del path
        moves = re.search(r"\bmove[jlcp]\(", head) is not None
        return moves or self.pose_pattern.search(head) is not None

    def joints(self, numbers: FloatArray) -> FloatArray:
        """They are in rad."""
        return numbers

    def poses(
        self, numbers: FloatArray, path: Path, lines: Sequence[int]
    ) -> tuple[FloatArray, FloatArray]:
        """A position in m and a rotation vector."""
        return rotations_from("vector", numbers[:, 3:], path, lines), numbers[:, :3]
