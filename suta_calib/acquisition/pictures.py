"""A picture for each rest of the arm, from a camera that this computer has."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib import vision
from suta_calib.arrays import FloatArray
from suta_calib.errors import DeviceError, InputError
from suta_calib.job.outline import read_outline
from suta_calib.measurements import corners_of, read_board, read_text, write_text
from suta_calib.measurements.board import Board
from suta_calib.measurements.corners import corners_text
from suta_calib.units import deg, from_deg
from suta_calib.vision.opencv import open_video
from suta_calib.vision.pictures import save_picture

# Label of the samples that names the picture.
IMAGE: Final = "image"
FOLDER: Final = "pictures"
Seen = Callable[[], Mapping[str, str]]


class NothingSeenError(InputError):
    """A picture that does not show what was sought: its rest is no sample."""


@dataclass(frozen=True)
class SoughtBoard:
    """A board that a job's camera sees, and the file for its corners."""

    board: Board
    corners: Path

    @classmethod
    def of(cls, job: Path, name: str) -> SoughtBoard | None:
        """That of the job's row with samples in the folder of a camera; None without such a row.

        Raises:
            JobError, BoardError: the job or the board cannot be read.
        """
        for row in read_outline(job).rows:
            if {"corners", "board"} <= row.section.data.keys() and any(
                Path(pattern).parent == Path(name) for pattern in row.samples
            ):
                board = read_board(row.section.existing_file("board"))
                return cls(board, job.parent / row.section.text("corners"))
        return None

    def add(self, image: str, picture: vision.Grey) -> int:
        """Find the board in a picture, and add its corners to the file; how many they are.

        Raises:
            NothingSeenError: it is not there.
            OutputError: they cannot be written.
        """
        try:
            found = vision.finder_of(self.board).find(picture)
        except vision.NotSeenError as problem:
            raise NothingSeenError(problem.found, problem.expected) from None
        names = [image] * len(found.point)
        header, _, rows = corners_text(corners_of(names, found.point, found.pixel)).partition("\n")
        before = read_text(self.corners) if self.corners.exists() else header
        write_text(self.corners, f"{before.rstrip()}\n{rows}")
        return len(names)


class RestPictures:
    """Takes a picture when a sample is confirmed, and gives the label that names it.

    Args:
        source: number of a camera of this computer, or what OpenCV opens else: a URL, a video, or
            numbered pictures (``%02d.png``), which are taken one after the other.
        folder: of the pictures; made with the first one. Nothing there is overwritten.
        sought: a board that must be in each picture; pictures without it are not kept.

    Raises:
        InputError: nothing opens there.
        MissingExtraError: OpenCV is not installed.
    """

    def __init__(self, source: str, folder: Path, sought: SoughtBoard | None = None) -> None:
        self._source, self._folder, self._sought = source, folder, sought
        self._capture = open_video(source)
        if self._capture is None:
            expected = "the number of a camera of this computer (0, 1, …), or a URL"
            raise InputError(f"no camera {source!r}", expected, where="--camera")
        # What a camera has waiting was seen before the arm came to rest.
        self._waiting = 4 if source.isdigit() or "://" in source else 0

    def __call__(self) -> Mapping[str, str]:
        """Take a picture; the label of its sample.

        Raises:
            DeviceError: the camera gives none.
            NothingSeenError: the board is not in it.
            OutputError: it cannot be written.
        """
        for _ in range(self._waiting):
            self._capture.grab()
        taken, picture = self._capture.read()
        if not taken:
            raise DeviceError(f"found no picture from the camera {self._source}; is it connected?")
        file = save_picture(self._folder, picture)
        if self._sought is not None:
            try:
                self._sought.add(file.name, vision.read_picture(file))
            except NothingSeenError:
                file.unlink()
                raise
        return {IMAGE: file.name}

    def close(self) -> None:
        """Let others have the camera."""
        self._capture.release()


def narrow_postures(joints: Sequence[str], angles: Sequence[FloatArray]) -> str:
    """Which joints (n,) moved little over pictures, rad, and what that costs; empty if none did."""
    # Of hobby arms with play, a camera's place was surer by a quarter with twice the motion.
    least = from_deg(60.0)
    if len(angles) < 2:
        return ""
    turned = np.ptp(np.unwrap(np.array(angles), axis=0), axis=0)
    narrow = [f"{j} {deg(a):.0f}" for j, a in zip(joints, turned, strict=True) if a < least]
    if not narrow:
        return ""
    return (
        f"over all pictures, some joints moved by less than {deg(least):.0f} deg: "
        f"{', '.join(narrow)}. The farther they move, the surer is the camera's place"
    )


def nothing_seen() -> Mapping[str, str]:
    """Of a run without a camera."""
    return {}
