"""What a picture in space holds: lines, points and arrows, and nothing of how they are drawn.

An arm, its samples and a result each make a `Scene`; `plotting.spatial` draws it on axes, and the
report as something to turn about. Places are in the arm's base frame, m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.plotting.look import MOST_ARROWS, MOST_DRAWN, round_down

# What a part stands for: the arm's links, the axes of its joints, its tip, what was touched or
# seen, a frame or a point that stands outside, an error before and after a calibration; the floor,
# and the axes of the base.
Look = Literal["links", "axes", "tip", "touched", "place", "before", "after", "grid", "frame"]


@dataclass(frozen=True, eq=False)
class Line(Displayable):
    """A line from point to point, (n, 3) m."""

    name: str
    look: Look
    points: FloatArray


@dataclass(frozen=True, eq=False)
class PlacedPoints(Displayable):
    """Points (n, 3), m, each with a label or none."""

    name: str
    look: Look
    points: FloatArray
    labels: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Arrows(Displayable):
    """Vectors (n, 3), m, drawn from their points (n, 3), m, on, ``factor`` times as long."""

    name: str
    look: Look
    points: FloatArray
    vectors: FloatArray
    factor: float = 1.0

    @property
    def ends(self) -> FloatArray:
        """(n, 3) where they end in the picture, m."""
        return self.points + self.factor * self.vectors


Part = Line | PlacedPoints | Arrows


@dataclass(frozen=True, eq=False)
class Scene(Displayable):
    """Parts in the order in which they are drawn."""

    parts: tuple[Part, ...] = ()

    def __add__(self, other: Scene) -> Scene:
        """The parts of both."""
        return Scene((*self.parts, *other.parts))

    @property
    def extent(self) -> FloatArray:
        """(2, 3) least and greatest coordinates of what is drawn, m; NaN where nothing is."""
        drawn = [p.points for p in self.parts] + [
            p.ends for p in self.parts if isinstance(p, Arrows)
        ]
        places = np.concatenate([np.zeros((0, 3)), *drawn])
        if not len(places):
            return np.full((2, 3), np.nan)
        return np.array([np.nanmin(places, axis=0), np.nanmax(places, axis=0)])


class Posable(Protocol):
    """An arm, as far as a picture needs it."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that have a reading."""

    def forward(self, q: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Tip poses for readings."""

    def scene(self, q: ArrayLike | None = None) -> Scene:
        """The arm in one posture."""


def drawn_rows(count: int) -> slice:
    """Which of so many rows are drawn: all, or every so many."""
    return slice(None, None, max(1, -(-count // MOST_DRAWN)))


def largest_of_regions(places: FloatArray, sizes: FloatArray, most: int = MOST_ARROWS) -> IntArray:
    """Rows to draw of many arrows, so that each can be followed: the largest of every region.

    Regions are the cells of a grid, as many as leave no more than ``most`` arrows.

    Args:
        places: (n, 3) where arrows begin, m.
        sizes: (n,) how large each is.
        most: rows that are drawn.

    Returns:
        Row numbers in order; all where there are few.
    """
    if len(places) <= most:
        return np.arange(len(places))
    finest = 64
    low, across = places.min(axis=0), max(float(np.ptp(places, axis=0).max()), 1e-9)
    # The largest comes first: of every cell `unique` finds the first.
    order = np.argsort(-sizes, kind="stable")
    chosen = order[:1]
    for cells in range(1, finest):
        cell = np.floor((places[order] - low) / across * cells * (1.0 - 1e-9)).astype(int)
        _, first = np.unique(cell, axis=0, return_index=True)
        if len(first) > most:
            break
        chosen = order[first]
    return np.sort(chosen)


def magnification(vectors: FloatArray, size: float) -> float:
    """How many times arrows are drawn as long as they are, so that they are seen.

    It is 1, 2 or 5 times a power of ten.

    Args:
        vectors: (n, 3) m.
        size: of the scene, m.
    """
    lengths = np.linalg.norm(vectors, axis=1)
    # A few that are far off may leave the picture rather than flatten all others.
    long = float(np.percentile(lengths, 98)) if len(lengths) else 0.0
    # The longest arrow, as a part of the scene's size.
    longest = 0.25
    return round_down(longest * size / long) if long > 0 and size > 0 else 1.0
