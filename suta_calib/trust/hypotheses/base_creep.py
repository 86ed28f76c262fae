"""A base, an instrument or an artefact that creeps while rows are measured."""

from __future__ import annotations

from typing import ClassVar

from suta_calib.trust.moved_frames import BASE, Frame, FrameInTime


class BaseCreep(FrameInTime):
    """Every tip is displaced and turned ever more, along the axes of the base, row by row."""

    name: ClassVar[str] = "base creep"
    about: ClassVar[str] = "The base, the instrument or the artefact creeps row by row."
    sort: ClassVar[str] = "base creep"
    at_once: ClassVar[bool] = False
    frame: ClassVar[Frame] = BASE
