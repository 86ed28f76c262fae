"""Repeatability of visits to one point, or of touches of many, and of encoders at rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.analysis.repeatability.answer import RepeatabilityTest as RepeatabilityTest
    from suta_calib.analysis.repeatability.at_rest import AllanDeviation as AllanDeviation
    from suta_calib.analysis.repeatability.at_rest import JointNoise as JointNoise
    from suta_calib.analysis.repeatability.at_rest import Stationary as Stationary
    from suta_calib.analysis.repeatability.at_rest import Stream as Stream
    from suta_calib.analysis.repeatability.at_rest import allan_deviation as allan_deviation
    from suta_calib.analysis.repeatability.at_rest import read_stream as read_stream
    from suta_calib.analysis.repeatability.at_rest import stationary as stationary
    from suta_calib.analysis.repeatability.directions import DirectionalForce as DirectionalForce
    from suta_calib.analysis.repeatability.directions import JointPush as JointPush
    from suta_calib.analysis.repeatability.scatter import Interval as Interval
    from suta_calib.analysis.repeatability.scatter import JointScatter as JointScatter
    from suta_calib.analysis.repeatability.scatter import OrientationScatter as OrientationScatter
    from suta_calib.analysis.repeatability.scatter import PositionScatter as PositionScatter
    from suta_calib.analysis.repeatability.scatter import ProtocolComparison as ProtocolComparison
    from suta_calib.analysis.repeatability.scatter import ScatterChange as ScatterChange
    from suta_calib.analysis.repeatability.scatter import ScatterEstimate as ScatterEstimate
    from suta_calib.analysis.repeatability.scatter import compare_protocols as compare_protocols
    from suta_calib.analysis.repeatability.scatter import joints_rms as joints_rms
    from suta_calib.analysis.repeatability.scatter import tip_levers as tip_levers
    from suta_calib.analysis.repeatability.touches import POINT as POINT
    from suta_calib.analysis.repeatability.touches import JointRepeats as JointRepeats
    from suta_calib.analysis.repeatability.touches import RepeatedTouches as RepeatedTouches
    from suta_calib.analysis.repeatability.touches import repeated_touches as repeated_touches
    from suta_calib.analysis.repeatability.visits import DIRECTION as DIRECTION
    from suta_calib.analysis.repeatability.visits import PROTOCOL as PROTOCOL
    from suta_calib.analysis.repeatability.visits import Repeatability as Repeatability
    from suta_calib.analysis.repeatability.visits import repeatability as repeatability

__getattr__, __all__ = public(__name__)
