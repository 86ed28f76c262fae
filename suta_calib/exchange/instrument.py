"""Files of instruments that follow bodies: rows of cells under a header of several lines."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.bodies import BODY_OPTIONS, Body, Recording
from suta_calib.exchange.cells import TableRow, numbers_of, read_foreign_text, rows_of_text
from suta_calib.exchange.cut_off import COMPLETE, check_end_of_rows
from suta_calib.exchange.imported import ImportedRows, checked_places
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.rotations import rotations_from
from suta_calib.units import from_mm

# m per unit, by what instruments call it.
LENGTH_UNITS: Final[dict[str, float]] = {
    **dict.fromkeys(("m", "meters", "metres", "meter", "metre"), 1.0),
    **dict.fromkeys(("cm", "centimeters", "centimetres"), from_mm(10.0)),
    **dict.fromkeys(("mm", "millimeters", "millimetres"), from_mm(1.0)),
}


class InstrumentReader(Reader):
    """A text file of an instrument: bodies and markers in columns, a frame in each row.

    Attributes:
        separator: between cells.
    """

    options: ClassVar[tuple[Option, ...]] = (*BODY_OPTIONS, COMPLETE)
    separator: ClassVar[str] = ","

    def read(self, path: Path, given: Given) -> ImportedRows:
        """The pose of the body that is asked for, in m; frames without it are left out."""
        text = read_foreign_text(path)
        separator = self.separator_of(text)
        check_end_of_rows(path, text, separator, given)
        rows = rows_of_text(path, text, separator)
        if not rows:
            raise self.strange(path, "nothing but comments", "frames")
        return self.recording(path, rows, given).imported(self.name, given)

    def separator_of(self, text: str) -> str:
        """What stands between the cells of a text."""
        del text
        return self.separator

    @abstractmethod
    def recording(self, path: Path, rows: Sequence[TableRow], given: Given) -> Recording:
        """Everything the file holds.

        Raises:
            ForeignFileError: it is not of this format, or holds no body and no marker.
        """

    def strange(
        self, path: Path, problem: str, expected: str, line: int | None = None
    ) -> Exception:
        """Error that a file is not what it seems, to be raised by the caller."""
        return ForeignFileError(
            problem,
            expected,
            file=path,
            line=line,
            hint=f"is it {self.summary}? another --format, or table, may fit",
        )


def body_of(
    path: Path,
    rows: Sequence[TableRow],
    position: Sequence[int],
    rotation: Sequence[int],
    form: str,
    scale: float,
    angle: float = 1.0,
) -> Body:
    """A body in some columns.

    Args:
        path: for messages.
        rows: the data.
        position: three columns.
        rotation: as many as the form has numbers; none for a marker.
        form: of the rotation (`rotations.NUMBERS`).
        scale: m per unit of the position.
        angle: rad per unit of the rotation's numbers, where they are angles.

    Raises:
        ForeignFileError: a cell that is no number, or numbers that are no rotation.
    """
    lines = [row.line for row in rows]
    places = checked_places(path, lines, scale * numbers_of(path, rows, position))
    if not rotation:
        return Body(places)
    return Body(places, rotations_from(form, angle * numbers_of(path, rows, rotation), path, lines))


def column_of_time(path: Path, rows: Sequence[TableRow], column: int | None) -> FloatArray | None:
    """(n,) s in a column, or None where there is none or a time is missing."""
    if column is None:
        return None
    time = numbers_of(path, rows, [column])[:, 0]
    return time if np.isfinite(time).all() else None
