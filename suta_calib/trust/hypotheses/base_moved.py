"""A base, an instrument or an artefact that was moved between two rows."""

from __future__ import annotations

from typing import ClassVar

from suta_calib.trust.moved_frames import BASE, Frame, FrameInTime


class BaseMoved(FrameInTime):
    """Every tip is displaced and turned alike, along the axes of the base, from a row on."""

    name: ClassVar[str] = "base moved"
    about: ClassVar[str] = "The base, the instrument or the artefact was moved at a row."
    sort: ClassVar[str] = "base"
    at_once: ClassVar[bool] = True
    frame: ClassVar[Frame] = BASE
