"""Numbers as people read them: millimetres and degrees, as many decimals as mean something."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from suta_calib.model.parameters import Unit

PER_SI: Final[dict[Unit, float]] = {
    "m": 1e3,
    "rad": 180.0 / math.pi,
    "rad/Nm": 180.0 / math.pi,
}
SHOWN_UNIT: Final[dict[Unit, str]] = {"m": "mm", "rad": "deg", "rad/Nm": "deg/Nm"}
DECIMALS: Final[dict[Unit, int]] = {"m": 3, "rad": 4, "rad/Nm": 5}
NOTHING: Final = "–"


def shown(value: float, unit: Unit) -> float:
    """An SI value in mm or degrees."""
    return value * PER_SI[unit]


def text(value: float | None, unit: Unit, *, sign: bool = False, with_unit: bool = False) -> str:
    """An SI value as text in mm or degrees; a dash for None and for what is not a number."""
    if value is None or not math.isfinite(value):
        return NOTHING
    number = f"{shown(value, unit):{'+' if sign else ''}.{DECIMALS[unit]}f}"
    # A rounded −0.000 would suggest a direction that is not there.
    if float(number) == 0:
        number = number.replace("-", "+" if sign else "").replace("+", "")
    return f"{number} {SHOWN_UNIT[unit]}" if with_unit else number


def percent(before: float, after: float) -> str:
    """How much smaller ``after`` is than ``before``."""
    if not (math.isfinite(before) and math.isfinite(after)) or before <= 0:
        return NOTHING
    return f"{100 * (1 - after / before):.1f} %"


def combination(direction: Mapping[str, float], held: str = "") -> str:
    """A combination of parameters as a sum: ``joint_2.y − joint_3.z``, the held one first."""
    parts = []
    ranked = sorted(direction.items(), key=lambda item: (item[0] != held, -abs(item[1])))
    for name, factor in ranked:
        size = abs(factor)
        times = "" if math.isclose(size, 1.0, rel_tol=5e-4) else f"{size:.3g}·"
        sign = "−" if factor < 0 else "+"
        parts.append(f"{sign} {times}{name}")
    return " ".join(parts).removeprefix("+ ")
