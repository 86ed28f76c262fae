"""What a row of a job says of a camera that sees a board: its keys, its files, and its noise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from suta_calib.measurements import YamlSection, read_board, read_camera
from suta_calib.measurements.fields import FILE, TEXT, Field, Fields, Value, choice, quantity
from suta_calib.terms.block import Noise
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EYE_TO_HAND

CAMERA_KEYS: Final = (
    Field("corners", FILE, "Where the corners are in the pictures: corners.csv.", True),
    Field(
        "board",
        Value("file", lambda row, key: read_board(row.existing_file(key))),
        "The board.yaml.",
        required=True,
    ),
    Field(
        "camera",
        Value("file", lambda row, key: read_camera(row.existing_file(key))),
        "The camera.yaml; without it the camera is estimated from nothing.",
    ),
    Field(
        "setup",
        choice((EYE_IN_HAND, EYE_TO_HAND)),
        "eye-in-hand (the default), or eye-to-hand: the board on the tip.",
    ),
    Field(
        "intrinsics",
        choice(("fixed", "free")),
        "fixed (the default beside a camera), or free: the camera is estimated too.",
    ),
    Field("target", TEXT, "Tells several boards apart."),
    Field("sigma_px", quantity("px", "positive"), "Standard deviation of a corner's coordinate."),
    Field("huber_px", quantity("px", "positive"), "Corners farther off are believed less."),
)
# What such a row may name, as they look.
CAMERA_FILES: Final[Mapping[str, str]] = {
    "corners.csv": "image,point,u,v\n",
    "board.yaml": "# Inner corners: columns, rows. Other types: charuco, markers.\n"
    "type: chessboard\ncorners: [7, 5]\nsquare_mm: 30\n",
    "camera.yaml": "# As ROS or OpenCV calibrated it.\nimage_width: 1280\nimage_height: 960\n"
    "camera_matrix: {rows: 3, cols: 3, data: [1000, 0, 639.5, 0, 1000, 479.5, 0, 0, 1]}\n"
    "distortion_model: plumb_bob\n"
    "distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n",
}


def read_camera_row(row: YamlSection) -> dict[str, Any]:
    """Board, camera, where it is, and the noise in pixels; the corners' file as it is named.

    Raises:
        InputError: a file or a value that cannot be used.
    """
    settings = {"setup": EYE_IN_HAND, "target": "default", **Fields(*CAMERA_KEYS).values(row)}
    intrinsics = settings.pop("intrinsics", "fixed" if "camera" in row else "free")
    settings["free"] = intrinsics == "free"
    if not settings["free"] and "camera" not in row:
        hint = "name the camera's file, or set intrinsics: free"
        raise row.refuse("no camera for intrinsics: fixed", at=("camera",), hint=hint)
    sigma, huber = settings.pop("sigma", None), settings.pop("huber", np.inf)
    fixed = sigma is not None and row.flag("fixed")
    settings["noise"] = Noise(sigma, huber, fixed)
    return settings
