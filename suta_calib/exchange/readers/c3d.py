"""C3D: markers of motion capture."""

from __future__ import annotations

import warnings
from io import BytesIO
from pathlib import Path

import numpy as np

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import LENGTH_UNITS, read_bounded
from suta_calib.exchange.imported import ImportedRows, checked_places
from suta_calib.exchange.option import Given
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.tracked_bodies import BODY_OPTIONS, Body, Recording
from suta_calib.exchange.truncated import COMPLETE, check_count
from suta_calib.optional_packages import load


class C3dReader(Reader):
    """Every marker is a point; frames in which it was not seen are left out."""

    name = "c3d"
    summary = "C3D of motion capture systems: markers by name"
    example = "trial.c3d --body probe --out points.csv"
    options = (*BODY_OPTIONS, COMPLETE)
    suffixes = (".c3d",)
    extra = "formats"

    def recognises(self, path: Path, head: str) -> bool:
        """Its suffix says so."""
        del path, head
        return True

    def read(self, path: Path, given: Given) -> ImportedRows:
        """The positions of one marker, or of several in a column ``target``."""
        data, c3d = read_bounded(path), load("c3d", self.extra)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                reader = c3d.Reader(BytesIO(data))
                names = [str(label).strip() for label in reader.point_labels]
                unit_of = reader.get("POINT:UNITS")
                unit = unit_of.string_value.strip().lower() if unit_of is not None else "mm"
                rate = float(reader.point_rate)
                frames = [(k, points[:, :4]) for k, points, _ in reader.read_frames()]
                points = np.array([p for _, p in frames], float).reshape(len(frames), -1, 4)
                stated = int(reader.last_frame) - int(reader.first_frame) + 1
        except Exception as error:  # noqa: BLE001 - whatever a broken file makes it raise
            reason = f"a file that cannot be read ({type(error).__name__})"
            raise ForeignFileError(reason, "a C3D file", file=path) from None
        check_count(path, len(frames), stated, "frames", given)
        if not points.size or len(names) < points.shape[1]:
            raise ForeignFileError("no named markers", "some", file=path)
        if unit not in LENGTH_UNITS:
            expected = ", ".join(LENGTH_UNITS)
            raise ForeignFileError(f"lengths in {unit!r}", expected, file=path, where="POINT:UNITS")
        # A negative residual says that the marker was not seen.
        points[points[:, :, 3] < 0] = np.nan
        position = LENGTH_UNITS[unit] * points[:, :, :3]
        lines = [k for k, _ in frames]
        bodies = {
            name: Body(checked_places(path, lines, position[:, k]))
            for k, name in enumerate(names[: points.shape[1]])
        }
        time = np.array(lines) / rate if rate > 0 else None
        recording = Recording(path, bodies, time, f"in {unit}, as the file states")
        return recording.imported(self.name, given)
