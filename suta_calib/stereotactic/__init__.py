"""The JHU CIS stereotactic navigation problem: two trackers, distortion, and registration to CT.

Names are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import lazily

if TYPE_CHECKING:
    from suta_calib.stereotactic.cis_simulation import SimulatedSet, simulate_stereotactic
    from suta_calib.stereotactic.data import StereotacticData
    from suta_calib.stereotactic.distortion import DistortionCorrection, fit_distortion
    from suta_calib.stereotactic.solve import (
        StereotacticErrors,
        StereotacticResult,
        compare,
        read_given,
        solve_stereotactic,
    )

_HOMES = {
    "cis_simulation": ("SimulatedSet", "simulate_stereotactic"),
    "data": ("StereotacticData",),
    "distortion": ("DistortionCorrection", "fit_distortion"),
    "solve": (
        "StereotacticErrors",
        "StereotacticResult",
        "compare",
        "read_given",
        "solve_stereotactic",
    ),
}

__all__ = [
    "DistortionCorrection",
    "SimulatedSet",
    "StereotacticData",
    "StereotacticErrors",
    "StereotacticResult",
    "compare",
    "fit_distortion",
    "read_given",
    "simulate_stereotactic",
    "solve_stereotactic",
]

__getattr__ = lazily(__name__, _HOMES)
