"""Kinds of observation. A new kind of calibration is one new file here, and one line below."""

from __future__ import annotations

from typing import Final

from suta_calib.terms.block import Block, Noise
from suta_calib.terms.camera_view import CameraView
from suta_calib.terms.fixed_point import FixedPoint
from suta_calib.terms.given import GivenPose
from suta_calib.terms.hand_eye import HandEye
from suta_calib.terms.landmark import TouchedLandmark
from suta_calib.terms.line import TouchedLine
from suta_calib.terms.observed import Observed
from suta_calib.terms.pairwise_distance import PairwiseDistance
from suta_calib.terms.plane import TouchedPlane
from suta_calib.terms.poses import ArmPoses, MeasuredPoses, PoseSource
from suta_calib.terms.range import MeasuredRange
from suta_calib.terms.seating import Seating
from suta_calib.terms.setup import Setup
from suta_calib.terms.synthetic import EXACT, OutlierKind, OutlierModel, PoseNoise, Simulated
from suta_calib.terms.term import Term
from suta_calib.terms.tracked_point import TrackedPoint

# In the order in which they are offered; where one of a sort is needed, the first is taken.
KINDS: Final[dict[str, type[Term]]] = {
    cls.kind: cls
    for cls in (
        PairwiseDistance,
        TouchedLandmark,
        FixedPoint,
        TouchedPlane,
        TouchedLine,
        MeasuredRange,
        TrackedPoint,
        HandEye,
        CameraView,
    )
}
# What one group of samples is called, in any kind, and the label columns that name it.
GROUPINGS: Final = {
    noun: columns for kind in KINDS.values() for noun, columns in kind.groupings.items()
}


def first_kind(*, artefact: bool) -> type[Term]:
    """The first kind whose tip touches an artefact, or a place without one."""
    touching = (kind for kind in KINDS.values() if kind.medium == "touch")
    return next(kind for kind in touching if kind.needs_artefact == artefact)


__all__ = [
    "EXACT",
    "GROUPINGS",
    "KINDS",
    "ArmPoses",
    "Block",
    "CameraView",
    "FixedPoint",
    "GivenPose",
    "HandEye",
    "MeasuredPoses",
    "MeasuredRange",
    "Noise",
    "Observed",
    "OutlierKind",
    "OutlierModel",
    "PairwiseDistance",
    "PoseNoise",
    "PoseSource",
    "Seating",
    "Setup",
    "Simulated",
    "Term",
    "TouchedLandmark",
    "TouchedLine",
    "TouchedPlane",
    "TrackedPoint",
    "first_kind",
]
