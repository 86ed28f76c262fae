"""Sensor Logger (phones): ``TotalAcceleration.csv``, ``Gravity.csv`` and their like."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from suta_calib.arrays import FloatArray
from suta_calib.exchange.cells import is_plain_file, read_foreign_text, rows_of_text
from suta_calib.exchange.felt_gravity import DOWNWARDS, AccelerometerReader
from suta_calib.exchange.option import Given
from suta_calib.exchange.sheet import Sheet

_METADATA = "Metadata.csv"


class SensorLoggerReader(AccelerometerReader):
    """Times in ns since 1970, and z, y, x in this order.

    By the app's documentation (UNITS.md, COORDINATES.md of awesome-sensor-logger): Android writes
    the acceleration with gravity into TotalAcceleration.csv; an iPhone writes gravity into
    Gravity.csv, of the opposite sign unless "Standardise Units & Frames" is on, which
    Metadata.csv tells.
    """

    name = "sensor-logger"
    summary = "Sensor Logger (phone): TotalAcceleration.csv (Android), Gravity.csv (iPhone)"
    example = "Gravity.csv --format sensor-logger --postures postures.csv --out samples.csv"
    signature = re.compile(r"\A\"?time\"?,\"?seconds_elapsed\"?,(?=[^\r\n]*\bz\b)(?=[^\r\n]*\bx\b)")
    without_gravity = (
        "take TotalAcceleration.csv (Android) or Gravity.csv (iPhone) of the recording"
    )

    def columns(self, sheet: Sheet, given: Given) -> tuple[FloatArray, Sequence[int]]:
        """By name."""
        del given
        names = [name.lower() for name in sheet.names]
        for name in ("time", *"xyz"):
            if name not in names:
                expected = "columns time, seconds_elapsed, z, y, x"
                raise sheet.refuse(f"no column {name!r}", expected)
        return sheet.numbers([names.index("time")])[:, 0], [names.index(axis) for axis in "xyz"]

    def points_down(self, path: Path) -> tuple[bool, str]:
        """As the recording's metadata say."""
        beside = path.with_name(_METADATA)
        settings = dict[str, str]()
        if is_plain_file(beside):
            rows = rows_of_text(beside, read_foreign_text(beside), ",")
            if len(rows) > 1:
                settings = dict(
                    zip((c.lower() for c in rows[0].cells), rows[1].cells, strict=False)
                )
        platform = settings.get("platform", "").lower()
        if not platform:
            return False, (
                f"No {_METADATA} of the recording stands beside the file: the accelerations were "
                f"taken to point up at rest. For an iPhone's, give {DOWNWARDS.switch}."
            )
        standard = settings.get("standardisation", "").lower() == "true"
        down = platform == "ios" and not standard
        sign = "was changed" if down else "was kept"
        as_told = f"{platform}, standardised units {'on' if standard else 'off'}"
        return down, f"The sign {sign}, because {_METADATA} says: {as_told}."
