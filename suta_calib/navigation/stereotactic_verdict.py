"""Whether the answer to a stereotactic navigation problem may be used."""

from __future__ import annotations

from typing import Final

from suta_calib.navigation.distortion import is_distorted, rms_length
from suta_calib.navigation.pivot import PivotCalibration
from suta_calib.navigation.registration import Registration
from suta_calib.navigation.stereotactic import StereotacticResult
from suta_calib.navigation.verdict import Verdict, verdict_of

USES: Final = {
    "em_pivot": "the EM pivot",
    "em_fiducials": "the fiducials",
    "em_nav": "the navigation frames",
}


def judge_stereotactic(result: StereotacticResult) -> Verdict:
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
        notes = [f"{name}: {note}" for note in part.verdict.notes]
        (caution if part.verdict.usable else bad).extend(notes)
    return verdict_of(bad, [*caution, *_on_distortion(result)])


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
