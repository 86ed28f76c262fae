"""What a certification found."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from scipy.stats import norm, t

from suta_calib.arrays import FloatArray
from suta_calib.certification.comparison import DrawingComparison
from suta_calib.certification.damage import Fault
from suta_calib.certification.heading import Source
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.measurements import Artefact, Landmark

# The tip points down when seated.
DOWN: Final = np.pi


@dataclass(frozen=True, eq=False)
class CertifiedLandmark:
    """One landmark in the artefact's frame.

    Attributes:
        name: of the landmark.
        position: (3,) centre of the pillar's top, m; z is its height over the ground.
        std: (3,) standard deviation of each coordinate in the artefact's frame, m.
        shape_std: (3,) the same after best superposition: what distances suffer from, m.
        yaw: turn of the seated tip about z, rad; None where no flats were touched.
        yaw_std: its standard deviation, rad.
        tilt: of the top from the ground, rad.
        tilt_std: standard deviation of one component of it, rad.
        flatness: largest distance of a touch in use from the top's plane, m.
        symmetry: distance between the middles of the diagonals, m.
        diagonals: (2,) lengths 0-2 and 1-3, m.
        flats: distance between the flats, m; None without.
        touches: on the top, those in use.
        wrong_touches: lines of touches on the top that are not used.
    """

    name: str
    position: FloatArray
    std: FloatArray
    shape_std: FloatArray
    yaw: float | None
    yaw_std: float | None
    tilt: float
    tilt_std: float
    flatness: float
    symmetry: float
    diagonals: FloatArray
    flats: float | None
    touches: int
    wrong_touches: tuple[int, ...] = ()

    @property
    def sigma(self) -> float:
        """Standard deviation for a file that has one for all coordinates: the largest of them."""
        return float(self.std.max())

    @property
    def rotation(self) -> FloatArray | None:
        """(3, 3) of the seated tip: z down, x from the back flat to the front one."""
        return None if self.yaw is None else rotation_from_rpy([DOWN, 0.0, self.yaw])


@dataclass(frozen=True, eq=False)
class PlaneQuality:
    """How well touches make a plane.

    Attributes:
        count: touches in use.
        rms: scatter of a touch about the plane, m.
        flatness: of those in use from the lowest to the highest, m.
        tilt_std: standard deviation of its direction, rad: its largest component.
        wrong_touches: lines of touches that are not used.
    """

    count: int
    rms: float
    flatness: float
    tilt_std: float
    wrong_touches: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class SpacerLength:
    """Distance between a spacer's ends, m; ``nominal`` where the user gave it."""

    name: str
    length: float
    std: float
    nominal: float | None = None

    @property
    def deviation(self) -> float | None:
        """Measured less nominal, m."""
        return None if self.nominal is None else self.length - self.nominal


@dataclass(frozen=True, eq=False)
class Certification:
    """The artefact as it was measured.

    Attributes:
        path: the raw points.
        name: of the artefact.
        points: rows in the file.
        landmarks: in the file's order.
        covariance: (3 n, 3 n) of all coordinates in the artefact's frame, m².
        origin: landmark where x and y are zero.
        heading: what the x axis follows.
        turned: quarter turns from the side to x, where a drawing says so.
        heading_std: standard deviation of that direction against the origin, rad.
        ground, side: quality of these planes; no side where none was touched.
        noise: standard deviation of one touched coordinate, m.
        stated_noise: the one that was given, m.
        freedom: degrees of freedom of ``noise``; inf where it is the one that was given.
        spacers: their lengths.
        faults: why landmarks are called damaged.
        comparison: with a drawing, if there is one.
        tolerance: largest acceptable departure, m, if one was given.
    """

    path: Path
    name: str
    points: int
    landmarks: tuple[CertifiedLandmark, ...]
    covariance: FloatArray = field(repr=False)
    origin: str
    heading: Source
    turned: int
    heading_std: float
    ground: PlaneQuality
    side: PlaneQuality | None
    noise: float
    stated_noise: float | None
    freedom: float
    spacers: tuple[SpacerLength, ...]
    faults: tuple[Fault, ...]
    comparison: DrawingComparison | None
    tolerance: float | None

    @property
    def damaged(self) -> tuple[str, ...]:
        """Names of the landmarks with a fault, in order."""
        return tuple(dict.fromkeys(fault.landmark for fault in self.faults))

    @property
    def coverage_factor(self) -> float:
        """Standard deviations on either side that cover 95 %."""
        return float(norm.isf(0.025) if np.isinf(self.freedom) else t.isf(0.025, self.freedom))

    @cached_property
    def wrong_touches(self) -> tuple[int, ...]:
        """Lines of all touches that were not used."""
        lines = [*self.ground.wrong_touches, *(self.side.wrong_touches if self.side else ())]
        return tuple(sorted([*lines, *(w for m in self.landmarks for w in m.wrong_touches)]))

    def artefact(self) -> Artefact:
        """What a calibration reads: positions, seated rotations, one sigma for each landmark."""
        marks = {m.name: Landmark(m.name, m.position, m.rotation, m.sigma) for m in self.landmarks}
        return Artefact(self.name, marks)
