"""The search for outliers as JSON data: per cent and millimetres, keys say so."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from suta_calib.analysis.outliers import (
    AGREEMENT,
    METRICS,
    Group,
    HeldOut,
    Level,
    Metric,
    Outliers,
    TermOutliers,
    Thresholds,
)
from suta_calib.analysis.outliers.judgement import GROUPING_NOUN

Json = dict[str, Any]
# Metric → its key, and what turns it from SI into the key's unit.
KEYS: Final[dict[Metric, tuple[str, float]]] = {
    "contribution": ("contribution_pct", 100.0),
    "cooks_distance": ("cooks_distance", 1.0),
    "leave_one_out": ("leave_one_out_pct", 100.0),
    "bias": ("bias_mm", 1e3),
}
MM: Final = 1e3


def outliers_dict(found: Outliers) -> Json:
    """The whole answer; levels of the first observation that has them stand at the top."""
    terms = [_term(term) for term in found.terms]
    top: Json = {}
    for term in terms:
        for key in GROUPING_NOUN:
            if key in term and key not in top:
                top[key] = term[key]
    first = terms[0]
    return {
        "verdict": {**found.assessment.as_dict(), "sentence": found.assessment.sentence},
        **top,
        "touches": [touch for term in terms for touch in term["touches"]],
        "held_out": first["held_out"],
        "thresholds": _thresholds(found.thresholds),
        "agreement": AGREEMENT,
        "exclude": exclusion(found),
        "explained_by": list(found.explaining),
        **({"by_term": terms} if len(terms) > 1 else {}),
    }


def exclusion(found: Outliers) -> list[Json]:
    """What ``exclude`` would say for each observation, to leave the outliers out."""
    return [
        {level.name: [g.label for g in level.outliers] for level in term.levels if level.outliers}
        for term in found.terms
    ]


def _thresholds(t: Thresholds) -> Json:
    return {
        "contribution_times_n": t.contribution,
        "cooks_distance_times_n": t.cook,
        "leave_one_out_pct": 100 * t.leave_one_out,
        "bias_mm": MM * t.bias,
        "significance": t.significance,
    }


def _term(term: TermOutliers) -> Json:
    return {
        "kind": term.kind,
        **{level.name: {g.label: _group(g) for g in level.groups} for level in term.levels},
        "thresholds": {level.name: _scaled(level.thresholds) for level in term.levels},
        "touches": [
            {"row": t.origin, "what": t.what, "size_mm": MM * t.size} for t in term.touches
        ],
        "samples": term.samples,
        "noise_mm": _finite(MM * term.sigma),
        "held_out": {
            "method": term.method,
            **{
                level: {label: _held_out(h) for label, h in effects.items()}
                for level, effects in term.held_out.items()
            },
        },
    }


def _group(group: Group) -> Json:
    placed: Json = {}
    if group.displacement is not None:
        placed = {
            "displacement_mm": (MM * group.displacement.vector).tolist(),
            "displacement_std_mm": (MM * group.displacement.std).tolist(),
        }
    return {
        **_scaled(group.values),
        "p": {KEYS[name][0]: _finite(group.p[name]) for name in METRICS},
        "flags": [KEYS[name][0] for name in group.flags],
        "outlier": group.outlier,
        "suspect": group.suspect,
        "samples": group.samples,
        **placed,
        "as_calibrated": _scaled(group.as_calibrated),
    }


def _scaled(values: Mapping[Metric, float]) -> Json:
    return {key: _finite(scale * values[name]) for name, (key, scale) in KEYS.items()}


def _held_out(effect: HeldOut) -> Json:
    return {
        "rms_before_mm": MM * effect.before,
        "rms_after_mm": MM * effect.after,
        "change_pct": 100 * effect.change,
        "rms_all_after_mm": MM * effect.everything,
        "count": effect.count,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def threshold_text(level: Level, metric: Metric) -> str:
    """A level's threshold as it is shown."""
    key, scale = KEYS[metric]
    unit = {"_pct": " %", "_mm": " mm"}.get(key[key.rfind("_") :], "")
    return f"{scale * level.thresholds[metric]:.3g}{unit}"
