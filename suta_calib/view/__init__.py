"""An arm one can look at, in 3-D: in the browser, or in one file that opens offline (an extra)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.view.calibrated import Calibrated as Calibrated
    from suta_calib.view.calibration import calibration_page as calibration_page
    from suta_calib.view.calibration import calibration_scene as calibration_scene
    from suta_calib.view.calibration import show as show
    from suta_calib.view.drawn_arm import DrawnArm as DrawnArm
    from suta_calib.view.scene import Scene as Scene
    from suta_calib.view.server import Viewer as Viewer

__getattr__, __all__ = public(__name__)
