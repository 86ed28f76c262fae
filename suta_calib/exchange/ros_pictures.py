"""Pictures and camera_info of ROS messages, as files that `detect` and jobs read."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.recorded_rests import RecordedPicture, Rest
from suta_calib.geometry.lens import LENSES, lens_called
from suta_calib.measurements.camera import Camera
from suta_calib.optional_packages import load

IMAGE: Final = "sensor_msgs/msg/Image"
COMPRESSED: Final = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO: Final = "sensor_msgs/msg/CameraInfo"
# How the bytes of a pixel are arranged, and what OpenCV calls the way from there to blue, green,
# red; its names of Bayer patterns begin at the second row and column.
_ENCODINGS: Final[dict[str, tuple[str, int, str]]] = {
    **dict.fromkeys(("mono8", "8UC1"), ("u1", 1, "")),
    **dict.fromkeys(("bgr8", "8UC3"), ("u1", 3, "")),
    **dict.fromkeys(("mono16", "16UC1"), ("u2", 1, "")),
    "rgb8": ("u1", 3, "COLOR_RGB2BGR"),
    "rgba8": ("u1", 4, "COLOR_RGBA2BGR"),
    "bgra8": ("u1", 4, "COLOR_BGRA2BGR"),
    "bayer_rggb8": ("u1", 1, "COLOR_BayerBG2BGR"),
    "bayer_bggr8": ("u1", 1, "COLOR_BayerRG2BGR"),
    "bayer_gbrg8": ("u1", 1, "COLOR_BayerGR2BGR"),
    "bayer_grbg8": ("u1", 1, "COLOR_BayerGB2BGR"),
    **dict.fromkeys(("yuv422", "uyvy"), ("u1", 2, "COLOR_YUV2BGR_UYVY")),
    **dict.fromkeys(("yuv422_yuy2", "yuyv"), ("u1", 2, "COLOR_YUV2BGR_YUY2")),
}
# First bytes of compressed pictures, and the suffix of their files.
_MAGIC: Final = {b"\xff\xd8\xff": ".jpg", b"\x89PNG\r\n\x1a\n": ".png"}


def picture_of(path: Path, topic: str, message: Any) -> RecordedPicture:
    """A message's picture: a compressed one as it is, any other as PNG."""
    if not hasattr(message, "encoding"):
        data = bytes(message.data)
        suffix = next((s for magic, s in _MAGIC.items() if data.startswith(magic)), None)
        if suffix is None:
            problem = f"a picture of {topic} compressed as {message.format!r}"
            raise ForeignFileError(problem, "JPEG or PNG", file=path)
        return RecordedPicture(suffix, data)
    cv2 = load("cv2", "vision")
    pixels = _pixels(path, topic, message)
    code = _ENCODINGS[message.encoding][2]
    coloured = cv2.cvtColor(pixels, getattr(cv2, code)) if code else pixels
    return RecordedPicture(".png", cv2.imencode(".png", coloured)[1].tobytes())


def _pixels(path: Path, topic: str, message: Any) -> NDArray[Any]:
    """The array (height, width) or (height, width, channels) of a message."""
    if message.encoding not in _ENCODINGS:
        problem = f"a picture of {topic} in the encoding {message.encoding!r}"
        raise ForeignFileError(problem, f"one of {', '.join(_ENCODINGS)}", file=path)
    kind, channels, _ = _ENCODINGS[message.encoding]
    height, width, step = int(message.height), int(message.width), int(message.step)
    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    row = width * channels * dtype.itemsize
    data = np.asarray(message.data, dtype=np.uint8)
    # More than any sensor has, px.
    most_pixels = 400_000_000
    if not (0 < row <= step and 0 < height * width <= most_pixels and len(data) >= height * step):
        problem = f"a picture of {topic} of {width} x {height} in {len(data)} bytes, {step} a row"
        raise ForeignFileError(problem, "the number of bytes that belongs to its size", file=path)
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, :row])
    pixels = rows.view(dtype).astype(np.dtype(kind), copy=False)
    return pixels if channels == 1 else pixels.reshape(height, width, channels)


def pictures_at(
    path: Path, topic: str, rests: Sequence[Rest], messages: Iterable[tuple[float, Any]]
) -> list[RecordedPicture | None]:
    """The picture nearest to the middle of each rest; None where none was taken during it.

    Rests are in order; messages have their time, s, and come in the order of the recording.
    """
    best: dict[int, tuple[float, Any]] = {}
    pictures: list[RecordedPicture | None] = [None] * len(rests)
    total, first = 0, 0
    # Of all pictures of a recording together; more would not be held at once.
    most_bytes = 1_000_000_000
    # Messages come a little out of order, s.
    late = 2.0
    for at, message in chain(messages, [(np.inf, None)]):
        while first < len(rests) and rests[first].end < at - late:
            if first in best:
                picture = pictures[first] = picture_of(path, topic, best.pop(first)[1])
                total += len(picture.data)
            first += 1
        if total > most_bytes:
            problem = f"pictures of more than {most_bytes / 1e6:.0f} MB"
            raise ForeignFileError(problem, "a shorter recording", file=path)
        for k, rest in enumerate(rests[first:], first):
            if rest.begin > at:
                break
            off = abs(at - (rest.begin + rest.end) / 2)
            if at <= rest.end and (k not in best or off < best[k][0]):
                best[k] = off, message
    return pictures


def camera_of(message: Any) -> tuple[Camera | None, str]:
    """The camera that a CameraInfo tells of, or None and why it tells of none."""
    # ROS 1 has capitals.
    matrix, distortion = (
        np.asarray(getattr(message, name, getattr(message, name.upper(), ())), dtype=float)
        for name in ("k", "d")
    )
    fx, fy = (matrix[0], matrix[4]) if len(matrix) == 9 else (0.0, 0.0)
    if not (np.isfinite(matrix).all() and fx > 0 and fy > 0):
        return None, "it is of a camera that was not calibrated"
    lens = lens_called(message.distortion_model)
    if lens is None or len(distortion) > len(lens.distortion):
        lens_names = ", ".join(LENSES)
        model = f"{message.distortion_model} with {len(distortion)} coefficients"
        return None, f"its distortion model is {model}, none of {lens_names}"
    if not np.isfinite(distortion).all():
        return None, "its distortion is not a number"
    coefficients = np.zeros(len(lens.distortion))
    coefficients[: len(distortion)] = distortion
    intrinsics = np.array([fx, fy, matrix[2], matrix[5], *coefficients])
    return Camera(int(message.width), int(message.height), intrinsics, lens=lens), ""
