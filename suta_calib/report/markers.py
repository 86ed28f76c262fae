"""Markers that an arm measured: their places on the screen, in JSON, and as a board's file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.measurements.board import Marker, Markers, board_text
from suta_calib.report.document import File, Part
from suta_calib.report.listing import Column, Json, Listing


def _length(vector: FloatArray | None) -> float | None:
    return None if vector is None else float(np.linalg.norm(vector))


def _place(axis: int) -> Callable[[tuple[int, Marker]], float]:
    return lambda row: float(row[1].position[axis])


def _turn(axis: int) -> Callable[[tuple[int, Marker]], float]:
    # A tenth of a degree is shown; zero has no sign.
    return lambda row: round(float(rpy_from_rotation(row[1].rotation)[axis]), 12) + 0.0


# Each marker in the frame of its board; ± of position and turn are 3-D.
MARKERS: Final = Listing[tuple[int, Marker]](
    "Markers",
    Column("marker", "marker", lambda row: row[0]),
    *(Column(name, name, _place(k), "m") for k, name in enumerate("xyz")),
    Column("position_std", "±", lambda row: _length(row[1].position_std), "m", form=".2f"),
    *(Column(n, n, _turn(k), "rad", form=".1f") for k, n in enumerate(("roll", "pitch", "yaw"))),
    Column("rotation_std", "±", lambda row: _length(row[1].rotation_std), "rad", form=".2f"),
    Column("size", "size", lambda row: row[1].size, "m"),
    Column("size_std", "±", lambda row: row[1].size_std, "m", form=".2f"),
)


def marker_parts(board: Markers, label: str = "") -> Iterator[Part]:
    """The table of the markers, and ``board.yaml``, by its label where there are several."""
    still = [
        number
        for number, marker in board.markers.items()
        if marker.position_std is None or not marker.position_std.any()
    ]
    frame = f"marker {still[0]}" if len(still) == 1 else "the board"
    of = f" of board {label}" if label else ""
    yield MARKERS.of([*board.markers.items()], f"Markers{of} in the frame of {frame}, mm and °")
    name = f"board-{label}.yaml" if label else "board.yaml"
    yield File(name, partial(board_text, board))


def marker_records(board: Markers) -> Json:
    """The markers by number, as a board's file has them."""
    return {str(number): marker.row() for number, marker in board.markers.items()}
