"""ABB: positions in RAPID, robtargets and jointtargets."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from suta_calib.exchange.robot_program import NUMBER, ProgramReader
from suta_calib.measurements.csv_table import number_in


def _list(count: int) -> str:
    return rf"\[{_numbers(count)}\]"


def _numbers(count: int) -> str:
    return rf"(?:\s*{NUMBER}\s*,){{{count - 1}}}\s*{NUMBER}\s*"


# Behind the numbers that are read: the configuration of a robtarget, and the external axes.
_EXTERNAL: Final = re.compile(rf"\s*,\s*(?:{_list(4)}\s*,\s*)?\[({_numbers(6)})\]", re.ASCII)


class RapidReader(ProgramReader):
    """``[[x,y,z],[q1,q2,q3,q4],…]`` in mm, scalar first, and ``[[j1,…,j6],…]`` in degrees."""

    name = "rapid"
    summary = "ABB RAPID (.mod): robtargets or jointtargets"
    example = "Module1.mod --what joints --out samples.csv"
    signature = re.compile(r"\b(?:robtarget|jointtarget|MODULE)\b")
    suffixes = (".mod", ".modx", ".prg", ".sys")
    joint_pattern = re.compile(rf"\[\s*({_list(6)})\s*,\s*\[", re.ASCII)
    pose_pattern = re.compile(rf"\[\s*({_list(3)}\s*,\s*{_list(4)})\s*,\s*\[", re.ASCII)
    pose_form = "wxyz"
    comment = "!"
    opening = re.compile(r"MODULE\s", re.IGNORECASE)
    closing = re.compile(r"ENDMODULE$", re.IGNORECASE)

    def external(self, position: str) -> Mapping[str, float]:
        """The six numbers of the last list; a robtarget has its configuration before."""
        match = _EXTERNAL.match(position)
        numbers = [] if match is None else match[1].split(",")
        return {f"eax_{'abcdef'[k]}": number_in(number) for k, number in enumerate(numbers)}
