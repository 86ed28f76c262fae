"""Repeatability of visits to one point, and what the encoders do while nothing moves."""

from suta_calib.analysis.repeatability.directions import DirectionalForce, JointPush
from suta_calib.analysis.repeatability.scatter import (
    Change,
    Interval,
    JointScatter,
    OrientationScatter,
    PositionScatter,
    ProtocolComparison,
    ScatterEstimate,
    compare_protocols,
)
from suta_calib.analysis.repeatability.stationary import (
    AllanDeviation,
    JointNoise,
    Stationary,
    Stream,
    allan_deviation,
    read_stream,
    stationary,
)
from suta_calib.analysis.repeatability.visits import (
    DIRECTION,
    PROTOCOL,
    Repeatability,
    RepeatabilityTest,
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
    "RepeatabilityTest",
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
