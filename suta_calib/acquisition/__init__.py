"""From an arm at rest to samples: rests found and averaged, guided or unattended measuring."""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import lazily

if TYPE_CHECKING:
    from suta_calib.acquisition.averaging import Average, average, wrap
    from suta_calib.acquisition.measuring import Measured, MeasureOptions, measure
    from suta_calib.acquisition.rest import RestDetector, RestSettings
    from suta_calib.acquisition.stops import StopFinder

_HOMES = {
    "averaging": ("Average", "average", "wrap"),
    "measuring": ("MeasureOptions", "Measured", "measure"),
    "rest": ("RestDetector", "RestSettings"),
    "stops": ("StopFinder",),
}

__all__ = [
    "Average",
    "MeasureOptions",
    "Measured",
    "RestDetector",
    "RestSettings",
    "StopFinder",
    "average",
    "measure",
    "wrap",
]

__getattr__ = lazily(__name__, _HOMES)
