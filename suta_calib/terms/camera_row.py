"""What a row of a job says of a camera that sees a board: its keys, its files, and its noise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from suta_calib.measurements import YamlSection, read_board, read_camera
from suta_calib.measurements.keys import Key
from suta_calib.terms.block import Noise
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EYE_TO_HAND

CAMERA_KEYS: Final = (
    Key("corners", "file", "Where the corners are in the pictures: corners.csv.", True),
    Key("board", "file", "The board.yaml.", True),
    Key("camera", "file", "The camera.yaml; without it the camera is estimated from nothing."),
    Key("setup", "text", "eye-in-hand (the default), or eye-to-hand: the board on the tip."),
    Key(
        "intrinsics",
        "text",
        "fixed (the default beside a camera), or free: the camera is estimated too.",
    ),
    Key("target", "text", "Tells several boards apart."),
    Key("sigma_px", "px", "Standard deviation of a corner's coordinate."),
    Key("huber_px", "px", "Corners farther off are believed less."),
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
    found: dict[str, Any] = {"board": read_board(row.existing_file("board"))}
    if "camera" in row:
        found["camera"] = read_camera(row.existing_file("camera"))
    if "corners" in row:
        found["corners"] = row.existing_file("corners")
    found["setup"] = row.choice("setup", (EYE_IN_HAND, EYE_TO_HAND), EYE_IN_HAND)
    known = "fixed" if "camera" in row else "free"
    found["free"] = row.choice("intrinsics", ("fixed", "free"), known) == "free"
    if not found["free"] and "camera" not in row:
        hint = "name the camera's file, or set intrinsics: free"
        raise row.refuse("no camera for intrinsics: fixed", at=("camera",), hint=hint)
    found["target"] = row.text("target", default="default")
    sigma = row.optional_number("sigma_px", "positive")
    huber = row.optional_number("huber_px", "positive")
    fixed = sigma is not None and row.flag("fixed")
    found["noise"] = Noise(sigma, np.inf if huber is None else huber, fixed)
    return found
