"""Raw points of an artefact, as a laser tracker or a coordinate measuring machine wrote them.

One CSV file with the columns ``feature, landmark, index, x, y, z`` (m; ``x_mm, y_mm, z_mm``: mm).
Features are ``ground``, ``top``, ``hole``, ``flat``, ``side`` and ``spacer``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.arguments import checked
from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError, did_you_mean
from suta_calib.measurements import Artefact, CsvTable, positions, read_csv_table

FEATURES: Final = ("ground", "top", "hole", "flat", "side", "spacer")
HOLES: Final = 4
# What a plane takes; more touches are needed to judge it.
LEAST_ON_PLANE: Final = 3


@dataclass(frozen=True, eq=False)
class ProbedPoints:
    """Points (n, 3) of one feature in the instrument's frame, m, and their lines in the file."""

    position: FloatArray
    lines: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.lines)

    def lines_without(self, inliers: BoolArray) -> tuple[int, ...]:
        """Lines of the touches that are not used."""
        return tuple(line for line, used in zip(self.lines, inliers, strict=True) if not used)


@dataclass(frozen=True, eq=False)
class Pillar:
    """What was touched on one landmark."""

    name: str  # of the landmark
    top: ProbedPoints  # three touches or more on its top
    holes: ProbedPoints  # (4, 3), in order around the pillar, m
    # (3,) mean touch of each flat, m; None where the flats were not touched.
    front: FloatArray | None
    back: FloatArray | None
    flat_counts: tuple[int, int] = (1, 1)  # touches on front and back


@dataclass(frozen=True, eq=False)
class RawPoints(Displayable):
    """Everything in one file.

    Attributes:
        path: the file.
        ground: touches of the ground plane.
        pillars: in order of first appearance.
        side: touches of the side plane, or None.
        spacers: (2, 3) ends of each, m, by name.
        count: rows in the file.
    """

    path: Path
    ground: ProbedPoints
    pillars: tuple[Pillar, ...]
    side: ProbedPoints | None
    spacers: dict[str, FloatArray]
    count: int


@checked
def read_raw_points(path: str | Path) -> RawPoints:
    """Read and check a file of raw points.

    Raises:
        SamplesError: not a CSV file, a column or cell that cannot be used, an unknown feature, or
            touches that a landmark needs and does not have; names the line or the landmark.
    """
    path = Path(path)
    table = read_csv_table(path)
    rows = _PointRows(table)
    names = list(dict.fromkeys(rows.landmark[k] for k in rows.of("top", "hole", "flat")))
    ground, side = rows.of("ground"), rows.of("side")
    if len(ground) < LEAST_ON_PLANE:
        raise rows.missing(f"{len(ground)} touches of the ground", "at least 3, not on a line")
    if not names:
        raise rows.missing("no landmark", "touches of 'top' and 'hole' for every landmark")
    if len(side) == 1:
        raise rows.missing("1 touch of the side", "two or more along it, or none")
    pillars = tuple(_pillar(rows, name) for name in names)
    # No artefact that an arm can touch is larger or smaller (m): another unit was meant.
    largest_extent = 10.0
    smallest_extent = 2e-3
    # A typing error may be too large to be squared.
    with np.errstate(over="ignore"):
        extent = float(np.linalg.norm(np.ptp(rows.position, axis=0)))
    if not smallest_extent < extent < largest_extent:
        raise rows.missing(
            f"points within {extent:.4g} m",
            f"an artefact of {smallest_extent:g} to {largest_extent:g} m",
            hint="columns x,y,z are in metres and x_mm,y_mm,z_mm in millimetres: check the names "
            "of the columns",
        )
    return RawPoints(
        path=path,
        ground=rows.touches(ground),
        pillars=pillars,
        side=rows.touches(side) if side else None,
        spacers=dict(_spacers(rows)),
        count=len(table),
    )


class _PointRows:
    """The file's rows, checked cell by cell."""

    def __init__(self, table: CsvTable) -> None:
        self.table = table
        self.feature = [
            str(cell) for cell in table.labels("feature", "the kind of surface that was touched")
        ]
        for row, feature in enumerate(self.feature):
            if feature not in FEATURES:
                hint = did_you_mean(feature, FEATURES)
                raise table.refuse(
                    row, "feature", repr(feature), f"one of {', '.join(FEATURES)}", hint
                )
        self.landmark = list(table.cells("landmark", "the landmark's name"))
        for row in self.of("top", "hole", "flat"):
            if not self.landmark[row]:
                raise table.refuse(row, "landmark", "an empty cell", "the landmark's name")
        self.indices = table.cells("index", "the number of the touch")
        self.position = positions(table)

    def of(self, *features: str, landmark: str | None = None) -> list[int]:
        """Rows of these features, of one landmark if it is given."""
        return [
            row
            for row, feature in enumerate(self.feature)
            if feature in features and landmark in (None, self.landmark[row])
        ]

    def touches(self, rows: Iterable[int]) -> ProbedPoints:
        listed = list(rows)
        return ProbedPoints(self.position[listed], tuple(self.table.lines[row] for row in listed))

    def index(self, row: int, most: int) -> int:
        """The cell ``index`` as a whole number from 0 to ``most``."""
        cell = self.indices[row]
        if not cell.isascii() or not cell.isdecimal() or int(cell) > most:
            raise self.table.refuse(row, "index", repr(cell), f"a whole number from 0 to {most}")
        return int(cell)

    def missing(self, problem: str, expected: str, where: str = "", hint: str = "") -> SamplesError:
        return SamplesError(problem, expected, file=self.table.path, where=where, hint=hint)


def _pillar(rows: _PointRows, name: str) -> Pillar:
    where = f"landmark {name!r}"
    top = rows.touches(rows.of("top", landmark=name))
    if len(top) < LEAST_ON_PLANE:
        raise rows.missing(f"{len(top)} touches of its top", "five, or at least three", where)
    touched = rows.of("hole", landmark=name)
    holes = {rows.index(row, HOLES): row for row in touched}
    # Some count from one.
    if len(touched) != HOLES or len(holes) != HOLES or {0, HOLES} <= set(holes):
        listed = ", ".join(str(k) for k in sorted(holes)) or "none"
        raise rows.missing(
            f"{len(touched)} touches of its holes, with the indices {listed}",
            "four touches, with the indices 0 1 2 3 in order around the pillar",
            where,
        )
    sides: tuple[list[int], list[int]] = ([], [])
    for row in rows.of("flat", landmark=name):
        sides[rows.index(row, 1)].append(row)
    if bool(sides[0]) != bool(sides[1]):
        raise rows.missing(
            "touches of only one flat", "index 0 (front) and 1 (back), or no flats", where
        )
    front, back = (rows.position[s].mean(axis=0) if s else None for s in sides)
    in_order = rows.touches(holes[k] for k in sorted(holes))
    return Pillar(name, top, in_order, front, back, (len(sides[0]) or 1, len(sides[1]) or 1))


def _spacers(rows: _PointRows) -> Iterable[tuple[str, FloatArray]]:
    """Ends in pairs: by index where a spacer's indices differ, else as they follow in the file."""
    for name in dict.fromkeys(rows.landmark[row] for row in rows.of("spacer")):
        listed = rows.of("spacer", landmark=name)
        indices = [rows.indices[row] for row in listed]
        if len(set(indices)) == len(listed) and all(i.isdecimal() for i in indices):
            listed = [row for _, row in sorted(zip(map(int, indices), listed, strict=True))]
        called = name or "spacer"
        if len(listed) % 2:
            raise rows.missing(
                f"{len(listed)} ends",
                "an even number of ends",
                f"spacer {name!r}" if name else "spacer",
            )
        pairs = list(zip(listed[::2], listed[1::2], strict=True))
        for number, pair in enumerate(pairs, start=1):
            label = f"{called} {number}" if len(pairs) > 1 else called
            # Ends of a spacer that are one point (m).
            if np.ptp(rows.position[list(pair)], axis=0).max() < 1e-6:
                raise rows.missing(
                    "both ends at the same place", "two different ends", f"spacer {label!r}"
                )
            yield label, rows.position[list(pair)]


@dataclass(frozen=True, eq=False)
class CertificationOptions(Displayable):
    """How to certify.

    Attributes:
        name: of the artefact; the file's name by default.
        sigma: standard deviation of one touched coordinate, m; learnt from the touches without.
        origin: landmark where x and y are zero; ``O``, or the first, by default.
        probe_radius: of the ball whose centre the points are, m.
        front: direction of the front flat in the seated tip's x-y plane, rad from its x axis.
        drawing: to compare with.
        tolerance: largest acceptable departure, m.
        spacers: nominal lengths by name, m.
    """

    name: str = ""
    sigma: float | None = None
    origin: str = ""
    probe_radius: float = 0.0
    front: float = 0.0
    drawing: Artefact | None = None
    tolerance: float | None = None
    spacers: Mapping[str, float] = field(default_factory=dict)


# Everything learnt from the touches.
PLAIN: Final = CertificationOptions()
