"""What could be measured next: places in the base frame, and the touches they stand for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from suta_calib.arrays import FloatArray

# Angle between the artefact's z axis and the vertical below which it stands flat, rad.
FLAT: Final = math.radians(1.0)


@dataclass(frozen=True, eq=False)
class Placement:
    """An artefact put down somewhere: ``T_base_artefact``.

    Attributes:
        name: of the placement, for the samples' column.
        position: (3,) of the artefact's origin in the base, m.
        rotation: (3, 3) of the artefact in the base.
        line: line of the candidates file it comes from.
    """

    name: str
    position: FloatArray
    rotation: FloatArray
    line: int | None = None
    kind: Literal["placement"] = "placement"

    @property
    def tilt(self) -> float:
        """Angle between the artefact's z axis and the base's, rad."""
        return float(np.arccos(np.clip(self.rotation[2, 2], -1.0, 1.0)))


@dataclass(frozen=True, eq=False)
class Point:
    """One point, or another place without an artefact, touched from many directions.

    Attributes:
        name: of the place, for the samples' column.
        position: (3,) in the base, m.
        directions: how many touches.
        axis: (3,) unit vector in the base, the middle of the tip's z axes.
        cone: largest angle between a tip's z axis and ``axis``, rad.
        line: line of the candidates file it comes from.
        kind: the sort of place, as its column is called; a plane is square to ``axis``.
    """

    name: str
    position: FloatArray
    directions: int
    axis: FloatArray
    cone: float
    line: int | None = None
    kind: str = "point"


@dataclass(frozen=True, eq=False)
class Posture:
    """One posture in which an instrument, or the camera on the tip, takes a reading.

    Attributes:
        name: what a person calls it.
        readings: (joints,) rad, m for prismatic joints.
        line: line of the candidates file it comes from.
    """

    name: str
    readings: FloatArray
    line: int | None = None
    kind: Literal["pose"] = "pose"


Place = Placement | Point | Posture


@dataclass(frozen=True, eq=False)
class Candidate:
    """A place the arm can reach.

    Attributes:
        place: where.
        q: (n, joints) a posture for each different touch, rad (m for prismatic joints).
        marks: (n,) the landmark of each touch; empty for points and postures.
        repeats: how often the touches are gone through.
    """

    place: Place
    q: FloatArray
    marks: tuple[str, ...]
    repeats: int

    @property
    def name(self) -> str:
        """Of the place."""
        return self.place.name

    @property
    def samples(self) -> int:
        """Rows it adds to the data."""
        return len(self.q) * self.repeats

    @property
    def sort(self) -> str:
        """What sort of candidate it is, for people."""
        if isinstance(self.place, Placement):
            tilt = self.place.tilt
            return "placement, flat" if tilt < FLAT else "placement, tilted"
        if isinstance(self.place, Point):
            return f"{self.place.kind} from many directions"
        return "pose"


@dataclass(frozen=True)
class Unreachable:
    """A place that is no candidate, and why."""

    name: str
    kind: str
    reason: str
