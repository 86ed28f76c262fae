"""What a user may say about a certification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from suta_calib.measurements import Artefact


@dataclass(frozen=True, eq=False)
class CertificationOptions:
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
