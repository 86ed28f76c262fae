"""URDF: the user's own file with the calibrated origins, nothing else changed."""

from __future__ import annotations

from typing import ClassVar

from suta_calib.exchange.option import Given
from suta_calib.exchange.result import Result
from suta_calib.exchange.writer import Writer


class UrdfWriter(Writer):
    """The nominal URDF, byte for byte but for the numbers of its origins."""

    name: ClassVar[str] = "urdf"
    summary: ClassVar[str] = "the job's URDF with calibrated <origin>s, nothing else changed"
    example: ClassVar[str] = "results --format urdf --out arm.urdf"
    file: ClassVar[str] = "exported.urdf"

    def content(self, result: Result, given: Given) -> bytes:
        """The file's bytes."""
        del given
        arm = result.need_arm(self.name)
        return arm.model.calibrated_urdf(arm.values)
