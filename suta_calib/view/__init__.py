"""An arm one can look at, in 3-D: in the browser, or in one file that opens offline (an extra)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.view.drawn_arm import DrawnArm as DrawnArm
    from suta_calib.view.scene import Scene as Scene

__getattr__, __all__ = public(__name__)
