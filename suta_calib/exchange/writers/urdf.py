"""URDF: the user's own file with the calibrated origins, nothing else changed."""

from __future__ import annotations

from suta_calib.exchange.option import Given
from suta_calib.exchange.result import Result
from suta_calib.exchange.writer import Writer


class UrdfWriter(Writer):
    """The nominal URDF, byte for byte but for the numbers of its origins."""

    name = "urdf"
    summary = "the job's URDF with calibrated <origin>s; nothing else is changed"
    example = "results --format urdf --out arm.urdf"
    file = "exported.urdf"

    def content(self, result: Result, _given: Given) -> bytes:
        """The file's bytes."""
        arm = result.need_arm(self.name)
        return arm.model.calibrated_urdf(arm.values)
