"""Kinds of observation. A new kind of calibration is one new file here, and one line below."""

from __future__ import annotations

from suta_calib.terms.fixed_point import FixedPoint
from suta_calib.terms.hand_eye import HandEye
from suta_calib.terms.landmark import TouchedLandmark
from suta_calib.terms.pairwise_distance import PairwiseDistance
from suta_calib.terms.poses import ArmPoses, MeasuredPoses, PoseSource
from suta_calib.terms.seating import Seating
from suta_calib.terms.term import Block, Noise, Setup, Term
from suta_calib.terms.tracked_point import TrackedPoint

KINDS: dict[str, type[Term]] = {
    cls.kind: cls for cls in (PairwiseDistance, TouchedLandmark, FixedPoint, TrackedPoint, HandEye)
}

__all__ = [
    "KINDS",
    "ArmPoses",
    "Block",
    "FixedPoint",
    "HandEye",
    "MeasuredPoses",
    "Noise",
    "PairwiseDistance",
    "PoseSource",
    "Seating",
    "Setup",
    "Term",
    "TouchedLandmark",
    "TrackedPoint",
]
