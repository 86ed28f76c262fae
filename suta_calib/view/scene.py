"""What is to be seen, in no library's words: numbers, names and colours.

Everything is in the base's frame, in m and rad; what has a ``carrier`` is in the frame of that link
of the calibrated arm and moves with it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.assessment import Assessment
from suta_calib.display import Displayable
from suta_calib.view.drawn_arm import DrawnArm

# Red, green and blue, 0 to 255.
Colour = tuple[int, int, int]
# Of errors larger than chance makes them.
OUTLYING: Final[Colour] = (200, 20, 0)


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Places.

    Attributes:
        name: of this thing in the scene, its groups before it: ``artefacts/P1``.
        position: (n, 3), m.
        colour: of all of them.
        size: radius, m.
        labels: of each, written beside it; or empty.
        carrier: the link they are on; empty for the base.
    """

    name: str
    position: FloatArray
    colour: Colour
    size: float
    labels: tuple[str, ...] = ()
    carrier: str = ""


@dataclass(frozen=True, eq=False)
class ErrorVectors:
    """Vectors that are drawn many times longer than they are: by the scene's `magnification`.

    Attributes:
        name: likewise.
        at: (n, 3) where they begin, m.
        vector: (n, 3) as they are, m.
        colours: (n, 3), 0 to 255.
        count: of all that there are, of which these are the largest of each region; 0 where these
            are all.
    """

    name: str
    at: FloatArray
    vector: FloatArray
    colours: IntArray
    count: int = 0

    def ends(self, factor: float) -> FloatArray:
        """(n, 2, 3) begin and end of every arrow, ``factor`` times as long as the vector, m."""
        return np.stack([self.at, self.at + factor * self.vector], axis=1)


@dataclass(frozen=True, eq=False)
class Ellipsoids:
    """Standard uncertainties of points, drawn many times larger: by the scene's `inflation`.

    Attributes:
        name: likewise.
        at: (n, 3) their centres, m.
        turn: (n, 3, 3) rotations whose columns are the axes.
        std: (n, 3) standard uncertainty along each axis, m.
        colour: of all of them.
    """

    name: str
    at: FloatArray
    turn: FloatArray
    std: FloatArray
    colour: Colour

    @classmethod
    def of(cls, name: str, at: FloatArray, covariance: FloatArray, colour: Colour) -> Ellipsoids:
        """Of covariances (n, 3, 3), m²: one standard deviation along the principal axes."""
        variance, turn = np.linalg.eigh(covariance)
        turn[:, :, 2] *= np.sign(np.linalg.det(turn))[:, None]  # A rotation, no reflection.
        return cls(name, at, turn, np.sqrt(np.maximum(variance, 0.0)), colour)


@dataclass(frozen=True, eq=False)
class Frame:
    """Axes with a name.

    Attributes:
        name: likewise; its last part is written beside it.
        rotation, position: (3, 3) and (3,), m.
        size: length of an axis, m.
        carrier: the link it is on; empty for the base.
    """

    name: str
    rotation: FloatArray
    position: FloatArray
    size: float
    carrier: str = ""


@dataclass(frozen=True, eq=False)
class Frustum(Frame):
    """A camera's frame, z ahead and y down, and what it sees.

    Attributes:
        field_of_view: from top to bottom, rad.
        aspect: width over height.
    """

    field_of_view: float = 0.8
    aspect: float = 4.0 / 3.0


@dataclass(frozen=True, eq=False)
class Patch:
    """A flat rectangle: corners (4, 3) in order around it, m; on a link if it has a carrier."""

    name: str
    corners: FloatArray
    colour: Colour
    carrier: str = ""


@dataclass(frozen=True, eq=False)
class Stroke:
    """A straight line between two ends (2, 3), m."""

    name: str
    ends: FloatArray
    colour: Colour


Thing = PointCloud | ErrorVectors | Ellipsoids | Frame | Patch | Stroke


@dataclass(frozen=True, eq=False)
class SampleRows:
    """Samples that the arm can be shown at.

    Attributes:
        names: (n,) where each came from, and its labels.
        q: (n, joints) readings, rad or m.
        at: (n, 3) where its error begins, m.
        outlying: (n,) as `ErrorVectors` mark them.
    """

    names: tuple[str, ...]
    q: FloatArray
    at: FloatArray
    outlying: BoolArray

    def __len__(self) -> int:
        return len(self.names)

    def along(self, origin: FloatArray, direction: FloatArray, within: float) -> int | None:
        """The sample nearest to a ray along a unit vector; None if none is ``within``, m."""
        off = np.linalg.norm(np.cross(self.at - origin, direction), axis=1)
        nearest = int(np.argmin(off))
        return nearest if off[nearest] <= within else None


@dataclass(frozen=True, eq=False)
class ArmScene(Displayable):
    """All of it.

    Attributes:
        title: what it is.
        arms: first the one that things are carried by.
        q: (joints,) readings that the arms are shown at first, rad or m.
        things: what else is there.
        rows: samples to be shown at.
        magnification: of arrows, until somebody chooses another.
        inflation: of ellipsoids, likewise.
        assessment: whether what is seen may be used; None where nothing was computed.
        summary: a sentence or two on it.
    """

    title: str
    arms: tuple[DrawnArm, ...]
    q: FloatArray
    things: tuple[Thing, ...] = ()
    rows: SampleRows = field(
        default_factory=lambda: SampleRows(
            (), np.zeros((0, 0)), np.zeros((0, 3)), np.zeros(0, np.bool_)
        )
    )
    magnification: float = 1.0
    inflation: float = 1.0
    assessment: Assessment | None = None
    summary: str = ""

    @property
    def extent(self) -> FloatArray:
        """(2, 3) corners of the box about the arm as it is shown first and all points, m."""
        _, links = self.arms[0].poses(self.q)
        points = [links, *(t.position for t in self.things if isinstance(t, PointCloud))]
        every = np.vstack([*points, self.rows.at])
        return np.array([every.min(axis=0), every.max(axis=0)])
