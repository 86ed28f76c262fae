"""How far to trust a calibration.

Names are imported when they are first used. The analyses themselves are `suta_calib.error_budget`
and `suta_calib.tip_map`; larger ones have a package of their own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.analysis.error_budget import EncoderNoise as EncoderNoise
    from suta_calib.analysis.error_budget import ErrorBudget as ErrorBudget
    from suta_calib.analysis.tip_map import TipMap as TipMap
    from suta_calib.analysis.tip_map import TipMapOptions as TipMapOptions
    from suta_calib.analysis.tip_map import tip_map_of_result as tip_map_of_result
    from suta_calib.analysis.tip_map import tip_map_of_solution as tip_map_of_solution
    from suta_calib.analysis.tip_map_plot import draw_tip_map as draw_tip_map
    from suta_calib.analysis.tip_sections import Knowledge as Knowledge
    from suta_calib.analysis.tip_sections import Walker as Walker
    from suta_calib.diagnostics.tip_uncertainty import Sensitivity as Sensitivity

__getattr__, __all__ = public(__name__)
