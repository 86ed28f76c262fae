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
    from suta_calib.terms.hand_eye_start import Poses as Poses
    from suta_calib.terms.hand_eye_start import close_the_loop as close_the_loop
    from suta_calib.terms.hand_eye_start import inverse_poses as inverse_poses
    from suta_calib.terms.hand_eye_start import loop_closures as loop_closures
    from suta_calib.terms.hand_eye_start import quaternion_hand_eye as quaternion_hand_eye

__getattr__, __all__ = public(__name__)
