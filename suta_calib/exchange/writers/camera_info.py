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
SIZE: Final = Option(
    "picture_size",
    "Width and height of the pictures, in px, where the result does not contain them (hand-eye "
    "without --camera).",
    "WxH",
)


def _cameras(result: Result, given: Given, form: str) -> Mapping[str, Camera]:
    """The cameras, with the size of picture that was given where the result has none."""
    if not (stated := given.text(SIZE, "")):
        return result.need_cameras(form)
    size = re.fullmatch(r"([1-9]\d{0,5})[x×]([1-9]\d{0,5})", stated.replace(" ", ""))
    if size is None:
        raise given.refuse(SIZE, repr(stated), "width and height in px, such as 1920x1080")
    return result.need_cameras(form, (int(size[1]), int(size[2])))


class CameraInfoWriter(Writer):
    """The camera's intrinsics as ROS's camera_info_manager has them."""

    name = "camera-info"
    summary = "camera_info YAML of ROS, which OpenCV can also read"
    example = "results --format camera-info --out camera.yaml"
    options = (NAME, SIZE)
    file = "exported_camera.yaml"

    def content(self, result: Result, given: Given) -> bytes:
        """`camera.yaml`, with the matrices of a camera that is not rectified."""
        label, camera = next(iter(_cameras(result, given, self.name).items()))
        name = given.text(NAME, _ros_name(label))
        if not name.replace("_", "").replace("/", "").isalnum():
            raise given.refuse(NAME, repr(name), "letters, digits, _ and /")
        return _camera_info(name, camera)

    def more(self, result: Result, given: Given) -> Mapping[str, bytes]:
        """A file for every other camera."""
        return {
            label: _camera_info(_ros_name(label), camera)
            for label, camera in [*_cameras(result, given, self.name).items()][1:]
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
    options = (SIZE,)
    file = "exported_opencv_camera.yaml"

    def content(self, result: Result, given: Given) -> bytes:
        """Size, matrix, and the coefficients; and their model, for which OpenCV has no key."""
        return _file_storage(next(iter(_cameras(result, given, self.name).values())))

    def more(self, result: Result, given: Given) -> Mapping[str, bytes]:
        """A file for every other camera."""
        others = [*_cameras(result, given, self.name).items()][1:]
        return {label: _file_storage(camera) for label, camera in others}


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
    options = (NAME, SIZE)
    file = "exported_camchain.yaml"

    def content(self, result: Result, given: Given) -> bytes:
        """Every camera; its radtan has no k3, so that a lens with one is refused."""
        cameras = _cameras(result, given, self.name)
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
