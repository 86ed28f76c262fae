"""Boards and their corners in pictures, and the camera they were taken with; needs OpenCV.

The extra ``vision`` installs it. Versions 4.8 to 5 are used by what they have in common.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.vision.camera_fit import CameraFit as CameraFit
    from suta_calib.vision.camera_fit import calibrate_camera as calibrate_camera
    from suta_calib.vision.camera_fit import view_poses as view_poses
    from suta_calib.vision.detection import Detection as Detection
    from suta_calib.vision.detection import DetectionOptions as DetectionOptions
    from suta_calib.vision.detection import View as View
    from suta_calib.vision.detection import detect as detect
    from suta_calib.vision.drawing import drawn as drawn
    from suta_calib.vision.pictures import PictureFile as PictureFile
    from suta_calib.vision.pictures import find_pictures as find_pictures
    from suta_calib.vision.pictures import read_picture as read_picture
    from suta_calib.vision.rendering import RenderOptions as RenderOptions
    from suta_calib.vision.rendering import rendered as rendered

__getattr__, __all__ = public(__name__)
