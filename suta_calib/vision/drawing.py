"""Pictures with what was found in them drawn in, for people to look at."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from suta_calib.measurements.board import Chessboard
from suta_calib.vision.opencv import opencv
from suta_calib.vision.pictures import Grey, UnusablePictureError, read_picture

if TYPE_CHECKING:
    from suta_calib.vision.detection import Detection, SearchedPicture
    from suta_calib.vision.finder import DetectedBoard

# Blue, green, red: the orange and blue of the plots, told apart by colour-blind people.
_CORNER: Final = (0, 159, 230)
_LINE: Final = (178, 114, 0)
_BLACK, _WHITE = (0, 0, 0), (255, 255, 255)


def drawn(view: SearchedPicture, detection: Detection) -> bytes:
    """A JPEG of a picture with the corners in it, or with why it is left out."""
    cv2 = opencv()
    try:
        grey = read_picture(view.picture.path)
    except UnusablePictureError:
        grey = np.full((240, 640), 90, dtype=np.uint8)
    # Largest side of a drawing, px.
    scale = min(1.0, 1280 / max(grey.shape))
    size = tuple(max(round(n * scale), 1) for n in grey.shape[::-1])
    canvas = cv2.cvtColor(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), cv2.COLOR_GRAY2BGR)
    if view.board is not None:
        _corners(canvas, (view.board.pixel + 0.5) * scale - 0.5, view.board.point, detection)
        caption = f"{view.picture.name}: {len(view.board.point)} corners"
        if view.rms is not None:
            caption += f", RMS {view.rms:.3f} px"
    else:
        caption = f"{view.picture.name}: left out: {view.reason}"
    plain = caption.encode("ascii", "replace").decode()
    for colour, width in ((_BLACK, 4), (_WHITE, 1)):
        cv2.putText(canvas, plain, (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.55, colour, width)
    return bytes(cv2.imencode(".jpg", canvas, [cv2.IMWRITE_JPEG_QUALITY, 85])[1])


def live_drawing(grey: Grey, board: DetectedBoard | None) -> bytes:
    """A small JPEG of a picture with the corners that are found in it."""
    cv2 = opencv()
    scale = min(1.0, 960 / max(grey.shape))
    size = tuple(max(round(n * scale), 1) for n in grey.shape[::-1])
    canvas = cv2.cvtColor(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), cv2.COLOR_GRAY2BGR)
    for u, v in () if board is None else np.round(board.pixel * scale * 16).astype(int).tolist():
        cv2.circle(canvas, (u, v), 5 * 16, _CORNER, 2, cv2.LINE_AA, 4)
    return bytes(cv2.imencode(".jpg", canvas, [cv2.IMWRITE_JPEG_QUALITY, 75])[1])


def _corners(canvas: Any, pixel: Any, point: Any, detection: Detection) -> None:
    """Rings around the corners, a line through them by number, the first ones' numbers."""
    # Corners that are numbered, so that one sees where numbers begin and which way they go
    numbered = 4
    cv2 = opencv()
    # Sixteenths of a pixel are what OpenCV draws to.
    fine = np.round(pixel * 16).astype(np.int32)
    if isinstance(detection.board, Chessboard):
        cv2.polylines(canvas, [fine.reshape(-1, 1, 2)], False, _LINE, 1, cv2.LINE_AA, 4)
    for u, v in fine.tolist():
        cv2.circle(canvas, (u, v), 4 * 16, _CORNER, 1, cv2.LINE_AA, 4)
    for number, (u, v) in zip(point[:numbered].tolist(), pixel[:numbered].tolist(), strict=True):
        at = (round(u) + 5, round(v) - 5)
        for colour, width in ((_BLACK, 3), (_WHITE, 1)):
            cv2.putText(canvas, str(number), at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, width)
