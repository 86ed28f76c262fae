"""Pivot, hand-eye and registration: the same terms over measured poses, robust.

Names are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import lazily

if TYPE_CHECKING:
    from suta_calib.pose_calibration.hand_eye import (
        HandEyeCalibration,
        calibrate_hand_eye,
        hand_eye_from_pairs,
    )
    from suta_calib.pose_calibration.pivot import (
        PivotCalibration,
        calibrate_pivot,
        pivot_from_poses,
    )
    from suta_calib.pose_calibration.registration import (
        Registration,
        register,
        registration_from_points,
    )

_HOMES = {
    "hand_eye": ("HandEyeCalibration", "calibrate_hand_eye", "hand_eye_from_pairs"),
    "pivot": ("PivotCalibration", "calibrate_pivot", "pivot_from_poses"),
    "registration": ("Registration", "register", "registration_from_points"),
}

__all__ = [
    "HandEyeCalibration",
    "PivotCalibration",
    "Registration",
    "calibrate_hand_eye",
    "calibrate_pivot",
    "hand_eye_from_pairs",
    "pivot_from_poses",
    "register",
    "registration_from_points",
]

__getattr__ = lazily(__name__, _HOMES)
