"""Repeatability of visits to one point, and what the encoders do while nothing moves."""

from suta_calib.analysis.repeatability.allan import AllanDeviation, allan_deviation
from suta_calib.analysis.repeatability.directions import DirectionalForce, JointPush
from suta_calib.analysis.repeatability.intervals import Interval, ScatterEstimate
from suta_calib.analysis.repeatability.protocols import (
    Change,
    ProtocolComparison,
    compare_protocols,
)
from suta_calib.analysis.repeatability.scatter import (
    JointScatter,
    OrientationScatter,
    PositionScatter,
)
from suta_calib.analysis.repeatability.stationary import JointNoise, Stationary, stationary
from suta_calib.analysis.repeatability.stream import Stream, read_stream
from suta_calib.analysis.repeatability.visits import (
    DIRECTION,
    PROTOCOL,
    Repeatability,
    repeatability,
    tip_levers,
)

__all__ = [
    "DIRECTION",
    "PROTOCOL",
    "AllanDeviation",
    "Change",
    "DirectionalForce",
    "Interval",
    "JointNoise",
    "JointPush",
    "JointScatter",
    "OrientationScatter",
    "PositionScatter",
    "ProtocolComparison",
    "Repeatability",
    "ScatterEstimate",
    "Stationary",
    "Stream",
    "allan_deviation",
    "compare_protocols",
    "read_stream",
    "repeatability",
    "stationary",
    "tip_levers",
]
