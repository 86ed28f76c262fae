"""What a depth camera saw: ``points.csv`` and ``planes.csv``, columns image, point, x, y, z."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import register_points
from suta_calib.measurements.csv_table import (
    SIGMAS,
    position_sigma_columns,
    position_sigmas,
    positions,
    read_csv_table,
)
from suta_calib.measurements.files import write_text


@dataclass(frozen=True, eq=False)
class SeenPoints(Displayable):
    """Which point was seen where by a depth camera, in which picture. Immutable.

    Attributes:
        image: (n,) the picture's name, or that of its cloud.
        point: (n,) name of the point: a board's number of its corner, or what a ball is called;
            of several points on a plane, that of the plane.
        position: (n, 3) in the camera, m: x to the right, y down, z ahead.
        sigma: (n, 3) standard deviation of each coordinate, m; None where nobody says it.
        path: the file it was read from, or None.
        lines: (n,) line of every row in it, from 1; empty without a file.
    """

    image: NDArray[np.str_]
    point: NDArray[np.str_]
    position: FloatArray
    sigma: FloatArray | None = None
    path: Path | None = None
    lines: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.image)

    def origin(self, row: int) -> str:
        """A row in a message: its line, or its picture and point."""
        if self.lines:
            return f"{self.path}:{self.lines[row]}"
        return f"image {self.image[row]}, point {self.point[row]}"


def read_seen_points(path: str | Path, column: str = "point", *, once: bool = True) -> SeenPoints:
    """Read ``points.csv``; x, y, z may be in mm (``x_mm``), and sigmas may stand beside them.

    Args:
        path: of the file.
        column: that names what was seen.
        once: whether nothing of one name is seen twice in a picture.

    Raises:
        SamplesError: unreadable, a column missing, a value that is none, or a point twice in one
            picture.
    """
    table = read_csv_table(Path(path))
    image = table.labels("image", "a column with the picture's name")
    point = table.labels(column, f"a column with the name of each {column}")
    stated = any(name in table.columns for name in position_sigma_columns())
    sigma = position_sigmas(table) if stated else None
    points = SeenPoints(image, point, positions(table), sigma, table.path, table.lines)
    first: dict[tuple[str, str], int] = {}
    for row, key in enumerate(zip(image.tolist(), point.tolist(), strict=True)):
        if once and key in first:
            raise SamplesError(
                f"the same point as in line {table.lines[first[key]]}",
                "each point only once per picture",
                file=points.path,
                line=table.lines[row],
                where=f"image {key[0]}, point {key[1]}",
                hint="if there are two balls or boards in one picture, give their points "
                "different names",
            )
        first[key] = row
    return points


def seen_points_text(points: SeenPoints, column: str = "point") -> str:
    """Content of ``points.csv``; lengths to 0.1 µm, far below what a depth camera sees."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    sigmas = () if points.sigma is None else SIGMAS
    writer.writerow(["image", column, "x", "y", "z", *sigmas])
    # No depth camera is better than that, however many points make a plane.
    least = 1e-6
    parts = () if points.sigma is None else (np.maximum(points.sigma, least),)
    numbers = np.hstack([points.position, *parts])
    for image, point, row in zip(points.image, points.point, numbers, strict=True):
        writer.writerow([image, point, *(f"{number:.7f}" for number in row)])
    return text.getvalue()


def write_seen_points(path: Path, points: SeenPoints, column: str = "point") -> None:
    """Write ``points.csv``: `seen_points_text`.

    Raises:
        OutputError: the file cannot be written; what was there is untouched.
    """
    write_text(path, seen_points_text(points, column))


def seen_size(pictures: Sequence[tuple[FloatArray, FloatArray]]) -> tuple[float, float] | None:
    """How many times as large as its file says a board is seen, and its standard deviation.

    From points (k, 3) on the board and in the camera, m, of each picture; None of no pictures. Of
    one picture alone the standard deviation is infinite.
    """
    sizes = []
    for on_board, in_camera in pictures:
        R, _ = register_points(on_board, in_camera)
        about = on_board - on_board.mean(axis=0)
        sizes.append(float(np.sum((about @ R.T) * in_camera) / np.sum(about**2)))
    if not sizes:
        return None
    spread = float(np.std(sizes, ddof=1)) if len(sizes) > 1 else np.inf
    return float(np.median(sizes)), spread / np.sqrt(len(sizes))


def unit_hint(times: float) -> str:
    """Which unit lengths are in that are so many times too large; empty for none that is known."""
    units = {
        1000.0: "mm, where m are expected",
        0.001: "m, where mm are expected",
        25.4: "mm, where inches are expected",
        1 / 25.4: "inches, where mm are expected",
    }
    # What is wrong with a scale beside its unit is a few per cent.
    return next((text for factor, text in units.items() if abs(times / factor - 1) < 0.1), "")
