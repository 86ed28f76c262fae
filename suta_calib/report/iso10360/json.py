"""The acceptance test as JSON data: mm by name."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from suta_calib.analysis.accuracy import Metrics
from suta_calib.analysis.iso10360 import (
    AcceptanceTest,
    Articulation,
    Characteristic,
    LengthErrors,
    LengthLimit,
    Repeats,
    SphereProbing,
)
from suta_calib.geometry import FloatArray
from suta_calib.report.poses.json import verdict_dict
from suta_calib.report.units import shown

Json = dict[str, Any]
SYMBOL: Final = {
    "E_Uni": "E_Uni, length",
    "E_Bi": "E_Bi, length",
    "L_Dia": "L_Dia, articulated location",
    "P_Size": "P_Size, sphere",
    "P_Form": "P_Form, sphere",
    "repeatability": "repeatability",
}
STANDARD: Final = "ISO 10360-12:2016"


def acceptance_dict(found: AcceptanceTest) -> Json:
    """Every figure with its limit, its uncertainty and the decision, and what it was found on."""
    m = found.measured
    return {
        "standard": STANDARD,
        "decision": found.decision,
        "passed": None if found.decision == "no limit" else found.decision == "pass",
        "decision_rule": {"kind": found.rule.kind, "factor": found.rule.factor},
        "characteristics": [_characteristic(each) for each in found.characteristics],
        "lengths": None if m.lengths is None else _lengths(found, m.lengths),
        "articulations": {each.point: _articulation(each) for each in m.articulations},
        "spheres": {each.sphere: _sphere(each) for each in m.spheres},
        "repeatability": {each.point: _repeats(each) for each in m.repeats},
        "mpe": _limits(found),
        "simplified": list(found.simplified),
        "verdict": verdict_dict(found.verdict),
    }


def _characteristic(each: Characteristic) -> Json:
    return {
        "symbol": each.symbol,
        "value_mm": _mm(each.value),
        "limit_mm": _mm(each.limit),
        "expanded_uncertainty_mm": _mm(each.expanded),
        "decision": each.decision,
        "where": each.where,
        "count": each.count,
    }


def _lengths(found: AcceptanceTest, lengths: LengthErrors) -> Json:
    limit = None if found.limits.length is None else found.limits.length.at(lengths.length)
    return {
        **_figures(lengths.error),
        "repeat_range_mm": _mm(lengths.repeat_range),
        "placements": {
            name: _figures(lengths.error[rows]) for name, rows in lengths.by_placement()
        },
        "rows": {
            "pair": list(lengths.label),
            "placement": list(lengths.placement),
            "repeat": list(lengths.repeat),
            "length_mm": _listed(lengths.length),
            "error_mm": _listed(lengths.error),
            "limit_mm": None if limit is None else _listed(limit),
            "expanded_uncertainty_mm": _listed(found.length_expanded),
        },
    }


def _figures(error: FloatArray) -> Json:
    figures = Metrics.of(np.abs(error))
    return {
        "count": figures.count,
        "mean_mm": _mm(float(error.mean())),
        "rms_mm": _mm(figures.rms),
        "min_mm": _mm(float(error.min())),
        "max_mm": _mm(float(error.max())),
    }


def _articulation(each: Articulation) -> Json:
    return {
        "location_mm": _mm(each.diameter),
        "max_deviation_mm": _mm(each.maximum),
        "two_sigma_mm": _mm(each.two_sigma),
        "axis_range_mm": _listed(each.axis_range),
        "articulations": len(each.names),
        "touches": each.touches,
        "amplification": each.amplification,
        "centre_mm": _listed(each.centres.mean(axis=0)),
    }


def _sphere(each: SphereProbing) -> Json:
    return {
        "size_mm": _mm(each.size),
        "form_mm": _mm(each.form),
        "touches": len(each.radial),
        "radial_mm": _listed(each.radial),
    }


def _repeats(each: Repeats) -> Json:
    return {
        "diameter_mm": _mm(each.diameter),
        "rp_mm": _mm(each.scatter.rp.value),
        "rms_mm": _mm(each.scatter.rms.value),
        "visits": each.scatter.count,
    }


def _limits(found: AcceptanceTest) -> Json | None:
    if not found.limits.given:
        return None
    given = found.limits
    return {
        "length": None if given.length is None else length_limit_text(given.length),
        "location_mm": _mm(given.location),
        "size_mm": _mm(given.size),
        "form_mm": _mm(given.form),
        "repeatability_mm": _mm(given.repeatability),
    }


def length_limit_text(limit: LengthLimit) -> str:
    """As a maker states it: ``(60 + L/10) µm, at most 150 µm``, L in mm."""
    parts = []
    if limit.constant is not None:
        slope = f" + L/{1e-3 / limit.slope:g}" if limit.slope else ""
        parts.append(
            f"({1e6 * limit.constant:g}{slope}) µm" if slope else f"{1e6 * limit.constant:g} µm"
        )
    if limit.largest is not None:
        parts.append(f"at most {1e6 * limit.largest:g} µm")
    return ", ".join(parts)


def _mm(value: float | None) -> float | None:
    return None if value is None else shown(value, "m")


def _listed(values: FloatArray) -> list[float]:
    return [shown(float(value), "m") for value in values]
