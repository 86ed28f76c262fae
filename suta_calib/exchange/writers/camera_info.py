"""``camera_info`` YAML of ROS, which OpenCV's ``FileStorage`` reads too."""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import InputError
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.result import Result
from suta_calib.exchange.writer import Writer
from suta_calib.measurements.camera import camera_text, matrix_text

NAME: Final = Option("camera_name", "Name of the camera.", "NAME")


class CameraInfoWriter(Writer):
    """The camera's intrinsics as ROS's camera_info_manager has them."""

    name = "camera-info"
    summary = "camera_info YAML of ROS, which OpenCV can also read"
    example = "results --format camera-info --out camera.yaml"
    options = (NAME,)
    file = "exported_camera.yaml"

    def content(self, result: Result, given: Given) -> bytes:
        """`camera.yaml`, with the matrices of a camera that is not rectified."""
        if result.camera is None:
            problem = f"no camera, which the format {self.name} needs"
            raise InputError(problem, "the result of a job with a camera", file=result.path)
        name = given.text(NAME, "camera")
        if not name.replace("_", "").replace("/", "").isalnum():
            raise given.refuse(NAME, repr(name), "letters, digits, _ and /")
        camera = result.camera
        projection: FloatArray = np.hstack([camera.matrix, np.zeros((3, 1))])
        # OpenCV's FileStorage asks for the first line; YAML readers take it in this spelling.
        return (
            f"%YAML 1.0\n---\ncamera_name: {name}\n{camera_text(camera)}"
            f"rectification_matrix: {matrix_text(np.eye(3))}\n"
            f"projection_matrix: {matrix_text(projection)}\n"
        ).encode()
