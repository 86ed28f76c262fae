"""What shall be simulated, as typed data in SI units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from suta_calib.arrays import FloatArray
from suta_calib.simulation.noise import NoiseLevels, OutlierSpec
from suta_calib.terms import KINDS, Term
from suta_calib.units import Unit

# How the keys of a file end that give a size in a unit.
SUFFIX: Final[dict[Unit, str]] = {"m": "mm", "rad": "deg", "rad/Nm": "deg_per_nm"}


@dataclass(frozen=True)
class ErrorRow:
    """True departure from nominal of the parameters that some names or globs select.

    Attributes:
        select: names, globs, or the word ``geometric``.
        value: by unit, the departure itself, m, rad or rad/(N·m).
        std: by unit, the standard deviation it is drawn with, likewise.
        line: line of the row in the file.
    """

    select: tuple[str, ...]
    value: dict[str, float]
    std: dict[str, float]
    line: int | None = None


@dataclass(frozen=True)
class PostureRow:
    """A joint's reading from which the search for a posture starts.

    Attributes:
        joint: its name.
        reading: rad, or m for a prismatic joint.
        unit: of the reading.
        line: line of the row in the file.
    """

    joint: str
    reading: float
    unit: Unit
    line: int | None = None

    @property
    def key(self) -> str:
        """Where the row stands in the file."""
        return f"posture_{'deg' if self.unit == 'rad' else 'mm'}.{self.joint}"


@dataclass(frozen=True, eq=False)
class PoseSpec:
    """A rigid transform: rotation (3, 3) and position (3,), m; ``line`` says where it stands."""

    rotation: FloatArray
    position: FloatArray
    line: int | None = None


@dataclass(frozen=True, eq=False)
class SetSpec:
    """One folder of simulated samples.

    Attributes:
        name: of the set and of its folder.
        kind: of observation, one of `terms.KINDS`.
        noise: how the measurements scatter.
        outliers: which share of them is grossly wrong.
        artefact: the artefact's file, for the kinds that touch one.
        places: by label, where what is touched stands in the base: the artefact, a point, ….
        repeats: how often each placement of an artefact is gone through.
        directions: how many directions every other place is touched from.
        axis: (3,) unit vector in the base, the middle of the tip's z axes; against the place's own
            z axis by default.
        cone: largest angle between a tip's z axis and ``axis``, rad.
        samples: number of samples of an external instrument or of a camera.
        frames: by key (such as ``base_in_instrument``), the frames of the kind that are stated.
        orientation: whether the instrument sees orientations too.
        settings: what the kind's own keys say, as it has read them.
        line: line of the set in the file.
        seating: (3,) how the tip always sits in its sockets: x and y off their axes, m, and the
            turn about the tool's axis, rad.
    """

    name: str
    kind: str
    noise: NoiseLevels = field(default_factory=NoiseLevels)
    outliers: OutlierSpec = field(default_factory=OutlierSpec)
    artefact: Path | None = None
    places: Mapping[str, PoseSpec] = field(default_factory=dict)
    repeats: int = 1
    directions: int = 20
    axis: FloatArray | None = None
    cone: float = math.pi / 3
    samples: int = 100
    frames: Mapping[str, PoseSpec] = field(default_factory=dict)
    orientation: bool = False
    settings: Mapping[str, Any] = field(default_factory=dict)
    line: int | None = None
    seating: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def term(self) -> type[Term]:
        """What its samples are observations of."""
        return KINDS[self.kind]

    @property
    def places_key(self) -> str:
        """The key under which the places that are touched stand in the file."""
        return f"{self.term.place}s"


@dataclass(frozen=True)
class SimulationSpec:
    """A whole ``simulation.yaml``.

    Attributes:
        path: the file.
        urdf, tip, base: the nominal arm and the ends of its chain; base None for the root link.
        seed: of every random number.
        posture: where the first search for a posture starts; joints that are not named start at
            the middle of their range.
        errors: how the true arm departs from the nominal one; later rows win.
        sets: what is measured.
    """

    path: Path
    urdf: Path
    tip: str
    base: str | None
    seed: int
    posture: tuple[PostureRow, ...]
    errors: tuple[ErrorRow, ...]
    sets: tuple[SetSpec, ...]
