"""A tool, or a target on it, that creeps while rows are measured."""

from __future__ import annotations

from typing import ClassVar

from suta_calib.trust.moved_frames import TIP, Frame, FrameInTime


class TipCreep(FrameInTime):
    """Every tip is displaced and turned ever more, along the axes of the tip, row by row."""

    name: ClassVar[str] = "tip creep"
    about: ClassVar[str] = "The tool, or what is on it, creeps row by row."
    sort: ClassVar[str] = "tip creep"
    at_once: ClassVar[bool] = False
    frame: ClassVar[Frame] = TIP
