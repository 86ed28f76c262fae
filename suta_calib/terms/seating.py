"""How a plug sits in a socket that is larger than it: always turned and pushed to the same stop.

A plug with clearance, turned counter-clockwise until it stops, does not rest on the socket's axis:
it is turned about the tool's axis by a bias β and lies against the wall, (x, y) off the axis. If it
is always seated alike, both are the same every time and can be calibrated:

    T_artefact_tip = T_artefact_landmark · Trans(x, y, 0) · Rot_z(β)

in the frame that ``rotation_rpy_deg`` gives the seated tip. The shift turns with the landmarks'
flats: where all have the same orientation it cancels out of every distance, and only the prior
tells it. To the data it is the same as ``<tip>.x`` and ``<tip>.y`` (and β as ``<tip>.rz``), because
the tip is seated in the same way everywhere: where those are unknown too, the prior shares the sum
out, and their standard deviations say so. A fixed point touched without a socket tells them apart.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import ArtefactError, ParameterError
from suta_calib.measurements import Artefact
from suta_calib.model.parameters import Parameter
from suta_calib.terms.external_frame import labelled
from suta_calib.units import deg, mm

KEYS: Final = ("x", "y", "rz")
# What whoever touches must do at every socket, for the bias to be the same at all of them.
ALWAYS_ALIKE: Final = {
    "ccw": "turn the plug counter-clockwise until it stops",
    "cw": "turn the plug clockwise until it stops",
}
_OWNER: Final = "seating"


@dataclass(frozen=True)
class Seating:
    """What the socket leaves open, as priors.

    A stop lies anywhere on the circle of the clearance, so each coordinate has a standard
    deviation of ``clearance``/√2; a turn anywhere within ± ``rotation`` has one of ``rotation``/√3.
    Bounds are ± ``clearance`` for each coordinate and ± ``rotation``.

    Attributes:
        clearance: radius of the circle the plug's axis can move on, m; 0 for a plug that fits.
        rotation: largest turn the flats allow, rad; 0 for none.

    Raises:
        ParameterError: a negative size, or nothing left open.
    """

    clearance: float = 0.0
    rotation: float = 0.0

    def __post_init__(self) -> None:
        sizes = (self.clearance, self.rotation)
        if min(sizes) < 0 or not max(sizes) > 0 or not all(map(math.isfinite, sizes)):
            raise ParameterError(
                f"a clearance of {mm(self.clearance):g} mm and {deg(self.rotation):g} deg",
                "at least one of them positive, neither negative",
                where="seating",
            )

    def parameters(self, label: str) -> tuple[Parameter, ...]:
        """Its unknowns, ``seating[label].x|y|rz``, as far as open; no label for ``default``."""
        owner = labelled(_OWNER, label)
        c, r = self.clearance, self.rotation
        shift = [
            Parameter(owner, key, "m", 0.0, -c, c, prior=c / math.sqrt(2.0)) for key in KEYS[:2]
        ]
        turn = Parameter(owner, KEYS[2], "rad", 0.0, -r, r, prior=r / math.sqrt(3.0))
        return (*(shift if c else ()), *([turn] if r else ()))


def is_seating(parameter: Parameter) -> bool:
    """Whether an unknown says how a plug sits."""
    return parameter.owner.partition("[")[0] == _OWNER


def seat_axes(artefact: Artefact, names: Iterable[str]) -> FloatArray:
    """Directions (n, 3, 2), in the artefact, in which x and y shift a seated tip.

    Raises:
        ArtefactError: the artefact does not say how a landmark holds the tip.
    """
    axes = []
    for name in names:
        seat = artefact.landmarks[str(name)].rotation
        if seat is None:
            raise ArtefactError(
                f"no rotation_rpy_deg of landmark '{name}'",
                "the orientation of the seated tip, because the seating error turns with it",
                where="seating",
                hint=f"add it to the artefact '{artefact.name}', or leave out the key seating",
            )
        axes.append(seat[:, :2])
    return np.array(axes)


def seated_at(
    parameters: Iterable[Parameter], values: Mapping[str, float]
) -> tuple[FloatArray, float]:
    """Shift (2,), m, and turn, rad, of the seating among a term's unknowns; zero without one."""
    by_key = {p.key: values[p.name] for p in parameters if p.owner.startswith(_OWNER)}
    x, y, turn = (by_key.get(key, 0.0) for key in KEYS)
    return np.array([x, y]), turn
