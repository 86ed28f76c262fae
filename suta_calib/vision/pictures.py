"""Finds and reads files of pictures."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.errors import InputError, OutputError
from suta_calib.inputs import read_input
from suta_calib.vision.opencv import MOST_PIXELS, opencv

Grey = NDArray[np.uint8]
# Only these are read from a folder; a file that is named is read with any suffix.
SUFFIXES: Final = frozenset(
    {*(".png", ".jpg", ".jpeg", ".bmp", ".dib", ".tif", ".tiff", ".webp", ".jp2")}
    | {*(".pbm", ".pgm", ".ppm", ".pnm", ".sr", ".ras")}
)


class UnusablePictureError(InputError):
    """A picture that has to be left out; ``found`` says why."""


@dataclass(frozen=True)
class PictureFile:
    """A picture's file.

    Attributes:
        name: in ``corners.csv`` and in tables.
        path: of the file.
    """

    name: str
    path: Path


def save_picture(folder: Path, picture: NDArray[np.uint8]) -> Path:
    """Write a picture as the next one of a folder; its file, which is whole once it is there.

    The folder is made with the first one. Nothing there is overwritten.

    Raises:
        OutputError: it cannot be written.
    """
    encoded, png = opencv().imencode(".png", picture)
    assert encoded
    try:
        folder.mkdir(parents=True, exist_ok=True)
        names = (folder / f"{number:03}.png" for number in count())
        path = next(name for name in names if not name.exists())
        part = path.with_suffix(".part")
        part.write_bytes(png.tobytes())
        part.rename(path)
    except OSError as error:
        raise OutputError(f"{folder}: picture not written: {error.strerror}") from error
    return path


def find_pictures(paths: Iterable[str | Path]) -> list[PictureFile]:
    """Pictures that are named, or in folders that are, in order; each file once.

    A picture is called as its file. Where two have one name, as ``left/01.png`` and
    ``right/01.png``, all are called by their paths below the folder that they share.

    Raises:
        InputError: there is no such file or folder, or no picture in a folder.
    """
    by_place: dict[Path, Path] = {}
    for path in map(Path, paths):
        for file in _pictures_in(path) if path.is_dir() else [path]:
            if not file.is_file():
                raise InputError("no such file", "a picture, or a folder of pictures", file=file)
            by_place.setdefault(file.resolve(), file)
    files = list(by_place.values())
    if any(count > 1 for count in Counter(file.name for file in files).values()):
        # Not resolved: a link's name is what its owner calls it.
        absolute = [Path(os.path.abspath(file)) for file in files]  # noqa: PTH100
        shared = Path(os.path.commonpath([file.parent for file in absolute]))
        names = [file.relative_to(shared).as_posix() for file in absolute]
    else:
        names = [file.name for file in files]
    return [PictureFile(name, file) for name, file in zip(names, files, strict=True)]


def _pictures_in(folder: Path) -> list[Path]:
    try:
        inside = sorted(folder.iterdir())
    except OSError as problem:
        raise InputError(
            f"an unreadable folder ({problem.strerror})", "a folder of pictures", file=folder
        ) from None
    files = [f for f in inside if f.suffix.lower() in SUFFIXES and not f.name.startswith(".")]
    if not files:
        below = [f.name for f in inside if f.is_dir()]
        raise InputError(
            f"a folder without pictures ({len(inside)} other files or folders)",
            "files such as .png, .jpg or .tif",
            file=folder,
            hint=f"give a folder inside it, such as {below[0]}" if below else "",
        )
    return files


def read_picture(path: Path) -> Grey:
    """A picture's greys (height, width), 8 bits, as the sensor has them: not turned by EXIF.

    Raises:
        UnusablePictureError: not readable, not a picture, cut off, or too large.
    """
    # Of a compressed file; the largest sensors' raw pictures have a few hundred megabytes.
    most_bytes = 2**30
    cv2 = opencv()
    try:
        if (size := path.stat().st_size) > most_bytes:
            raise UnusablePictureError(f"a file of {size:,} bytes", f"at most {most_bytes:,}")
        data = read_input(path, most_bytes)
    except OSError as problem:
        raise UnusablePictureError(f"an unreadable file ({problem.strerror})") from None
    if not data:
        raise UnusablePictureError("an empty file")
    how = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), how)
    except (cv2.error, MemoryError):
        raise UnusablePictureError(
            "a picture that cannot be decompressed", f"at most {MOST_PIXELS:,} pixels"
        ) from None
    if picture is None:
        raise UnusablePictureError("not a picture, or an incomplete one")
    return _eight_bits(np.asarray(picture))


def _eight_bits(picture: NDArray[Any]) -> Grey:
    """Eight bits of a picture that may have more.

    A sensor of 10 or 12 bits leaves the upper ones of 16 empty: the eight that count begin with the
    highest that more than a few bright pixels use. Of fractions the lightest grey is 255.
    """
    if picture.dtype == np.uint8:
        return picture
    # Per cent of the pixels that are no brighter than what is white; the others shine.
    light = float(np.nanpercentile(picture, 99.9))
    if np.issubdtype(picture.dtype, np.integer):
        scale = 2.0 ** -max(int(light).bit_length() - 8, 0)
    else:
        scale = 255.0 / light if light > 0.0 else 0.0
    scaled = np.nan_to_num(picture.astype(float) * scale)
    return np.clip(np.round(scaled), 0, 255).astype(np.uint8)
