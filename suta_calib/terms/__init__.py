"""Kinds of observation, and what is common to them. `kinds.py` has the list.

Names are imported when they are first used: who calibrates one kind need not wait for all.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.terms.block import Block as Block
    from suta_calib.terms.block import Noise as Noise
    from suta_calib.terms.camera_view import CameraView as CameraView
    from suta_calib.terms.fixed_point import FixedPoint as FixedPoint
    from suta_calib.terms.given import GivenPose as GivenPose
    from suta_calib.terms.hand_eye import HandEye as HandEye
    from suta_calib.terms.kinds import KINDS as KINDS
    from suta_calib.terms.kinds import every_grouping as every_grouping
    from suta_calib.terms.kinds import first_kind as first_kind
    from suta_calib.terms.landmark import TouchedLandmark as TouchedLandmark
    from suta_calib.terms.line import TouchedLine as TouchedLine
    from suta_calib.terms.observed import Observed as Observed
    from suta_calib.terms.pairwise_distance import PairwiseDistance as PairwiseDistance
    from suta_calib.terms.plane import TouchedPlane as TouchedPlane
    from suta_calib.terms.poses import ArmPoses as ArmPoses
    from suta_calib.terms.poses import MeasuredPoses as MeasuredPoses
    from suta_calib.terms.poses import PoseSource as PoseSource
    from suta_calib.terms.poses import joint_ranges as joint_ranges
    from suta_calib.terms.range import MeasuredRange as MeasuredRange
    from suta_calib.terms.seating import Seating as Seating
    from suta_calib.terms.setup import Setup as Setup
    from suta_calib.terms.synthetic import EXACT as EXACT
    from suta_calib.terms.synthetic import OutlierKind as OutlierKind
    from suta_calib.terms.synthetic import OutlierModel as OutlierModel
    from suta_calib.terms.synthetic import PoseNoise as PoseNoise
    from suta_calib.terms.synthetic import Simulated as Simulated
    from suta_calib.terms.term import Term as Term
    from suta_calib.terms.tracked_point import TrackedPoint as TrackedPoint

__getattr__, __all__ = public(__name__)
