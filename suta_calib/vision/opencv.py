"""OpenCV, loaded when it is needed, and what its versions have in common."""

from __future__ import annotations

import os
from functools import cache
from typing import Any, Final

from suta_calib.errors import BoardError, MissingExtraError, did_you_mean
from suta_calib.optional_packages import load

# No camera has as many; a compressed file of a few kilobytes may claim more, and fill the memory.
MOST_PIXELS: Final = 2**28
_PREFIX: Final = "DICT_"


@cache
def opencv() -> Any:
    """The module ``cv2``.

    Raises:
        MissingExtraError: it is not installed, or cannot be loaded.
    """
    # Read by OpenCV when it is loaded.
    os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(MOST_PIXELS))
    try:
        cv2 = load("cv2", "vision")
    except ImportError as problem:
        raise MissingExtraError(
            f"the Python package 'cv2' is installed but cannot be loaded ({problem}); install "
            "the version without windows instead: pip install opencv-python-headless"
        ) from None
    if not hasattr(getattr(cv2, "aruco", None), "ArucoDetector"):
        raise MissingExtraError(
            f"found OpenCV {cv2.__version__}; expected 4.8 or later; install it with: "
            "pip install -U 'suta_calib[vision]'"
        )
    return cv2


def open_video(source: str) -> Any:
    """A camera of this computer by its number, or what else OpenCV reads as a video; None if none.

    Raises:
        MissingExtraError: OpenCV is not installed, or cannot be loaded.
    """
    cv2 = opencv()
    # Of a camera that is not there we say ourselves what is wrong.
    logging = cv2.utils.logging
    level = logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        capture = cv2.VideoCapture(int(source) if source.isdigit() else source)
    finally:
        logging.setLogLevel(level)
    return capture if capture.isOpened() else None


def marker_dictionaries() -> list[str]:
    """Names of all dictionaries of ArUco markers and AprilTags, small ones first."""
    names = [name for name in dir(opencv().aruco) if name.startswith(_PREFIX)]
    # AprilTag's are there in two spellings.
    return sorted({name.replace("APRILTAG_36H", "APRILTAG_36h") for name in names}, key=_size)


def _size(name: str) -> tuple[int, str]:
    return len(marker_dictionary(name).bytesList), name


@cache
def marker_dictionary(name: str) -> Any:
    """A dictionary of markers by OpenCV's name of it.

    Raises:
        BoardError: there is none of this name.
    """
    aruco = opencv().aruco
    names = [attribute for attribute in dir(aruco) if attribute.startswith(_PREFIX)]
    spelled = {spelling.lower(): spelling for spelling in names}.get(name.lower(), name)
    if spelled not in names:
        raise BoardError(
            repr(name),
            "OpenCV's name of a dictionary, such as DICT_5X5_1000 or DICT_APRILTAG_36h11",
            where="dictionary",
            hint=did_you_mean(name, names),
        )
    return aruco.getPredefinedDictionary(getattr(aruco, spelled))
