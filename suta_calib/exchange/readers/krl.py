"""KUKA: positions in KRL, as they stand in .src and .dat files."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from suta_calib.exchange.robot_program import NUMBER, ProgramReader
from suta_calib.measurements.csv_table import number_in


def _named(names: str) -> str:
    """Numbers behind these names, with commas between them."""
    return r"\s*,\s*".join(rf"{name}\s+{NUMBER}" for name in names.split())


_AXES: Final = _named("A1 A2 A3 A4 A5 A6")
_FRAME: Final = _named("X Y Z A B C")
_EXTERNAL: Final = re.compile(rf"\b(E[1-6])\s+({NUMBER})", re.IGNORECASE)


class KrlReader(ProgramReader):
    """``{A1 …, A6 …}`` in degrees, and ``{X …, Y …, Z …, A …, B …, C …}`` in mm and degrees."""

    name = "krl"
    summary = "KUKA KRL (.src, .dat): axis positions {A1 …} or frames {X …}"
    example = "points.dat --what poses --out poses.csv"
    signature = re.compile(
        rf"^\s*(?:&ACCESS|DEFDAT|DEF )|(?i:\{{[^{{}}]*?(?:{_AXES}|{_FRAME}))", re.MULTILINE
    )
    suffixes = (".src", ".dat")
    joint_pattern = re.compile(rf"\{{[^{{}}]*?({_AXES})", re.IGNORECASE)
    pose_pattern = re.compile(rf"\{{[^{{}}]*?({_FRAME})", re.IGNORECASE)
    # A about Z, then B about the new Y, then C about the new X.
    pose_form = "ZYX"
    comment = ";"
    opening = re.compile(r"(GLOBAL\s+)?DEF(DAT|FCT)?\s", re.IGNORECASE)
    closing = re.compile(r"END(DAT|FCT)?$", re.IGNORECASE)
    # END may be that of ENDIF.
    last_word = re.compile(r"END(DAT|FCT)$", re.IGNORECASE)

    def external(self, position: str) -> Mapping[str, float]:
        """``E1 …`` to the position's end."""
        axes = _EXTERNAL.findall(position.partition("}")[0])
        return {name.upper(): number_in(number) for name, number in axes}
