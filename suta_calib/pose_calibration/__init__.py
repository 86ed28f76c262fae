"""Pivot, hand-eye and registration: the same terms over measured poses, robust.

Names are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.pose_calibration.hand_eye import HandEyeCalibration as HandEyeCalibration
    from suta_calib.pose_calibration.hand_eye import calibrate_hand_eye as calibrate_hand_eye
    from suta_calib.pose_calibration.hand_eye import hand_eye_from_pairs as hand_eye_from_pairs
    from suta_calib.pose_calibration.pivot import PivotCalibration as PivotCalibration
    from suta_calib.pose_calibration.pivot import calibrate_pivot as calibrate_pivot
    from suta_calib.pose_calibration.pivot import pivot_from_poses as pivot_from_poses
    from suta_calib.pose_calibration.registration import Registration as Registration
    from suta_calib.pose_calibration.registration import register as register
    from suta_calib.pose_calibration.registration import (
        registration_from_points as registration_from_points,
    )

__getattr__, __all__ = public(__name__)
