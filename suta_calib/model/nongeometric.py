"""Errors of an arm that are no geometry: eccentric encoders, and joints that yield to their load.

Both change how far a revolute joint turns for what its encoder reads:

    angle = q + offset + c1 cos q + s1 sin q + c2 cos 2q + s2 sin 2q + compliance · τ(q)

with q the reading and τ the torque of gravity about the joint's axis (`gravity`). An encoder disc
that sits off its axis, or a shaft that is bent, gives the first harmonic; a disc that is tilted or
oval the second (Mooring, Roth, Driels, Fundamentals of Manipulator Calibration, 1991, chapter 2).
A URDF has no place for them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final, Literal

from suta_calib.model.parameters import NONGEOMETRIC, Parameter

Family = Literal["ecc_1", "ecc_2", "compliance"]
FIRST: Final = ("ecc_c1", "ecc_s1")
SECOND: Final = ("ecc_c2", "ecc_s2")
COMPLIANCE: Final = "compliance"
KEYS: Final = (*FIRST, *SECOND, COMPLIANCE)
FAMILIES: Final[dict[Family, tuple[str, ...]]] = {
    "ecc_1": FIRST,
    "ecc_2": SECOND,
    "compliance": (COMPLIANCE,),
}
# A degree of eccentricity would be seen with the naked eye; so would 0.2° for each newton metre.
PLAUSIBLE_ECCENTRICITY: Final = math.radians(1.0)
PLAUSIBLE_COMPLIANCE: Final = math.radians(0.2)


def is_nongeometric(name: str) -> bool:
    """Whether a parameter of this name is an eccentricity or a compliance."""
    return name.rpartition(".")[2].startswith(NONGEOMETRIC)


def nongeometric_parameters(joints: Sequence[str]) -> Iterator[Parameter]:
    """What could be wrong with these revolute joints beside their geometry, all zero at nominal.

    Args:
        joints: names of revolute joints, base → tip.

    Yields:
        ``<joint>.ecc_c1|ecc_s1|ecc_c2|ecc_s2``, rad, and ``<joint>.compliance``, rad/(N·m).
    """
    for joint in joints:
        for key in (*FIRST, *SECOND):
            yield Parameter(f"{joint}.{key}", "rad", 0.0, plausible=PLAUSIBLE_ECCENTRICITY)
        yield Parameter(f"{joint}.{COMPLIANCE}", "rad/Nm", 0.0, plausible=PLAUSIBLE_COMPLIANCE)
