"""Cameras in files of ROS, OpenCV and kalibr: the same camera from each, or what it is instead."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from suta_calib.errors import CameraError
from suta_calib.geometry.lens import EQUIDISTANT, PLUMB_BOB, RATIONAL
from suta_calib.measurements.camera import read_camera, write_camera

INTRINSICS = [1187.0, 1189.0, 607.0, 478.0, 0.1, -0.2, 0.0005, -0.001, 0.02]
K = [1187.0, 0.0, 607.0, 0.0, 1189.0, 478.0, 0.0, 0.0, 1.0]
D = INTRINSICS[4:]
FILE = (
    "image_width: 1280\nimage_height: 960\ncamera_name: narrow\n"
    f"camera_matrix: {{rows: 3, cols: 3, data: {K}}}\n"
    f"distortion_model: plumb_bob\ndistortion_coefficients: {{rows: 1, cols: 5, data: {D}}}\n"
)


def block(name: str, values: list[float]) -> str:
    return f"{name}:\n" + "".join(f"- {value}\n" for value in values)


MESSAGE = (
    "header:\n  stamp:\n    sec: 1759842258\n    nanosec: 831630048\n  frame_id: cam\n"
    "height: 960\nwidth: 1280\ndistortion_model: plumb_bob\n"
    + block("d", D)
    + block("k", K)
    + "binning_x: 0\nbinning_y: 0\nroi:\n  x_offset: 0\n  y_offset: 0\n  height: 0\n  width: 0\n"
    "  do_rectify: false\n---\n"
)
ROS_1 = (
    'header: \n  seq: 3\n  frame_id: "cam"\nheight: 960\nwidth: 1280\n'
    f'distortion_model: "plumb_bob"\nD: {D}\nK: {K}\nbinning_x: 0\nbinning_y: 0\n---\n'
)
KALIBR = (
    "cam0:\n  cam_overlaps: []\n  camera_model: pinhole\n"
    f"  distortion_coeffs: {D[:4]}\n  distortion_model: radtan\n"
    f"  intrinsics: {INTRINSICS[:4]}\n  resolution: [1280, 960]\n  rostopic: /cam0/image_raw\n"
)
OPENCV = (
    "%YAML:1.0\n---\nimage_width: 1280\nimage_height: 960\n"
    f"camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: {K}\n"
    f"distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   data: {D}\n"
)
FILES = {
    "a file of ROS": FILE,
    "radtan, kalibr's word": FILE.replace("plumb_bob", "radtan"),
    "OpenCV": OPENCV,
    "a message": MESSAGE,
    "two messages": MESSAGE + MESSAGE.replace("1187", "2000"),
    "a message of ROS 1": ROS_1,
    "kalibr": KALIBR,
}


@pytest.mark.parametrize("what", FILES)
def test_the_same_camera(what: str, tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(FILES[what])
    camera = read_camera(path)
    assert (camera.width, camera.height) == (1280, 960)
    few = 8 if what == "kalibr" else 9
    np.testing.assert_allclose(camera.intrinsics[:few], INTRINSICS[:few])


EIGHT = [*D, 0.3, -0.1, 0.01]
FISHEYE = D[:4]
LENS_FILES = {
    "ROS, rational": (
        FILE.replace("plumb_bob", "rational_polynomial").replace(str(D), str(EIGHT)),
        (RATIONAL, EIGHT),
    ),
    # Its FileStorage names no model.
    "OpenCV, eight numbers": (OPENCV.replace(str(D), str(EIGHT)), (RATIONAL, EIGHT)),
    "OpenCV, eight numbers of which three are zero": (
        OPENCV.replace(str(D), str([*D, 0.0, 0.0, 0.0])),
        (PLUMB_BOB, D),
    ),
    "ROS, equidistant": (
        FILE.replace("plumb_bob", "equidistant").replace(str(D), str(FISHEYE)),
        (EQUIDISTANT, FISHEYE),
    ),
    "a message, fisheye": (
        MESSAGE.replace("plumb_bob", "fisheye").replace(f"- {D[4]}\n", ""),
        (EQUIDISTANT, FISHEYE),
    ),
    "kalibr, equi": (KALIBR.replace("radtan", "equidistant"), (EQUIDISTANT, FISHEYE)),
}


@pytest.mark.parametrize("what", LENS_FILES)
def test_other_lenses(what: str, tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    text, (lens, coefficients) = LENS_FILES[what]
    path.write_text(text)
    camera = read_camera(path)
    assert camera.lens is lens
    np.testing.assert_array_equal(camera.intrinsics, [*INTRINSICS[:4], *coefficients])
    write_camera(path, replace(camera, covariance=np.eye(len(camera.intrinsics))))
    again = read_camera(path)
    assert again.lens is lens
    np.testing.assert_array_equal(again.intrinsics, camera.intrinsics)
    np.testing.assert_array_equal(again.covariance, np.eye(len(camera.intrinsics)))


REFUSED = {
    "rational": (
        FILE.replace("plumb_bob", "rational_polynomial"),
        r":6: .*found 5 coefficients for the distortion model rational_polynomial; expected 8: k1",
    ),
    "fisheye": (
        FILE.replace("plumb_bob", "fisheye"),
        "found 5 coefficients for the distortion model equidistant \\(fisheye\\); expected 4: .*"
        "5 coefficients are those of plumb_bob: correct distortion_model",
    ),
    "eight numbers": (
        FILE.replace("0.02]", "0.02, 0.3, -0.1, 0.01]"),
        "found 8 coefficients .* plumb_bob; expected 5: .* are those of rational_polynomial",
    ),
    "a model that is not read": (
        FILE.replace("plumb_bob", "thin_prism"),
        "OpenCV's model with a thin prism, k1 to s4; expected one of plumb_bob, rational_poly",
    ),
    "two cameras": (KALIBR + KALIBR.replace("cam0", "cam1"), ":9: cam1: found 2 cameras of kalib"),
    "another camera": (KALIBR.replace("pinhole", "omni"), r":3: cam0.camera_model: found 'omni'"),
    "binned": (MESSAGE.replace("binning_x: 0", "binning_x: 2"), "found pictures binned by 2"),
    "a part": (
        MESSAGE.replace("x_offset: 0", "x_offset: 8"),
        "roi: found only a part of the picture",
    ),
    "no number": (MESSAGE.replace("- 478.0", "- x"), r":21: camera_matrix.data\[5\]: found 'x'"),
    "not calibrated": (MESSAGE.replace("1187.0", "0.0"), "fx = 0 px"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_another_camera_is_refused_and_called_what_it_is(what: str, tmp_path: Path) -> None:
    text, says = REFUSED[what]
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(CameraError, match=says):
        read_camera(path)
