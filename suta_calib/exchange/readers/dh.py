"""Denavit-Hartenberg tables, classic or modified, as a URDF."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from suta_calib.exchange.cells import read_foreign_text
from suta_calib.exchange.imported import ImportedFile
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.truncated import COMPLETE, check_end_of_rows
from suta_calib.job.dh_file import read_dh_table

ROBOT: Final = Option("robot", "Name of the robot.", "NAME")


class DhReader(Reader):
    """A table with its header, as `job.dh_file` describes it."""

    name = "dh"
    summary = "Denavit-Hartenberg table (classic or modified) as CSV, to a URDF"
    example = "arm_dh.csv --format dh --robot arm --out arm.urdf"
    signature = re.compile(r"\A\s*(?=[^\r\n]*theta)(?=[^\r\n]*alpha)[^\r\n]*joint", re.IGNORECASE)
    options = (ROBOT, COMPLETE)

    def read(self, path: Path, given: Given) -> ImportedFile:
        """A URDF whose joints move about (along) z, with a link ``tip``."""
        check_end_of_rows(path, read_foreign_text(path), ",", given)
        table = read_dh_table(path)
        text = table.urdf(given.text(ROBOT, path.stem or "arm"))
        what = f"a URDF of {len(table.joints)} joints from a {table.convention} table"
        return ImportedFile(source=path, form=self.name, content=text, what=what, kind=".urdf")
