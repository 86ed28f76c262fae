"""A picture for each rest of the arm, from a camera that this computer has."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import count
from pathlib import Path
from typing import Final

from suta_calib.errors import DeviceError, InputError, OutputError
from suta_calib.vision.opencv import open_video, opencv

# Label of the samples that names the picture.
IMAGE: Final = "image"
FOLDER: Final = "pictures"
Seen = Callable[[], Mapping[str, str]]


class RestPictures:
    """Takes a picture when a sample is confirmed, and gives the label that names it.

    Args:
        source: number of a camera of this computer, or what OpenCV opens else: a URL, a video, or
            numbered pictures (``%02d.png``), which are taken one after the other.
        folder: of the pictures; made with the first one. Nothing there is overwritten.

    Raises:
        InputError: nothing opens there.
        MissingExtraError: OpenCV is not installed.
    """

    def __init__(self, source: str, folder: Path) -> None:
        self._source, self._folder = source, folder
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
            OutputError: it cannot be written.
        """
        for _ in range(self._waiting):
            self._capture.grab()
        taken, picture = self._capture.read()
        if not taken:
            raise DeviceError(f"found no picture from the camera {self._source}; is it connected?")
        self._folder.mkdir(parents=True, exist_ok=True)
        files = (self._folder / f"{number:03}.png" for number in count())
        file = next(path for path in files if not path.exists())
        if not opencv().imwrite(str(file), picture):
            raise OutputError(f"{file}: not written")
        return {IMAGE: file.name}

    def close(self) -> None:
        """Let others have the camera."""
        self._capture.release()


def nothing_seen() -> Mapping[str, str]:
    """Of a run without a camera."""
    return {}
