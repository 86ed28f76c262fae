"""From an arm at rest to samples: rests found and averaged, guided or unattended measuring."""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.acquisition.averaging import Average as Average
    from suta_calib.acquisition.averaging import average as average
    from suta_calib.acquisition.measuring import Measured as Measured
    from suta_calib.acquisition.measuring import MeasureOptions as MeasureOptions
    from suta_calib.acquisition.measuring import measure as measure
    from suta_calib.acquisition.rest import RestDetector as RestDetector
    from suta_calib.acquisition.rest import RestSettings as RestSettings
    from suta_calib.acquisition.stops import StopFinder as StopFinder

__getattr__, __all__ = public(__name__)
