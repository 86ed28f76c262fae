"""How a recorded motion follows a reference, as JSON data: ms, mm and degrees by name."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment
from suta_calib.geometry.numbers import homogeneous
from suta_calib.report.poses.json import quaternion, rpy_deg
from suta_calib.tracking.path_accuracy import ErrorFigures, PathAccuracy
from suta_calib.tracking.reversals import ChannelReversals
from suta_calib.units import Unit, shown, unit_name

MS: Final = 1e3
Json = dict[str, Any]


def dynamics_dict(found: PathAccuracy) -> Json:
    """Latency, errors, what happens where joints turn back, and the transform if one was found.

    ``errors`` has ``same_time`` (recorded minus reference at one time), ``latency_removed``,
    ``path`` (the part of it across the motion) and, with orientations, ``orientation``.
    """
    alignment = found.alignment
    return {
        "latency": {
            "value_ms": MS * alignment.latency,
            "std_ms": MS * alignment.latency_std,
            "searched_ms": MS * float(alignment.shifts[-1]),
        },
        "errors": _errors(found),
        "reversals": {"per": found.per, "channels": [_channel(found, c) for c in found.reversals]},
        "registration": _registration(found),
        "samples": {"compared": len(found.time), "recorded": len(found.recorded.time)},
        "seconds": float(found.time[-1] - found.time[0]),
        "verdict": dynamics_verdict(found).as_dict(),
        "input": {"recorded": str(found.recorded.path), "reference": str(found.reference.path)},
    }


def dynamics_verdict(found: PathAccuracy) -> Assessment:
    """Whether the figures may be used, and what must be known."""
    notes = list(found.notes)
    return Assessment.of(care=notes) if found.usable else Assessment.of(bad=notes)


def error_rows(found: PathAccuracy) -> dict[str, tuple[Unit, ErrorFigures]]:
    """Figures by key of the JSON, with a unit."""
    rows: dict[str, tuple[Unit, FloatArray]] = {
        "same_time": ("m", np.linalg.norm(found.error_same_time, axis=1)),
        "latency_removed": ("m", np.linalg.norm(found.error, axis=1)),
        "path": ("m", found.path_error),
    }
    if found.angle_error is not None:
        rows["orientation"] = ("rad", found.angle_error)
    return {key: (unit, ErrorFigures.of(sizes)) for key, (unit, sizes) in rows.items()}


def _errors(found: PathAccuracy) -> Json:
    content: Json = {}
    for key, (unit, figures) in error_rows(found).items():
        numbers = {
            "rms": figures.rms,
            "mean": figures.mean,
            "p95": figures.p95,
            "max": figures.maximum,
        }
        suffix = unit_name(unit)
        content[key] = {f"{name}_{suffix}": shown(value, unit) for name, value in numbers.items()}
        content[key]["count"] = figures.count
    return content


def _channel(found: PathAccuracy, each: ChannelReversals) -> Json:
    unit = each.channel.unit
    content = {
        "name": each.channel.name,
        "count": len(each.reversals),
        "error_before_mm": shown(each.error_before, "m"),
        "error_after_mm": shown(each.error_after, "m"),
        "jump_mm": shown(each.jump, "m"),
    }
    if found.per == "axis":
        return content
    size, std = found.hysteresis.get(each.channel.name, (math.nan, math.nan))
    suffix = unit_name(unit)
    figures = {f"hysteresis_{suffix}": size, f"hysteresis_std_{suffix}": std}
    return content | {key: shown(value, unit) for key, value in figures.items()}


def _registration(found: PathAccuracy) -> Json | None:
    if not found.alignment.registered:
        return None
    pose = homogeneous(found.alignment.rotation, found.alignment.position)
    return {
        "T_reference_recorded": pose.tolist(),
        "position_mm": [shown(float(v), "m") for v in found.alignment.position],
        "rpy_deg": rpy_deg(pose),
        "quaternion_xyzw": quaternion(pose),
    }
