"""Whether the answer to a stereotactic navigation problem may be used."""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment
from suta_calib.geometry.numbers import extent, rms_length
from suta_calib.pose_calibration.pivot import PivotCalibration
from suta_calib.pose_calibration.registration import Registration, kabsch
from suta_calib.stereotactic.distortion import is_distorted
from suta_calib.stereotactic.solve import StereotacticResult

# Misfit of rigid markers, and of EM readings, that no noise or distortion of use makes, as part of
# the markers' extent.
MISSHAPEN: Final = 0.02
ELSEWHERE: Final = 0.05
USES: Final = {
    "em_pivot": "the EM pivot",
    "em_fiducials": "the fiducials",
    "em_nav": "the navigation frames",
}


def judge_stereotactic(result: StereotacticResult) -> Assessment:
    """Weigh the pivots, the registration, the distortion, and what was extrapolated."""
    parts: dict[str, PivotCalibration | Registration] = {
        "EM pivot": result.em_pivot,
        "optical pivot": result.optical_pivot,
    }
    if result.navigation is not None:
        parts["registration to CT"] = result.navigation.registration
    bad: list[str] = []
    caution: list[str] = []
    for name, part in parts.items():
        notes = [f"{name}: {note}" for note in part.assessment.notes]
        (caution if part.assessment.usable else bad).extend(notes)
    misfits = _on_shapes(result)
    # What does not fit together is not for dewarping to mend.
    return Assessment.of(
        bad=[*misfits, *bad], care=caution if misfits else [*caution, *_on_distortion(result)]
    )


def _on_shapes(result: StereotacticResult) -> list[str]:
    """Markers that do not have the shape that calbody gives them: a unit, an order, a marker."""
    body, readings = result.data.body, result.data.readings
    seen = {
        "calreadings: D": (body.base, readings.base),
        "calreadings: A": (body.optical, readings.optical),
        "optpivot: D": (body.base, result.data.optical_pivot.base),
    }
    notes = [
        f"{where} markers of frame {int(np.argmax(rms)) + 1} stay {1e3 * rms.max():.2f} mm RMS "
        "from calbody's: look for another unit or order, or for a wrong marker."
        for where, (given, frames) in seen.items()
        if (rms := _misfit(given, frames)).max() > MISSHAPEN * extent(given)
    ]
    off = rms_length(result.em_error)
    if off > ELSEWHERE * extent(body.em):
        notes.append(
            f"The EM markers are read {1e3 * off:.1f} mm RMS from where the optical tracker says: "
            "more than distortion; look for another unit or order of the C markers."
        )
    return notes


def _misfit(given: FloatArray, frames: FloatArray) -> FloatArray:
    """RMS distance (N_frames,) of each frame's markers from the given ones laid over them, m."""
    same = np.broadcast_to(given, frames.shape)
    R, p = kabsch(same, frames)
    apart = np.einsum("fij,fmj->fmi", R, same) + p[:, None] - frames
    return np.asarray(np.sqrt(np.mean(np.sum(apart**2, axis=2), axis=1)))


def _on_distortion(result: StereotacticResult) -> list[str]:
    correction, measured = result.correction, result.data.readings.em
    if correction is None:
        if not is_distorted(measured, result.expected):
            return []
        return [
            f"The EM tracker's readings are {1e3 * rms_length(result.em_error):.2f} mm off where "
            "the optical tracker says, most of it distortion: --dewarp corrects it."
        ]
    return [
        f"{count} of {_markers(result, use)} markers of {USES[use]} lie outside the calibrated "
        "volume, where the distortion is not known."
        for use, count in result.extrapolated.items()
        if count
    ]


def _markers(result: StereotacticResult, use: str) -> int:
    owner: object = result.data if use == "em_pivot" else result.data.navigation
    return int(getattr(owner, use)[..., 0].size)
