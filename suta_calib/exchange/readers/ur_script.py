"""Universal Robots: joint positions and poses in URScript."""

from __future__ import annotations

import re
from typing import Final

from suta_calib.exchange.robot_program import NUMBER, ProgramReader

_SIX: Final = rf"\[((?:\s*{NUMBER}\s*,){{5}}\s*{NUMBER}\s*)\]"

_POSE: Final = rf"(?<!\w)p{_SIX}"


class UrScriptReader(ProgramReader):
    """``[q1, …, q6]`` in rad, and ``p[x, y, z, rx, ry, rz]`` in m with a rotation vector."""

    name = "ur-script"
    summary = "URScript: lists of six joint angles, or poses p[…]"
    example = "program.script --what joints --out samples.csv"
    signature = re.compile(rf"\bmove[jlcp]\(|{_POSE}", re.ASCII)
    suffixes = (".script", ".urscript", ".txt")
    joint_pattern = re.compile(rf"(?<![\w.]){_SIX}", re.ASCII)
    pose_pattern = re.compile(_POSE, re.ASCII)
    pose_form = "vector"
    metric = True
    comment = "#"
    opening = re.compile(r"(?:def|thread|sec|if|while|for)\b.*:$")
    closing = re.compile(r"end$")
    # A tool's frame and a payload's inertia have as many numbers as a position.
    settings = re.compile(r"\bset_\w+\s*\([^()]*\)")
