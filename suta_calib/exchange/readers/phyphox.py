"""phyphox (phones): the CSV of an experiment with the acceleration with gravity."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from suta_calib.arrays import FloatArray
from suta_calib.exchange.cells import is_plain_file, read_foreign_text
from suta_calib.exchange.felt_gravity import AccelerometerReader
from suta_calib.exchange.option import Given
from suta_calib.exchange.sheet import Sheet
from suta_calib.words import listed

_AXIS: Final = re.compile(r"(.*\S)\s+([xyz])\s+\(m/s(?:\^2|²)\)", re.IGNORECASE)


class PhyphoxReader(AccelerometerReader):
    """Times in s, and x, y, z in m/s², in any language and with any separator.

    phyphox multiplies what the phone tells by 9.81 and keeps its sign (its source,
    ExperimentSensorInput): an iPhone's points down. The folder ``meta`` of an export names the
    phone's maker.
    """

    name = "phyphox"
    summary = 'phyphox (phone): "Acceleration with g", CSV with commas, tabs or semicolons'
    example = '"Raw Data.csv" --format phyphox --postures postures.csv --out samples.csv'
    signature = re.compile(
        r"\A\"?[^\",;\t\r\n]*\(s\)\"?[,;\t][^\r\n]*\bx \(m/s(\^2|²)\)", re.IGNORECASE
    )
    without_gravity = 'record the experiment "Acceleration (with g)"'

    def columns(self, sheet: Sheet, given: Given) -> tuple[FloatArray, Sequence[int]]:
        """The time, and the one quantity that has x, y and z in m/s² with gravity."""
        del given
        axes = dict[str, dict[str, int]]()
        for k, name in enumerate(sheet.names):
            if match := _AXIS.fullmatch(name.strip()):
                axes.setdefault(match[1].lower(), {})[match[2].lower()] = k
        complete = {name: of for name, of in axes.items() if len(of) == len("xyz")}
        with_gravity = {n: of for n, of in complete.items() if "linear" not in n} or complete
        times = [k for k, name in enumerate(sheet.names) if name.strip().endswith("(s)")]
        if len(with_gravity) != 1 or not times:
            found = f"columns {listed(list(sheet.names), 8)}"
            raise sheet.refuse(found, "Time (s) and Acceleration x, y, z (m/s^2)")
        (of,) = with_gravity.values()
        return sheet.numbers(times[:1])[:, 0], [of[axis] for axis in "xyz"]

    def points_down(self, path: Path) -> tuple[bool, str]:
        """As the export's description of the device says."""
        device = path.parent / "meta" / "device.csv"
        if not is_plain_file(device):
            return super().points_down(path)
        apple = re.search(r"apple|iphone|ipad", read_foreign_text(device), re.IGNORECASE)
        sign = (
            "changed, because meta/device.csv names" if apple else "kept, as meta/device.csv names"
        )
        return apple is not None, f"The sign was {sign} {'an' if apple else 'no'} Apple device."
