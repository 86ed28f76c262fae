"""How far a parameter moved: what a picture of a solution is drawn from."""

from __future__ import annotations

from dataclasses import dataclass

from suta_calib.units import Unit


@dataclass(frozen=True)
class Change:
    """How far a parameter moved.

    Attributes:
        name: the parameter's.
        unit: its SI unit.
        change: from nominal, SI.
        std: its standard deviation, SI.
        by_prior: whether most of what is known of it was known before.
    """

    name: str
    unit: Unit
    change: float
    std: float
    by_prior: bool = False
