"""The tables of repeatability and of stationary streams: once, for a terminal and for a page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from suta_calib.analysis.repeatability import (
    Change,
    Interval,
    JointNoise,
    PositionScatter,
    Repeatability,
    Stationary,
)
from suta_calib.report.repeatability.json import SECONDS_PER_HOUR
from suta_calib.report.sections import Table
from suta_calib.units import NOTHING, Unit, shown, text, unit_name

# Encoders are finer than the decimals of a pose.
_DIGITS: Final = 3


def repeatability_tables(found: Repeatability) -> list[Table]:
    """Everything that was found, largest first."""
    tables = [_position(found), _joints(found)]
    if found.comparisons:
        tables.append(_comparisons(found))
    if found.directions is not None:
        tables.append(_directions(found))
    return tables


def _position(found: Repeatability) -> Table:
    named = {"all visits": found.position, **found.protocols}
    if found.directions is not None:
        named |= {f"→ {name}": each for name, each in found.directions.scatter.items()}
    rows = [[name, *_scatter(each, found.confidence)] for name, each in named.items()]
    heads = ["", "visits", "RP", "interval", "mean", "std", "RMS", "max"]
    title = "Position repeatability of the tip, mm (ISO 9283: RP = mean + 3 std)"
    return _table(heads, rows, title)


def _scatter(each: PositionScatter, confidence: float) -> list[str]:
    numbers = [text(v, "m") for v in (each.mean, each.std, each.rms.value, each.maximum)]
    inside = _interval(each.rp.interval(confidence))
    return [str(each.count), text(each.rp.value, "m"), inside, *numbers]


def _joints(found: Repeatability) -> Table:
    rows = []
    for each in found.joints:
        std, wide = each.std.value, each.peak_to_peak
        angles = [text(value, each.unit) for value in (std, 3 * std, wide)]
        rows.append([each.joint, *angles, text(each.tip, "m")])
    o = found.orientation
    heads = ["joint", f"std, {_unit(found)}", "3 std", "peak to peak", "tip, mm"]
    turn = ", ".join(text(value, "rad") for value in (o.rpa, o.rpb, o.rpc))
    title = f"Repeatability of the joints; of the tip's orientation ±({turn}) deg about x, y, z"
    return _table(heads, rows, title)


def _unit(found: Repeatability) -> str:
    return " or ".join(sorted({unit_name(each.unit) for each in found.joints}))


def _comparisons(found: Repeatability) -> Table:
    rows = []
    for each in found.comparisons:
        for name, change in (("RP", each.rp), ("RMS", each.rms)):
            rows.append([f"{each.first} → {each.second}", name, *_change(change)])
    heads = ["protocols", "", "mm", "ratio", "interval", "difference, mm"]
    title = f"Protocols compared, {100 * found.confidence:g} % intervals"
    return Table(heads, rows, frozenset({2, 3, 4, 5}), title)


def _change(each: Change) -> list[str]:
    ratio = f"{each.second / each.first:.2f}" if each.first else NOTHING
    ends = each.ratio
    return [
        f"{text(each.first, 'm')} → {text(each.second, 'm')}",
        ratio,
        f"{ends.low:.2f} to {ends.high:.2f}",
        _interval(each.difference, sign=True),
    ]


def _directions(found: Repeatability) -> Table:
    assert found.directions is not None
    rows = []
    for each in found.directions.joints:
        numbers = (each.peak_to_peak, each.play, each.chance)
        angles = [text(value, each.unit) for value in numbers]
        mark = f"gives{'?' if each.as_well else ''}" if each.gives else ""
        rows.append([each.joint, *angles, text(each.tip, "m"), f"{each.p_value:.2g}", mark])
    heads = ["joint", f"means, {_unit(found)}", "play", "by chance", "tip, mm", "p", ""]
    shift = text(found.directions.tip_shift, "m")
    p_value = found.directions.tip_p_value
    title = f"Directions of the push: the tip shifts by {shift} mm (p = {p_value:.2g})"
    return Table(heads, rows, frozenset({1, 2, 3, 4, 5}), title)


def stationary_tables(found: Stationary) -> list[Table]:
    """Noise and drift of every joint."""
    heads = ["joint", "std", "detrended", "step", "drift per h", "best", "at, s"]
    rows = [[each.joint, *_noise(each)] for each in found.joints]
    unit = " or ".join(sorted({_fine(each.unit) for each in found.joints}))
    tip = "" if found.tip_std is None else f"; at the tip {text(found.tip_std, 'm')} mm"
    return [_table(heads, rows, f"Joints at rest, {unit}{tip}")]


def _noise(each: JointNoise) -> list[str]:
    unit, allan = each.unit, each.allan
    hourly = SECONDS_PER_HOUR * each.drift, SECONDS_PER_HOUR * each.drift_half
    return [
        _small(each.std, unit),
        _small(each.std_detrended, unit),
        NOTHING if each.step is None else _small(each.step, unit),
        f"{_small(hourly[0], unit)} ± {_small(hourly[1], unit)}",
        _small(float(allan.deviation[allan.best]), unit),
        f"{allan.tau[allan.best]:.3g}{'' if allan.bottomed else '+'}",
    ]


def _fine(unit: Unit) -> str:
    return "mdeg" if unit == "rad" else "µm"


def _small(value: float, unit: Unit) -> str:
    """Thousandths of what is usual: mdeg or µm."""
    return f"{1e3 * shown(value, unit):.{_DIGITS}g}"


def _interval(each: Interval, *, sign: bool = False) -> str:
    return f"{text(each.low, 'm', sign=sign)} to {text(each.high, 'm', sign=sign)}"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]], title: str) -> Table:
    return Table(heads, rows, frozenset(range(1, len(heads))), title)
