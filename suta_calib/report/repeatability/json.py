"""Repeatability and stationary streams as JSON data: mm, degrees and seconds by name."""

from __future__ import annotations

from typing import Any

from suta_calib.analysis.repeatability import (
    Change,
    DirectionalForce,
    Interval,
    JointNoise,
    JointPush,
    JointScatter,
    PositionScatter,
    ProtocolComparison,
    Repeatability,
    Stationary,
)
from suta_calib.units import Unit, shown, unit_name

Json = dict[str, Any]
SECONDS_PER_HOUR = 3600.0


def repeatability_dict(found: Repeatability) -> Json:
    """Scatter of the tip and of the joints, directions and protocols where there are several."""
    o, confidence = found.orientation, found.confidence
    answer: Json = {
        "visits": found.position.count,
        "confidence_pct": 100 * confidence,
        "rp_mm": _mm(found.position.rp.value),
        "rms_mm": _mm(found.position.rms.value),
        "position": position_dict(found.position, confidence),
        "orientation": {
            f"{name}_deg": shown(getattr(o, name), "rad") for name in ("rpa", "rpb", "rpc", "rms")
        },
        "joints": {each.joint: _joint(each, confidence) for each in found.joints},
        "protocols": {
            name: position_dict(each, confidence) for name, each in found.protocols.items()
        },
        "comparisons": [_comparison(each) for each in found.comparisons],
        "directions": None
        if found.directions is None
        else _directions(found.directions, confidence),
        "elsewhere": [found.samples.origin[row] for row in found.elsewhere],
        "other_posture": [found.samples.origin[row] for row in found.other_posture],
        "correlation": found.correlation,
    }
    return answer | {"verdict": found.assessment.as_dict()}


def position_dict(each: PositionScatter, confidence: float) -> Json:
    """Position repeatability, mm; ISO 9283:1998, 7.2.2."""
    return {
        "count": each.count,
        "rp_mm": _mm(each.rp.value),
        "rp_interval_mm": _interval(each.rp.interval(confidence)),
        "mean_mm": _mm(each.mean),
        "std_mm": _mm(each.std),
        "rms_mm": _mm(each.rms.value),
        "rms_interval_mm": _interval(each.rms.interval(confidence)),
        "max_mm": _mm(each.maximum),
        "axis_std_mm": [_mm(value) for value in each.axis_std],
        "barycentre_mm": [_mm(value) for value in each.barycentre],
    }


def _joint(each: JointScatter, confidence: float) -> Json:
    figures = {
        "mean": each.mean,
        "std": each.std.value,
        "repeatability": 3 * each.std.value,
        "peak_to_peak": each.peak_to_peak,
    }
    inside = each.std.interval(confidence)
    unit = unit_name(each.unit)
    return _with_unit(figures, each.unit) | {
        f"std_interval_{unit}": [shown(inside.low, each.unit), shown(inside.high, each.unit)],
        "tip_mm": _mm(each.tip),
    }


def _comparison(each: ProtocolComparison) -> Json:
    return {
        "first": each.first,
        "second": each.second,
        "rp": _change(each.rp),
        "rms": _change(each.rms),
    }


def _change(each: Change) -> Json:
    return {
        "first_mm": _mm(each.first),
        "second_mm": _mm(each.second),
        "ratio": each.second / each.first if each.first else None,
        "ratio_interval": [each.ratio.low, each.ratio.high],
        "difference_mm": _mm(each.second - each.first),
        "difference_interval_mm": _interval(each.difference),
        "proved": each.proved,
    }


def _directions(found: DirectionalForce, confidence: float) -> Json:
    giving = found.giving
    return {
        "giving": None if giving is None else giving.joint,
        "giving_joints": [each.joint for each in found.joints if each.gives],
        "tip_shift_mm": _mm(found.tip_shift),
        "tip_p_value": found.tip_p_value,
        "joints": {each.joint: _push(each) for each in found.joints},
        "scatter": {name: position_dict(each, confidence) for name, each in found.scatter.items()},
    }


def _push(each: JointPush) -> Json:
    figures = {
        "peak_to_peak": each.peak_to_peak,
        "play": each.play,
        "play_by_chance": each.chance,
    }
    unit = unit_name(each.unit)
    return _with_unit(figures, each.unit) | {
        "tip_mm": _mm(each.tip),
        "p_value": each.p_value,
        "gives": each.gives,
        "as_well": list(each.as_well),
        f"means_{unit}": {name: shown(value, each.unit) for name, value in each.means.items()},
    }


def stationary_dict(found: Stationary) -> Json:
    """Every joint's noise, steps, drift and Allan deviation."""
    stream = found.stream
    return {
        "readings": len(stream.time),
        "seconds": found.seconds,
        "rate_hz": 1 / stream.period,
        "gaps": stream.gaps,
        "dropped": stream.dropped,
        "tip_noise_mm": None if found.tip_std is None else _mm(found.tip_std),
        "joints": {each.joint: _noise(each) for each in found.joints},
        "verdict": found.assessment.as_dict(),
        "input": str(stream.path),
    }


def _noise(each: JointNoise) -> Json:
    figures = {
        "mean": each.mean,
        "std": each.std,
        "std_detrended": each.std_detrended,
        "std_short": each.std_short,
        "peak_to_peak": each.peak_to_peak,
        "step": each.step,
    }
    hourly = {"drift": each.drift, "drift_half_interval": each.drift_half}
    unit = unit_name(each.unit)
    slopes = {
        f"{key}_{unit}_per_h": SECONDS_PER_HOUR * shown(value, each.unit)
        for key, value in hourly.items()
    }
    flags = {"drifts": each.drifts, "moved": each.moved, "stuck": each.stuck}
    counts = {"levels": each.levels, "left_out": each.left_out}
    return _with_unit(figures, each.unit) | slopes | flags | counts | {"allan": _allan(each)}


def _allan(each: JointNoise) -> Json:
    allan, unit = each.allan, unit_name(each.unit)

    def listed(values: Any) -> list[float]:
        return [shown(float(value), each.unit) for value in values]

    return {
        "tau_s": allan.tau.tolist(),
        f"deviation_{unit}": listed(allan.deviation),
        f"low_{unit}": listed(allan.low),
        f"high_{unit}": listed(allan.high),
        "best_tau_s": float(allan.tau[allan.best]),
        f"best_{unit}": shown(float(allan.deviation[allan.best]), each.unit),
        "rises_again": allan.bottomed,
    }


def _with_unit(figures: dict[str, float | None] | dict[str, float], unit: Unit) -> Json:
    return {
        f"{key}_{unit_name(unit)}": None if value is None else shown(value, unit)
        for key, value in figures.items()
    }


def _mm(value: float) -> float:
    return shown(value, "m")


def _interval(each: Interval) -> list[float]:
    return [_mm(each.low), _mm(each.high)]
