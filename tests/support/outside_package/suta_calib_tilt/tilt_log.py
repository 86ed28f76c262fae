"""A reader: the log of a data logger, ``joint=deg …; roll=deg pitch=deg`` in each line."""

import re
from pathlib import Path
from typing import ClassVar

import numpy as np

from suta_calib.errors import ForeignFileError
from suta_calib.exchange import Imported, ImportedRows, Reader
from suta_calib.exchange.option import Given
from suta_calib.measurements import read_text


class TiltLog(Reader):
    """Joint readings and tilts in degrees become a samples CSV of the kind inclinometer."""

    name: ClassVar[str] = "tilt-log"
    summary: ClassVar[str] = "a tilt logger's text: joint readings, roll and pitch in degrees"
    example: ClassVar[str] = "run.tilt"
    suffixes: ClassVar[tuple[str, ...]] = (".tilt",)
    signature: ClassVar[re.Pattern[str]] = re.compile(r"\ATILTLOG")

    def read(self, path: Path, given: Given) -> Imported:
        """One row for each line after the first."""
        rows: list[dict[str, float]] = []
        for number, line in enumerate(read_text(path).splitlines()[1:], start=2):
            try:
                pairs = (cell.split("=") for cell in line.replace(";", " ").split())
                rows.append({name: np.radians(float(value)) for name, value in pairs})
            except ValueError:
                expected = "name=degrees, separated by spaces"
                raise ForeignFileError(repr(line), expected, file=path, line=number) from None
            if rows[-1].keys() != rows[0].keys():
                expected = f"the names of line 2: {', '.join(rows[0])}"
                raise ForeignFileError(repr(line), expected, file=path, line=number)
        columns = {name: np.array([row[name] for row in rows]) for name in (rows or [{}])[0]}
        return ImportedRows(source=path, form=self.name, columns=columns)
