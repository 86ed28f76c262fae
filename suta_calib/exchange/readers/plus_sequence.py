"""PLUS: sequence files (.mha, .mhd) with the transforms of every frame in their header."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.atomic import note_input
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import MOST_BYTES, is_plain_file, read_bounded
from suta_calib.exchange.imported import ImportedRows, checked_places
from suta_calib.exchange.option import Given
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.rotations import rotations_from
from suta_calib.exchange.tracked_bodies import BODY_OPTIONS, Body, Recording
from suta_calib.exchange.truncated import COMPLETE, cut_off
from suta_calib.measurements.csv_table import number_in
from suta_calib.units import from_mm

_FIELD: Final = re.compile(r"Seq_Frame(\d{1,9})_(\w+?)(Transform|TransformStatus|Timestamp)?")
_END: Final = "ElementDataFile"


class PlusSequenceReader(Reader):
    """Transforms by the names that PLUS gives them, ``ProbeToTracker``; pictures are not read."""

    name = "plus-sequence"
    summary = "PLUS sequence files .mha/.mhd: transforms of every frame"
    example = "run.mha --body StylusToTracker --reference ReferenceToTracker"
    signature = re.compile("ObjectType = Image|Seq_Frame")
    options = (*BODY_OPTIONS, COMPLETE)
    suffixes = (".mha", ".mhd")

    def read(self, path: Path, given: Given) -> ImportedRows:
        """The transform that is asked for, in m; frames in which it is not valid are left out."""
        numbers: dict[str, dict[int, tuple[int, str]]] = {}
        status: dict[str, dict[int, str]] = {}
        stamps: dict[int, str] = {}
        for line, key, value in _fields(path, given):
            match = _FIELD.fullmatch(key)
            if match is None:
                continue
            frame, name, what = int(match[1]), match[2], match[3]
            if what == "Transform":
                numbers.setdefault(name, {})[frame] = (line, value)
            elif what == "TransformStatus":
                status.setdefault(name, {})[frame] = value
            elif key.endswith("_Timestamp"):
                stamps[frame] = value
        frames = sorted({frame for by_frame in numbers.values() for frame in by_frame})
        if not frames:
            problem = "no transforms of frames in the header"
            expected = "a sequence that PLUS recorded with a tracker"
            raise ForeignFileError(problem, expected, file=path)
        bodies = {
            name: _body(path, frames, by_frame, status.get(name, {}))
            for name, by_frame in numbers.items()
        }
        time = np.array([number_in(stamps.get(frame, "")) for frame in frames])
        times = time if np.isfinite(time).all() else None
        recording = Recording(path, bodies, times, "in mm, as PLUS writes them")
        return recording.imported(self.name, given)


def _body(
    path: Path, frames: list[int], by_frame: dict[int, tuple[int, str]], status: dict[int, str]
) -> Body:
    """Sixteen numbers by rows in each frame; ``XToY`` is the pose of X in Y."""
    matrices, lines = np.full((len(frames), 16), np.nan), [1] * len(frames)
    for k, frame in enumerate(frames):
        line, text = by_frame.get(frame, (1, ""))
        lines[k] = line
        if frame not in by_frame or status.get(frame, "OK") != "OK":
            continue
        numbers = [number_in(word) for word in text.split()]
        if len(numbers) != 16 or not np.isfinite(numbers).all():
            expected = "16 finite numbers by rows"
            raise ForeignFileError(repr(text[:40]), expected, file=path, line=line)
        matrices[k] = numbers
    transforms = matrices.reshape(-1, 4, 4)
    rotation = rotations_from("rows", transforms[:, :3, :3].reshape(-1, 9), path, lines)
    return Body(checked_places(path, lines, from_mm(transforms[:, :3, 3])), rotation)


def _fields(path: Path, given: Given) -> Iterator[tuple[int, str, str]]:
    """Line, key and value of the header, which ends where the pictures begin."""
    longest = 100_000
    if not is_plain_file(path):
        read_bounded(path)  # says what it is
    note_input(path)
    read = 0
    try:
        with path.open("rb") as file:
            for number in range(1, MOST_BYTES):
                line = file.readline(longest + 1)
                read += len(line)
                if not line:
                    if COMPLETE in given:
                        return
                    raise cut_off(path, number, "the end of the file", f"a line {_END} = …")
                if len(line) > longest or read > MOST_BYTES:
                    reason = "a header without its end"
                    raise ForeignFileError(reason, f"a line {_END} = …", file=path, line=number)
                key, equals, value = line.decode("latin-1").partition("=")
                if not equals and line.strip():
                    description = repr(key.strip()[:40])
                    raise ForeignFileError(description, "key = value", file=path, line=number)
                if key.strip() == _END:
                    return
                yield number, key.strip(), value.strip()
    except OSError as problem:
        reason = f"an unreadable file ({problem.strerror})"
        raise ForeignFileError(reason, "a readable file", file=path) from None
