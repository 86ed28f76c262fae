"""A writer: the offset of each joint as CSV."""

from typing import ClassVar

import numpy as np

from suta_calib.exchange import Result, Writer
from suta_calib.exchange.option import Given
from suta_calib.exchange.result import CalibratedArm


class OffsetsCsv(Writer):
    """What is added to the reading of each joint, in degrees."""

    name: ClassVar[str] = "offsets-csv"
    summary: ClassVar[str] = "CSV with the offset of each joint in degrees"
    example: ClassVar[str] = "results --format offsets-csv --out offsets.csv"
    file: ClassVar[str] = "offsets.csv"

    def content(self, result: Result, given: Given) -> bytes:
        """``joint,offset_deg``, a row for each joint."""
        arm = result.need_arm(self.name)
        offsets = (np.degrees(arm.values.get(f"{joint}.offset", 0.0)) for joint in arm.model.joints)
        rows = zip(arm.model.joints, offsets, strict=True)
        return "\n".join(["joint,offset_deg", *(f"{j},{deg:.9g}" for j, deg in rows), ""]).encode()

    def lost(self, arm: CalibratedArm) -> list[str]:
        """Every calibrated value that is no offset of a joint."""
        return [name for name in arm.values if not name.endswith(".offset")]
