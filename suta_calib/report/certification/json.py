"""A certification as JSON data."""

from __future__ import annotations

from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.certification.artefact_file import frame_sentence
from suta_calib.certification.comparison import DrawingComparison
from suta_calib.certification.result import (
    Certification,
    CertifiedLandmark,
    PlaneQuality,
    SpacerLength,
)
from suta_calib.certification.trust import verdict_on

Json = dict[str, Any]


def certification_dict(found: Certification) -> Json:
    """Every number of a certification, mm and degrees by their keys.

    ``std_mm`` is of each coordinate in the artefact's frame; ``shape_std_mm`` after best
    superposition, as distances see it; ``covariance`` is complete, in the landmarks' order.
    """
    assessment = verdict_on(found)
    comparison = found.comparison
    return {
        "name": found.name,
        "points": found.points,
        "landmarks": {
            mark.name: _landmark(found, k, mark) for k, mark in enumerate(found.landmarks)
        },
        "frame": {
            "definition": frame_sentence(found),
            "origin": found.origin,
            "x": found.heading,
            "quarter_turns": found.turned,
            "x_std_deg": float(np.degrees(found.heading_std)),
        },
        "ground": _plane(found.ground),
        "side": None if found.side is None else _plane(found.side),
        "spacers": [_spacer(found, spacer) for spacer in found.spacers],
        "noise": {
            "sigma_mm": 1e3 * found.noise,
            "stated_mm": None if found.stated_noise is None else 1e3 * found.stated_noise,
            "degrees_of_freedom": None if np.isinf(found.freedom) else found.freedom,
            "coverage_factor": found.coverage_factor,
        },
        "covariance": {
            "landmarks": [mark.name for mark in found.landmarks],
            "unit": "mm²; x y z of each landmark",
            "matrix": (1e6 * found.covariance).tolist(),
        },
        "comparison": None if comparison is None else _comparison(comparison),
        "tolerance_mm": None if found.tolerance is None else 1e3 * found.tolerance,
        "damaged": list(found.damaged),
        "wrong_touches": list(found.wrong_touches),
        "verdict": {
            "level": assessment.level,
            "usable": assessment.usable,
            "sentence": assessment.sentence,
            "notes": list(assessment.notes),
        },
    }


def _landmark(found: Certification, k: int, mark: CertifiedLandmark) -> Json:
    yaw, yaw_std = mark.yaw, mark.yaw_std
    faults = [fault for fault in found.faults if fault.landmark == mark.name]
    return {
        "position_mm": _mm(mark.position),
        "std_mm": _mm(mark.std),
        "shape_std_mm": _mm(mark.shape_std),
        "sigma_mm": 1e3 * mark.sigma,
        "rotation_rpy_deg": None if yaw is None else [180.0, 0.0, float(np.degrees(yaw))],
        "yaw_std_deg": None if yaw_std is None else float(np.degrees(yaw_std)),
        "height_mm": 1e3 * float(mark.position[2]),
        "height_std_mm": 1e3 * float(mark.std[2]),
        "top": {
            "tilt_deg": float(np.degrees(mark.tilt)),
            "tilt_std_deg": float(np.degrees(mark.tilt_std)),
            "flatness_mm": 1e3 * mark.flatness,
            "touches": mark.touches,
            "wrong_touches": list(mark.wrong_touches),
        },
        "holes": {"middles_apart_mm": 1e3 * mark.symmetry, "diagonals_mm": _mm(mark.diagonals)},
        "flats_mm": None if mark.flats is None else 1e3 * mark.flats,
        "nominal": None if found.comparison is None else _drawn(found.comparison, k, mark.name),
        "damaged": bool(faults),
        "faults": [
            {"what": f.what, "size_mm": 1e3 * f.size, "limit_mm": 1e3 * f.limit} for f in faults
        ],
    }


def _drawn(comparison: DrawingComparison, k: int, name: str) -> Json | None:
    if name not in comparison.drawing.landmarks:
        return None
    deviation, turn = comparison.deviation[k], float(comparison.turn[k])
    return {
        "position_mm": _mm(comparison.drawing.landmark(name).position),
        "deviation_mm": _mm(deviation),
        "distance_mm": 1e3 * float(np.linalg.norm(deviation)),
        "turn_deg": float(np.degrees(turn)) if np.isfinite(turn) else None,
    }


def _plane(plane: PlaneQuality) -> Json:
    return {
        "touches": plane.count,
        "rms_mm": 1e3 * plane.rms,
        "flatness_mm": 1e3 * plane.flatness,
        "direction_std_deg": float(np.degrees(plane.tilt_std)),
        "wrong_touches": list(plane.wrong_touches),
    }


def _spacer(found: Certification, spacer: SpacerLength) -> Json:
    nominal, deviation = spacer.nominal, spacer.deviation
    return {
        "name": spacer.name,
        "length_mm": 1e3 * spacer.length,
        "std_mm": 1e3 * spacer.std,
        "u95_mm": 1e3 * found.coverage_factor * spacer.std,
        "nominal_mm": None if nominal is None else 1e3 * nominal,
        "deviation_mm": None if deviation is None else 1e3 * deviation,
    }


def _comparison(comparison: DrawingComparison) -> Json:
    return {
        "drawing": comparison.drawing.name,
        "T_drawing_artefact": comparison.registration.matrix.tolist(),
        "rms_mm": 1e3 * comparison.rms,
        "max_mm": 1e3 * comparison.largest,
        "not_drawn": list(comparison.not_drawn),
        "not_touched": list(comparison.not_touched),
    }


def _mm(values: FloatArray) -> list[float]:
    return [float(v) + 0.0 for v in 1e3 * values]
