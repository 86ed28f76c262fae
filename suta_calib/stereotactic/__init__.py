"""The JHU CIS stereotactic navigation problem: two trackers, distortion, and registration to CT.

Names are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.stereotactic.cis_files import StereotacticData as StereotacticData
    from suta_calib.stereotactic.cis_simulation import SimulatedSet as SimulatedSet
    from suta_calib.stereotactic.cis_simulation import (
        simulate_stereotactic as simulate_stereotactic,
    )
    from suta_calib.stereotactic.distortion import DistortionCorrection as DistortionCorrection
    from suta_calib.stereotactic.distortion import fit_distortion as fit_distortion
    from suta_calib.stereotactic.solve import StereotacticErrors as StereotacticErrors
    from suta_calib.stereotactic.solve import StereotacticResult as StereotacticResult
    from suta_calib.stereotactic.solve import compare as compare
    from suta_calib.stereotactic.solve import read_given as read_given
    from suta_calib.stereotactic.solve import solve_stereotactic as solve_stereotactic

__getattr__, __all__ = public(__name__)
