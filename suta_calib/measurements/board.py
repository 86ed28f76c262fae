"""A calibration board: numbered points whose places on it are known, and how they are found.

A board's frame has x to the right and y down as one looks at its face, z into it: as OpenCV and
AprilTag have it, so that a board which faces a camera that stands upright is not turned.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from numbers import Integral
from pathlib import Path
from typing import Any, ClassVar, Final, Self

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import BoardError
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.measurements.fields import (
    LENGTH,
    LENGTH_OR_0,
    ROTATION,
    TEXT,
    XYZ_DEG,
    XYZ_MM,
    Field,
    Fields,
    Value,
    fields_of,
    keyed,
    read_as,
)
from suta_calib.measurements.files import write_text
from suta_calib.measurements.scale import BODY_KEYS, LengthScale, read_stretch, scale_row
from suta_calib.measurements.yaml_file import YamlSection, read_yaml
from suta_calib.measurements.yaml_text import rounded, yaml_text
from suta_calib.units import deg, mm

# Most points of a board; no printed one comes near.
_MOST_POINTS: Final = 100_000
# Corners of one marker, in its size: top left, top right, bottom right, bottom left.
_MARKER_CORNERS: Final = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) / 2
# How many: of marker N they have the numbers 4 N, 4 N + 1, ….
CORNERS: Final = len(_MARKER_CORNERS)


@dataclass(frozen=True, eq=False)
class Board(Displayable, ABC):
    """Numbered points on a rigid body.

    Attributes:
        type: its name in files.
        scale: how well its common scale is known, where its file says so; see `length_scale`.
        stretch: as of an `Artefact`.
    """

    type: ClassVar[str]

    scale: LengthScale | None = field(default=None, kw_only=True)
    stretch: float | None = field(default=None, kw_only=True)

    @property
    def length_scale(self) -> LengthScale:
        """How well its common scale is known: as of a print, where nobody says so."""
        return LengthScale.of_grade("printed") if self.scale is None else self.scale

    @cached_property
    @abstractmethod
    def points(self) -> Mapping[int, FloatArray]:
        """Position (3,) in the board's frame, m, of every point by its number."""

    @abstractmethod
    def row(self) -> dict[str, Any]:
        """Keys and values of the file, in mm."""

    @abstractmethod
    def scaled(self, factor: float) -> Self:
        """A board whose every length is so many times as long."""

    def stretched(self, factors: ArrayLike) -> Self:
        """A board whose points' coordinates are times factors (3,) along its axes.

        Its squares are none any more: `row` and `scaled` are those of the board as it is drawn.
        """
        other = copy(self)
        along = np.asarray(factors, dtype=float)
        points = {number: point * along for number, point in self.points.items()}
        other.__dict__["points"] = points
        return other

    def positions(self, numbers: ArrayLike) -> FloatArray:
        """Positions (n, 3) in the board's frame, m, of points by number (n,).

        Raises:
            BoardError: a number that the board does not have.
        """
        listed = np.asarray(numbers, dtype=np.intp)
        for number in np.unique(listed):
            if int(number) not in self.points:
                raise BoardError(f"point {number}", self.numbering, where=f"board ({self.type})")
        return np.array([self.points[int(number)] for number in listed]).reshape(-1, 3)

    @property
    def flat(self) -> bool:
        """Whether all its points lie in one plane of the same z."""
        return len({float(point[2]) for point in self.points.values()}) == 1

    @property
    def into(self) -> float:
        """1 where z of its frame points into a flat board from its face, -1 where out of it."""
        return 1.0

    @property
    def numbering(self) -> str:
        """Which numbers its points have."""
        return f"a number from 0 to {max(self.points)}"

    @property
    def exchanged(self) -> Board | None:
        """A board with columns for rows and as many points; None where there is no other."""
        return None

    @property
    def recounted(self) -> Iterator[Chessboard]:
        """Boards of as many points, or a few more, in rows of other lengths: a file miscounted."""
        yield from ()

    def with_markers(self, factor: float) -> Board | None:
        """A board whose markers are so many times as large, at their places.

        None where nothing but the size of markers is known of it, or no size of markers is.
        """
        del factor
        return None

    @property
    def symmetric(self) -> bool:
        """Whether it looks the same after half a turn, so that no picture tells which way."""
        return False


@dataclass(frozen=True, eq=False)
class _SquaresBoard(Board):
    """Boards of squares: so many columns and rows, and the edge of a square, m."""

    # Columns and rows count so many squares around the numbered corners.
    rim: ClassVar[int] = 0

    columns: int
    rows: int
    square: float

    def __post_init__(self) -> None:
        where = f"board ({self.type})"
        counts = self.columns, self.rows
        if not all(isinstance(n, Integral) and n > self.rim for n in counts):
            expected = f"two whole numbers from {self.rim + 1} up"
            raise BoardError(f"{counts[0]} columns and {counts[1]} rows", expected, where=where)
        _check_size(self.square, "a square", where)

    @cached_property
    def points(self) -> Mapping[int, FloatArray]:
        """The inner corners along the rows, in the plane z = 0."""
        columns, rows = self.columns - self.rim, self.rows - self.rim
        row, column = np.divmod(np.arange(columns * rows), columns) + np.array(self.rim)
        places = np.column_stack([column, row, np.zeros(len(row))])
        return dict(enumerate(self.square * places))

    @property
    def exchanged(self) -> Board | None:
        """Columns for rows."""
        other = replace(self, columns=self.rows, rows=self.columns)
        return other if self.rows != self.columns else None


def _check_size(size: float, what: str, where: str) -> None:
    if not 0.0 < size < np.inf:
        raise BoardError(f"{what} of {mm(size):g} mm", "a size greater than 0", where=where)


@dataclass(frozen=True, eq=False)
class Chessboard(_SquaresBoard):
    """Where four squares meet; numbered from 0 along the rows, the first at the origin.

    Attributes:
        columns, rows: numbers of inner corners.
        square: edge of a square, m.
    """

    type: ClassVar[str] = "chessboard"

    def scaled(self, factor: float) -> Self:
        """Larger squares."""
        return replace(self, square=factor * self.square)

    def row(self) -> dict[str, Any]:
        """Type, corners and square."""
        counts = [self.columns, self.rows]
        return {"type": self.type, "corners": counts, "square_mm": mm(self.square)}

    @property
    def recounted(self) -> Iterator[Chessboard]:
        """Rows of two corners to twice as many as the file says."""
        for columns in range(2, 2 * self.columns + 1):
            if columns != self.columns:
                rows = -(-self.columns * self.rows // columns)
                yield replace(self, columns=columns, rows=rows)

    @property
    def symmetric(self) -> bool:
        """Half a turn brings black onto black where both numbers are even, or both odd."""
        return (self.columns + self.rows) % 2 == 0


@dataclass(frozen=True, eq=False)
class Charuco(_SquaresBoard):
    """A chessboard with a marker in every white square, which says which corner is which.

    The inner corners are numbered from 0 along the rows; the origin is the outer corner of the
    board, as in OpenCV from 4.6 on.

    Attributes:
        columns, rows: numbers of squares.
        square, marker: edges of a square and of a marker, m.
        dictionary: OpenCV's name of the markers' dictionary, such as ``DICT_5X5_1000``.
    """

    type: ClassVar[str] = "charuco"

    rim: ClassVar[int] = 1

    marker: float
    dictionary: str

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_size(self.marker, "a marker", f"board ({self.type})")
        if self.marker >= self.square:
            raise BoardError(
                f"a marker of {mm(self.marker):g} mm in a square of {mm(self.square):g} mm",
                "a marker smaller than its square",
                where="marker_mm",
            )

    def scaled(self, factor: float) -> Self:
        """Larger squares and markers."""
        return replace(self, square=factor * self.square, marker=factor * self.marker)

    def row(self) -> dict[str, Any]:
        """Type, squares, both edges and dictionary."""
        edges = {"square_mm": mm(self.square), "marker_mm": mm(self.marker)}
        counts = [self.columns, self.rows]
        return {"type": self.type, "squares": counts, **edges, "dictionary": self.dictionary}


@dataclass(frozen=True, eq=False)
class Marker(Displayable):
    """One ArUco marker or AprilTag.

    Attributes:
        position: (3,) of its middle in the board's frame, m; NaN where nobody measured it.
        size: edge of its black square, m; NaN where nobody measured it.
        rotation: (3, 3) of its own axes (right, down, in) in the board's frame.
        position_std, rotation_std, size_std: standard deviations of these, m and rad, where
            they were measured with an arm.
    """

    position: FloatArray = keyed(
        XYZ_MM,
        "Position of its centre. Without it, pictures from a camera on the arm, or of markers on "
        "it, determine where the marker is.",
        lambda: np.full(3, np.nan),
    )
    size: float = keyed(
        LENGTH, "Edge of the black square. Without it and position_mm it is estimated.", math.nan
    )
    rotation: FloatArray = keyed(ROTATION, "", lambda: np.eye(3))
    position_std: FloatArray | None = keyed(
        XYZ_MM, "Standard deviations of the position, as `hand-eye` writes them.", None
    )
    rotation_std: FloatArray | None = keyed(
        XYZ_DEG, "The same of the rotation, about the axes of the marker.", None
    )
    size_std: float | None = keyed(LENGTH_OR_0, "The same of the size.", None)

    def __post_init__(self) -> None:
        if not math.isnan(self.size):
            _check_size(self.size, "a marker", "marker")

    @property
    def placed(self) -> bool:
        """Whether its place is known."""
        return bool(np.isfinite(self.position).all())

    def row(self) -> dict[str, Any]:
        """Keys and values of a file, in mm and degrees."""
        row: dict[str, Any] = {}
        if self.placed:
            row["position_mm"] = mm(self.position).tolist()
            if not np.array_equal(self.rotation, np.eye(3)):
                row["rotation_rpy_deg"] = deg(rpy_from_rotation(self.rotation)).tolist()
        if not math.isnan(self.size):
            row["size_mm"] = mm(self.size)
        if self.position_std is not None:
            row["position_std_mm"] = mm(self.position_std).tolist()
        if self.rotation_std is not None:
            row["rotation_std_deg"] = deg(self.rotation_std).tolist()
        if self.size_std is not None:
            row["size_std_mm"] = mm(self.size_std)
        return row

    @property
    def corners(self) -> FloatArray:
        """(4, 3) top left, top right, bottom right, bottom left, in the board's frame, m."""
        return np.asarray(self.position + self.size * _MARKER_CORNERS @ self.rotation.T)


@dataclass(frozen=True, eq=False)
class Markers(Board):
    """Markers. Corner k of marker m, k from 0 as in `Marker.corners`, is 4 m + k.

    Corners of markers of unknown places are NaN.

    Attributes:
        dictionary: OpenCV's name of it, such as ``DICT_APRILTAG_36h11``.
        markers: by their number in the dictionary.
    """

    type: ClassVar[str] = "markers"

    dictionary: str
    markers: Mapping[int, Marker]

    def __post_init__(self) -> None:
        if not self.markers:
            raise BoardError("no markers", "at least one", where=f"board ({self.type})")

    @cached_property
    def points(self) -> Mapping[int, FloatArray]:
        """The corners of all markers."""
        return {
            CORNERS * number + k: corner
            for number, marker in self.markers.items()
            for k, corner in enumerate(marker.corners)
        }

    def scaled(self, factor: float) -> Self:
        """Larger markers, farther apart."""
        markers = {
            number: replace(m, position=factor * m.position, size=factor * m.size)
            for number, m in self.markers.items()
        }
        return replace(self, markers=markers)

    def with_markers(self, factor: float) -> Board | None:
        """Larger markers, no farther apart."""
        if len(self.markers) < 2:
            return None
        larger = {n: replace(m, size=factor * m.size) for n, m in self.markers.items()}
        return replace(self, markers=larger)

    def row(self) -> dict[str, Any]:
        """Type, dictionary, and a mapping of the markers."""
        listed = {number: marker.row() for number, marker in self.markers.items()}
        return {"type": self.type, "dictionary": self.dictionary, "markers": listed}

    @property
    def unplaced(self) -> tuple[int, ...]:
        """Numbers of the markers of unknown places."""
        return tuple(number for number, marker in self.markers.items() if not marker.placed)

    @property
    def into(self) -> float:
        """As its markers have it."""
        return -1.0 if all(m.rotation[2, 2] < 0.0 for m in self.markers.values()) else 1.0

    @property
    def numbering(self) -> str:
        """Four to a marker."""
        numbers = ", ".join(str(number) for number in self.markers)
        return f"4 m + k, corner k from 0 to 3 of a marker m that the board has: {numbers}"


def read_board(path: str | Path) -> Board:
    """Read ``board.yaml``.

    Raises:
        BoardError: unreadable, an unknown, missing or unusable key (with its line), another unit.
    """
    top = YamlSection(read_yaml(Path(path), BoardError), BoardError)
    kind = top.choice("type", BOARD_KEYS)
    values = BOARD_KEYS[kind].read(top)
    scale = values.get("scale")
    more: Any = {"scale": scale, "stretch": read_stretch(top, scale)}
    board: Board
    if kind == Markers.type:
        listed = top.section("markers")
        markers = dict(_marker(listed, key) for key in listed.data)
        board = Markers(values["dictionary"], markers, **more)
        if board.unplaced and board.stretch is not None:
            expected = "stretch: fixed, where places of markers are unknown"
            raise top.refuse("a stretch that is estimated", expected)
    elif kind == Chessboard.type:
        columns, rows = values["corners"]
        board = Chessboard(columns, rows, values["square"], **more)
    else:
        columns, rows = values["squares"]
        square, marker = values["square"], values["marker"]
        try:
            board = Charuco(columns, rows, square, marker, values["dictionary"], **more)
        except BoardError as problem:
            raise top.refuse(problem.found, problem.expected, at=(problem.where,)) from None
    # Sizes of a whole board, m, beyond which its file is in another unit than mm.
    smallest, largest = 2e-3, 30.0
    places = np.array(list(board.points.values()))
    finite = places[np.isfinite(places).all(axis=1)]
    sizes = [m.size for m in board.markers.values()] if isinstance(board, Markers) else []
    size = float(np.ptp(finite, axis=0).max()) if len(finite) else float(np.fmax.reduce(sizes))
    if not np.isnan(size) and not smallest <= size <= largest:
        raise top.refuse(
            f"a board of {mm(size):.3g} mm",
            f"{mm(smallest):g} mm to {largest:g} m",
            hint="lengths in this file are in mm; "
            + ("these look like metres" if size < smallest else "these look like µm"),
        )
    return board


def _marker(listed: YamlSection, key: str) -> tuple[int, Marker]:
    if not key.isdecimal() or str(int(key)) != key or int(key) > _MOST_POINTS:
        expected = "the number of the marker in its dictionary, from 0"
        raise listed.refuse(repr(key), expected, at=(key,))
    if listed.data[key] == {}:
        return int(key), Marker()
    section = listed.section(key)
    marker = read_as(Marker, section)
    if marker.placed and math.isnan(marker.size):
        expected = "size_mm too: only a marker whose place is unknown may have an unknown size"
        raise section.refuse("position_mm without size_mm", expected)
    if not marker.placed and "rotation_rpy_deg" in section:
        raise section.refuse("rotation_rpy_deg without position_mm", "both, or neither")
    return int(key), marker


def _counts(name: str, least: int, what: str) -> Field:
    """The key of numbers of columns and rows."""

    def read(top: YamlSection, key: str) -> tuple[int, int]:
        values = top.numbers(key, 2)
        columns, rows = (int(value) for value in values)
        if [columns, rows] != values or min(values) < least or columns * rows > _MOST_POINTS:
            both = f"{values[0]:g} and {values[1]:g}"
            expected = f"two whole numbers from {least} up: columns, rows"
            raise top.refuse(both, expected, at=(key,))
        return columns, rows

    return Field(name, Value("columns, rows", read), f"Numbers of {what}.", required=True)


_TYPE: Final = Field("type", TEXT, "Kind of board.", required=True)
_SQUARE: Final = Field("square_mm", LENGTH, "Edge of a square.", required=True)
_DICTIONARY: Final = Field(
    "dictionary",
    TEXT,
    "OpenCV's name of the markers' dictionary, such as DICT_5X5_1000 or DICT_APRILTAG_36h11.",
    required=True,
)
# The keys of a board's file, by its type.
BOARD_KEYS: Final = {
    Chessboard.type: Fields(_TYPE, _counts("corners", 2, "inner corners"), _SQUARE, *BODY_KEYS),
    Charuco.type: Fields(
        *(_TYPE, _counts("squares", 3, "squares"), _SQUARE),
        Field("marker_mm", LENGTH, "Edge of a marker, smaller than a square's.", required=True),
        *(_DICTIONARY, *BODY_KEYS),
    ),
    Markers.type: Fields(
        _TYPE,
        _DICTIONARY,
        Field(
            "markers",
            Value("by number", inside=fields_of(Marker)),
            "The markers by their number in the dictionary, each with the position of its centre "
            "on the board, or without it where nobody measured it (`{7: {size_mm: 80}, 8: {}}`). "
            "The axes of a marker point right, down and into the board. If y of "
            "these positions points up, give each marker `rotation_rpy_deg: [180, 0, 0]`.",
            required=True,
        ),
        *BODY_KEYS,
    ),
}


def board_text(board: Board) -> str:
    """Content of ``board.yaml``, millimetres to 1 pm."""
    return yaml_text(rounded(board.row() | scale_row(board.scale, board.stretch)))


def write_board(path: Path, board: Board) -> None:
    """Write ``board.yaml``: `board_text`.

    Raises:
        OutputError: the file cannot be written; what was there is untouched.
    """
    write_text(path, board_text(board))
