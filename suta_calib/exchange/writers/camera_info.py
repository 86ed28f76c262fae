"""A camera as ROS, OpenCV and kalibr read it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import InputError
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.result import Result
from suta_calib.exchange.writer import Writer
from suta_calib.geometry.lens import EQUIDISTANT, PLUMB_BOB
from suta_calib.measurements.camera import Camera, camera_text, matrix_text
from suta_calib.measurements.yaml_text import yaml_text

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
        label, camera = next(iter(result.need_cameras(self.name).items()))
        name = given.text(NAME, _ros_name(label))
        if not name.replace("_", "").replace("/", "").isalnum():
            raise given.refuse(NAME, repr(name), "letters, digits, _ and /")
        return _camera_info(name, camera)

    def more(self, result: Result, given: Given) -> Mapping[str, bytes]:
        """A file for every other camera."""
        del given
        return {
            label: _camera_info(_ros_name(label), camera)
            for label, camera in [*result.cameras.items()][1:]
        }


def _ros_name(label: str) -> str:
    """A label as ROS allows names."""
    return "camera" if label == "default" else re.sub(r"\W", "_", label)


def _camera_info(name: str, camera: Camera) -> bytes:
    projection: FloatArray = np.hstack([camera.matrix, np.zeros((3, 1))])
    # OpenCV's FileStorage asks for the first line; YAML readers take it in this spelling.
    return (
        f"%YAML 1.0\n---\ncamera_name: {name}\n{camera_text(camera)}"
        f"rectification_matrix: {matrix_text(np.eye(3))}\n"
        f"projection_matrix: {matrix_text(projection)}\n"
    ).encode()


class OpencvCameraWriter(Writer):
    """The camera's intrinsics as ``cv::FileStorage`` has them."""

    name = "opencv-camera"
    summary = "camera as OpenCV's FileStorage (YAML)"
    example = "results --format opencv-camera --out camera.yaml"
    file = "exported_opencv_camera.yaml"

    def content(self, result: Result, given: Given) -> bytes:
        """Size, matrix, and the coefficients; and their model, for which OpenCV has no key."""
        del given
        return _file_storage(next(iter(result.need_cameras(self.name).values())))

    def more(self, result: Result, given: Given) -> Mapping[str, bytes]:
        """A file for every other camera."""
        del given
        return {label: _file_storage(camera) for label, camera in [*result.cameras.items()][1:]}


def _file_storage(camera: Camera) -> bytes:
    return (
        "%YAML:1.0\n---\n"
        f"image_width: {camera.width}\nimage_height: {camera.height}\n"
        f"distortion_model: {camera.lens.name}\n"
        f"camera_matrix: {_storage(camera.matrix)}"
        f"distortion_coefficients: {_storage(camera.intrinsics[4:, None])}"
    ).encode()


class KalibrWriter(Writer):
    """The camera's intrinsics as a camchain of kalibr has them."""

    name = "kalibr"
    summary = "cameras as a camchain.yaml of kalibr (pinhole with radtan or equidistant)"
    example = "results --format kalibr --camera-name cam0 --out camchain.yaml"
    options = (NAME,)
    file = "exported_camchain.yaml"

    def content(self, result: Result, given: Given) -> bytes:
        """Every camera; its radtan has no k3, so that a lens with one is refused."""
        cameras = result.need_cameras(self.name)
        names = [f"cam{k}" for k in range(len(cameras))]
        if name := given.text(NAME, ""):
            if len(cameras) > 1:
                raise given.refuse(NAME, f"a name for {len(cameras)} cameras", ", ".join(names))
            names = [name]
        entries = (camchain_entry(camera, result.path) for camera in cameras.values())
        return yaml_text(dict(zip(names, entries, strict=True))).encode()


def camchain_entry(camera: Camera, path: Path | None) -> dict[str, Any]:
    """A camera as a camchain of kalibr has it; its radtan has no k3.

    Raises:
        InputError: a lens of another model.
    """
    models = {PLUMB_BOB: "radtan", EQUIDISTANT: "equidistant"}
    bent = camera.intrinsics[4:]
    # Less than a hundredth of a pixel at 45°: a k3 of zero that was estimated.
    some_k3 = bool(np.any(np.abs(bent[4:]) > 1e-5))
    if camera.lens not in models or some_k3:
        what = camera.lens.name + (" with k3" if camera.lens is PLUMB_BOB else "")
        raise InputError(
            f"a lens of the model {what}",
            "plumb_bob without k3, or equidistant: kalibr has no other of these models",
            file=path,
            hint="calibrate the camera with --lens equidistant, or export camera-info",
        )
    return {
        "camera_model": "pinhole",
        "distortion_coeffs": bent[:4].tolist(),
        "distortion_model": models[camera.lens],
        "intrinsics": camera.intrinsics[:4].tolist(),
        "resolution": [camera.width, camera.height],
    }


def _storage(matrix: FloatArray) -> str:
    """A matrix as ``cv::FileStorage`` writes it."""
    rows, columns = matrix.shape
    data = ", ".join(repr(value) for value in matrix.ravel().tolist())
    return f"!!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [{data}]\n"
