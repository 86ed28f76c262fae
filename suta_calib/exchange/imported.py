"""A converted file of another program: rows of a samples or poses CSV, or another file."""

from __future__ import annotations

import csv
import io
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment, judged
from suta_calib.atomic import check_folder, exchange_files
from suta_calib.display import Displayable
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.option import Given, Option
from suta_calib.geometry.numbers import quaternion_from_rotation
from suta_calib.measurements.camera import Camera, camera_text
from suta_calib.measurements.csv_table import number_in, rotation_columns
from suta_calib.measurements.files import write_text
from suta_calib.measurements.pose_files import FAR, NEAR
from suta_calib.units import FARTHEST
from suta_calib.units import text as shown_text
from suta_calib.words import listed

FIRST_POINT: Final = "first"
ORIGIN: Final = Option(
    "origin",
    "Origin that is subtracted from all positions, for coordinates in a national grid: three "
    'numbers in m, or "first" for the first position.',
    "x,y,z|first",
)
GRID_HINT: Final = (
    f"if these are coordinates of a grid, give {ORIGIN.switch} first, or {ORIGIN.switch} x,y,z in m"
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Imported(Displayable, ABC):
    """A foreign file, read.

    Attributes:
        source: the file or folder it came from.
        form: name of the format it was read as.
        notes: what must be known of it, one sentence each.
        remarks: what was found in it and taken for granted, one sentence each.
    """

    source: Path
    form: str
    notes: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    suffix: ClassVar[str]

    @abstractmethod
    def text(self) -> str:
        """The whole content of the file that it became."""

    @property
    @abstractmethod
    def sentence(self) -> str:
        """Summary of the conversion, as a sentence."""

    @cached_property
    @judged
    def assessment(self) -> Assessment:
        """Care if there are notes to read; always usable."""
        return Assessment.of(self.sentence, care=self.notes, facts=self.remarks)

    def write(self, path: str | Path) -> None:
        """Write it, whole or not at all.

        Raises:
            OutputError: the file cannot be written.
        """
        write_text(Path(path), self.text())


@dataclass(frozen=True, eq=False, kw_only=True)
class ImportedRows(Imported):
    """Rows of a samples or poses CSV, in SI.

    Attributes:
        columns: numbers or labels by the name of their column, each (n,), n at least one.
        dropped: rows of the source in which something was not measured.
        pictures: files of those that the column ``image`` names.
        camera: that took them, where the source tells of it.
        lines: (n,) where each row stands in the source; None where that is not known.

    Raises:
        ForeignFileError: no rows are left.
    """

    columns: Mapping[str, NDArray[Any]]
    dropped: int = 0
    pictures: Mapping[str, bytes] = field(default_factory=dict)
    camera: Camera | None = None
    lines: tuple[int, ...] | None = None

    suffix: ClassVar[str] = ".csv"

    def __post_init__(self) -> None:
        if not len(self):
            problem = f"no complete row ({self.dropped} with missing values)"
            raise ForeignFileError(problem, "at least one complete row", file=self.source)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    @property
    def sentence(self) -> str:
        """How many rows, of what."""
        rows = "1 row" if len(self) == 1 else f"{len(self)} rows"
        dropped = f"; {self.dropped} incomplete ones left out" if self.dropped else ""
        return f"{rows}: {listed(list(self.columns), 24)}{dropped}"

    def write(self, path: str | Path) -> None:
        """Write it, its pictures into the folder ``…_images`` and the camera ``…_camera.yaml``.

        Raises:
            OutputError: a file cannot be written; then none is.
        """
        path = Path(path)
        folder, camera = self.beside(path)
        contents, stale = dict[str, bytes](), list[str]()
        if folder is not None:
            check_folder(path.parent)
            check_folder(folder)
            contents = {f"{folder.name}/{name}": data for name, data in self.pictures.items()}
            ours = re.compile(rf"{re.escape(self.source.stem)}_\d{{3,}}\.(png|jpg)")
            earlier = sorted(file.name for file in folder.iterdir()) if folder.is_dir() else ()
            stale = [f"{folder.name}/{name}" for name in earlier if ours.fullmatch(name)]
        if camera is not None and self.camera is not None:
            contents[camera.name] = camera_text(self.camera).encode()
        contents[path.name] = self.text().encode()
        exchange_files(path.parent, contents, [name for name in stale if name not in contents])

    def beside(self, path: Path) -> tuple[Path | None, Path | None]:
        """Where the pictures and the camera are written with it; None where there are none."""
        folder = path.with_name(f"{path.stem}_images") if self.pictures else None
        camera = path.with_name(f"{path.stem}_camera.yaml") if self.camera is not None else None
        return folder, camera

    def text(self) -> str:
        """As CSV; numbers have the digits that give them back exactly."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.columns)
        # Rows whose numbers are made into text at the same time.
        at_once = 10_000
        # Of a million rows the numbers as objects would be most of the memory.
        for begin in range(0, len(self), at_once):
            chunks = (values[begin : begin + at_once] for values in self.columns.values())
            if all(values.dtype.kind == "f" for values in self.columns.values()):
                cells = (map(repr, values.tolist()) for values in chunks)
                text.write("".join(f"{row}\n" for row in map(",".join, zip(*cells, strict=True))))
            else:
                writer.writerows(zip(*(values.tolist() for values in chunks), strict=True))
        return text.getvalue()


@dataclass(frozen=True, eq=False, kw_only=True)
class ImportedFile(Imported):
    """A file that is no table, such as a URDF: its content, what it is, and its suffix."""

    content: str
    what: str
    kind: str

    def text(self) -> str:
        """The content."""
        return self.content

    @property
    def sentence(self) -> str:
        """What it is."""
        return self.what


def pose_columns(
    position: FloatArray, rotation: FloatArray | None, prefix: str = ""
) -> dict[str, NDArray[Any]]:
    """Columns of a poses CSV: ``x, y, z`` (m) and, with rotations (n, 3, 3), ``qx, qy, qz, qw``."""
    columns = {prefix + axis: values for axis, values in zip("xyz", position.T, strict=True)}
    if rotation is not None:
        columns |= zip(rotation_columns(prefix), quaternion_from_rotation(rotation).T, strict=True)
    return columns


def origin_of(given: Given, position: FloatArray) -> FloatArray | None:
    """The origin (3,), m, that `ORIGIN` says, or None: the first whole row of (n, 3) may be it."""
    if ORIGIN not in given:
        return None
    finite = position[np.isfinite(position).all(axis=1)]
    if given.text(ORIGIN) == FIRST_POINT:
        return finite[0] if len(finite) else np.zeros(3)
    numbers = np.array([number_in(text) for text in given.texts(ORIGIN)])
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise given.refuse(ORIGIN, repr(given.text(ORIGIN)), "first, or three numbers x,y,z in m")
    return numbers


def from_origin(
    path: Path, lines: Sequence[int], position: FloatArray, given: Given
) -> tuple[FloatArray, tuple[str, ...]]:
    """Positions (n, 3), m, from the origin that the options say, and what was subtracted."""
    origin, remarks = origin_of(given, position), tuple[str, ...]()
    if origin is not None:
        position = position - origin
        numbers = ", ".join(map(repr, origin.tolist()))
        remarks = (f"The origin {numbers} m was subtracted from all positions.",)
    return checked_places(path, lines, position, GRID_HINT), remarks


def checked_places(
    path: Path, lines: Sequence[int], position: FloatArray, hint: str = ""
) -> FloatArray:
    """Positions (n, 3), m, none of which is farther than anything is; NaN stays."""
    for row in np.flatnonzero((np.abs(position) > FARTHEST).any(axis=1)):
        problem = f"a position {np.nanmax(np.abs(position[row])):.3g} m away"
        expected = f"one within {FARTHEST:g} m"
        raise ForeignFileError(problem, expected, file=path, line=lines[int(row)], hint=hint)
    return position


def distance_notes(position: FloatArray, unit: str) -> tuple[str, ...]:
    """A note if positions (n, 3), m, look like another unit."""
    distance = float(np.median(np.linalg.norm(position, axis=1))) if len(position) else 0.0
    if distance > FAR:
        return (
            f"Positions about {distance:.0f} m away, with {unit}: check whether they are "
            "millimetres.",
        )
    if 0.0 < distance < NEAR:
        shown = shown_text(distance, "m", with_unit=True)
        return (f"Positions about {shown} away, with {unit}: check whether they are metres.",)
    return ()
