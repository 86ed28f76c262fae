"""A tool, or a target on it, that was moved between two rows."""

from __future__ import annotations

from typing import ClassVar

from suta_calib.trust.moved_frames import TIP, Frame, FrameInTime


class TipMoved(FrameInTime):
    """Every tip is displaced and turned alike, along the axes of the tip, from a row on."""

    name: ClassVar[str] = "tip moved"
    about: ClassVar[str] = "The tool, or what is on it, was moved at a row."
    sort: ClassVar[str] = "tip"
    at_once: ClassVar[bool] = True
    frame: ClassVar[Frame] = TIP
