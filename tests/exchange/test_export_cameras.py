"""Cameras from answers that have no job: of hand-eye, rig and detect, and from a camera's file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from suta_calib.errors import InputError
from suta_calib.exchange import read_result, write_foreign
from suta_calib.exchange.recognition import recognised_format
from suta_calib.geometry.lens import EQUIDISTANT
from suta_calib.measurements import Camera, read_camera, write_camera
from suta_calib.report.detect import camera_record

CAMERA = Camera(
    800, 600, np.array([250.0, 251.0, 405.0, 297.0, 0.02, -6e-3, 1e-3, 0.0]), lens=EQUIDISTANT
)
OF_HAND_EYE = {
    **{"width": 800, "height": 600, "fx": 250.0, "fy": 251.0, "cx": 405.0, "cy": 297.0},
    **{"distortion_model": "equidistant", "distortion": [0.02, -6e-3, 1e-3, 0.0]},
}
POSE = {"setup": "eye-in-hand", "reprojection_rms_px": 0.2}
ANSWERS = {
    "hand-eye": ("result.json", POSE | {"X": np.eye(4).tolist(), "camera": OF_HAND_EYE}, 1),
    "hand-eye by name": (
        "result.json",
        POSE
        | {
            "X": {"left": np.eye(4).tolist(), "right": np.eye(4).tolist(), "lost": None},
            "cameras": {
                "left/one": {"camera": OF_HAND_EYE},
                "left/two": {"camera": OF_HAND_EYE},
                "right": {"camera": OF_HAND_EYE},
                "lost": {"usable": False},
            },
        },
        2,
    ),
    "rig": ("result.json", {"cameras": dict.fromkeys("ab", camera_record(CAMERA))}, 2),
    "detect": ("detect.json", {"camera": camera_record(CAMERA)}, 1),
}


@pytest.mark.parametrize("what", ANSWERS)
@pytest.mark.parametrize("form", ["camera-info", "kalibr", "opencv-camera"])
def test_every_camera_of_an_answer(what: str, form: str, tmp_path: Path) -> None:
    name, answer, count = ANSWERS[what]
    (tmp_path / name).write_text(json.dumps(answer))
    read = read_result(tmp_path)
    assert len(read.cameras) == count
    written = write_foreign(read, form).write(tmp_path / "out.yaml")
    assert len(written) == (1 if form == "kalibr" else count)
    if form == "kalibr" and count > 1:
        return
    for path in written:
        camera = read_camera(path)
        assert (camera.width, camera.height, camera.lens) == (800, 600, EQUIDISTANT)
        np.testing.assert_allclose(camera.intrinsics, CAMERA.intrinsics)


def test_a_camera_file(tmp_path: Path) -> None:
    write_camera(tmp_path / "camera.yaml", CAMERA)
    (out,) = write_foreign(read_result(tmp_path / "camera.yaml"), "camera-info").write(
        tmp_path / "out.yaml"
    )
    np.testing.assert_array_equal(read_camera(out).intrinsics, CAMERA.intrinsics)
    with pytest.raises(InputError, match="which the cameras of the result say themselves"):
        write_foreign(read_result(tmp_path / "camera.yaml"), "kalibr", picture_size="800x600")


def test_a_size_that_nobody_knows_is_not_made_up(tmp_path: Path) -> None:
    """Of an answer without a camera's file: the pictures may be larger than what holds all."""
    unknown = OF_HAND_EYE | {"width": None, "height": None}
    answer = POSE | {"X": np.eye(4).tolist(), "camera": unknown}
    path = tmp_path / "result.json"
    path.write_text(json.dumps(answer))
    read = read_result(path)
    assert read.transforms
    with pytest.raises(InputError, match=r"nothing says the size.*--picture-size WxH"):
        write_foreign(read, "camera-info")
    for form in ("camera-info", "opencv-camera", "kalibr"):
        (out,) = write_foreign(read, form, picture_size="800x600").write(tmp_path / "out.yaml")
        camera = read_camera(out)
        assert (camera.width, camera.height, camera.lens) == (800, 600, EQUIDISTANT)
        np.testing.assert_allclose(camera.intrinsics, CAMERA.intrinsics)
    for size, problem in (("800", "found '800'"), ("400x300", r"principal point.*\(405, 297\)")):
        with pytest.raises(InputError, match=problem):
            write_foreign(read, "camera-info", picture_size=size)
    # It is an answer, and no list of poses to be imported.
    form = recognised_format(path)
    assert form is not None
    assert "export" in form.read_by
