"""SI inside; millimetres and degrees at files and on screen. Every conversion is made here.

A quantity's `Unit` is its SI unit. What a reader sees has another unit, a suffix for keys and
columns (``rms_mm``), and as many decimals as mean something.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal, TypeVar

from suta_calib.arrays import FloatArray

# rad/Nm is the unit of a joint's compliance, a turn per torque; kg that of what a joint carries;
# 1/K that of a thermal expansion; rad/s that of a drift; % that of a share, a number from 0 to 1
# that a reader sees in per cent.
Unit = Literal["m", "rad", "rad/Nm", "kg", "1/K", "m/s", "rad/s", "s", "px", "1", "%"]
Quantity = TypeVar("Quantity", float, FloatArray)
NOTHING: Final = "–"
# m; beyond it is no place, and the sums of squares of places must stay numbers.
FARTHEST: Final = 1e6
# Of drawings, °C (ISO 1:2022).
REFERENCE_TEMPERATURE: Final = 20.0


@dataclass(frozen=True)
class DisplayUnit:
    """How a quantity looks outside.

    Attributes:
        unit: as written behind a number.
        suffix: of a key or column that holds it; empty for none.
        per_si: numbers shown per SI unit.
        decimals: of a number shown.
    """

    unit: str
    suffix: str
    per_si: float
    decimals: int


SHOWN: Final[dict[Unit, DisplayUnit]] = {
    "m": DisplayUnit("mm", "_mm", 1e3, 3),
    "rad": DisplayUnit("deg", "_deg", 180.0 / math.pi, 4),
    "rad/Nm": DisplayUnit("deg/Nm", "_deg_per_nm", 180.0 / math.pi, 5),
    "kg": DisplayUnit("kg", "_kg", 1.0, 3),
    "1/K": DisplayUnit("ppm/K", "_ppm_per_k", 1e6, 2),
    "m/s": DisplayUnit("mm/h", "_mm_per_h", 3.6e6, 3),
    "rad/s": DisplayUnit("deg/h", "_deg_per_h", 3600.0 * 180.0 / math.pi, 4),
    "s": DisplayUnit("s", "_s", 1.0, 3),
    "px": DisplayUnit("px", "_px", 1.0, 3),
    "1": DisplayUnit("", "", 1.0, 6),
    "%": DisplayUnit("%", "_pct", 100.0, 1),
}


def mm(length: Quantity) -> Quantity:
    """Metres as millimetres."""
    return length * SHOWN["m"].per_si


def from_mm(length: Quantity) -> Quantity:
    """Millimetres as metres."""
    return length / SHOWN["m"].per_si


def deg(angle: Quantity) -> Quantity:
    """Radians as degrees."""
    return angle * SHOWN["rad"].per_si


def from_deg(angle: Quantity) -> Quantity:
    """Degrees as radians."""
    return angle / SHOWN["rad"].per_si


def um(length: Quantity) -> Quantity:
    """Metres as micrometres."""
    return length * 1e6


def from_um(length: Quantity) -> Quantity:
    """Micrometres as metres."""
    return length / 1e6


def ms(time: Quantity) -> Quantity:
    """Seconds as milliseconds."""
    return time * 1e3


def us(time: Quantity) -> Quantity:
    """Seconds as microseconds."""
    return time * 1e6


def from_us(time: Quantity) -> Quantity:
    """Microseconds as seconds."""
    return time / 1e6


def from_ms(time: Quantity) -> Quantity:
    """Milliseconds as seconds."""
    return time / 1e3


def shown(value: Quantity, unit: Unit) -> Quantity:
    """An SI value in the unit that a reader sees."""
    return value * SHOWN[unit].per_si


def thousandths(value: Quantity, unit: Unit) -> Quantity:
    """An SI value in thousandths of the unit that a reader sees: µm, or mdeg."""
    return 1e3 * shown(value, unit)


def stored(value: Quantity, unit: Unit) -> Quantity:
    """A value that a reader wrote, in SI."""
    return value / SHOWN[unit].per_si


def unit_name(unit: Unit) -> str:
    """The unit that a reader sees, such as mm or deg."""
    return SHOWN[unit].unit


def key(name: str, unit: Unit | None) -> str:
    """A key or column that holds the quantity as a reader sees it: ``rms_mm``."""
    return name if unit is None else name + SHOWN[unit].suffix


def text(
    value: float | None,
    unit: Unit,
    *,
    sign: bool = False,
    with_unit: bool = False,
    decimals: int | None = None,
) -> str:
    """An SI value as text in mm or degrees; a dash for None and for what is not a number."""
    if value is None or not math.isfinite(value):
        return NOTHING
    places = SHOWN[unit].decimals if decimals is None else decimals
    number = f"{shown(value, unit):{'+' if sign else ''}.{places}f}"
    # A rounded −0.000 would suggest a direction that is not there.
    if float(number) == 0:
        number = number.replace("-", "+" if sign else "").replace("+", "")
    return f"{number} {unit_name(unit)}".rstrip() if with_unit else number


def std_text(std: float | None, unit: Unit, *, with_unit: bool = True) -> str:
    """A standard deviation, SI, to two significant digits, in mm or degrees: ``0.020 deg``."""
    return text(std, unit, with_unit=with_unit, decimals=_decimals_of(std, unit))


def with_std(value: float, std: float, unit: Unit, *, sign: bool = False) -> str:
    """A value with its standard deviation, SI, both to the digits that mean something.

    The last digit of the value is that of the standard deviation: ``1.250 ± 0.020 deg``.
    """
    return f"{rounded_text(value, std, unit, sign=sign)} ± {std_text(std, unit)}"


def rounded_text(value: float, std: float, unit: Unit, *, sign: bool = False) -> str:
    """A value to the last digit of its standard deviation, both SI, without the unit."""
    return text(value, unit, sign=sign, decimals=_decimals_of(std, unit))


def _decimals_of(std: float | None, unit: Unit) -> int | None:
    """Of a number whose standard deviation is shown to two digits; None where that tells none."""
    if std is None or not math.isfinite(std) or not std > 0.0:
        return None
    # Rounded to two digits first: 0.0996 is 0.10. Smaller than a picometre is nothing.
    exponent = int(f"{shown(std, unit):.1e}".partition("e")[2])
    return min(max(1 - exponent, 0), 9)


def percent(before: float, after: float) -> str:
    """How much smaller ``after`` is than ``before``."""
    if not (math.isfinite(before) and math.isfinite(after)) or before <= 0:
        return NOTHING
    return f"{100 * (1 - after / before):.1f} %"
