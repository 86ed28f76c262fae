"""Pictures of a recording: one of each rest as a file, and the camera that took them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from foreign import imported
from ros_recordings import HEIGHT, JOINTS, POSTURES, WIDTH, picture, write_recording

from suta_calib.errors import InputError
from suta_calib.exchange import ImportedRows
from suta_calib.exchange.ros_pictures import camera_of, picture_of
from suta_calib.measurements.camera import read_camera
from suta_calib.report.exchange import imported_document

pytest.importorskip("rosbags")
cv2 = pytest.importorskip("cv2")

TOPIC = "/camera/image_raw"


@pytest.mark.parametrize(
    ("encoding", "topic", "more"),
    [("bgr8", TOPIC, {}), ("rgb8", TOPIC, {"storage": "mcap"}), ("png", f"{TOPIC}/compressed", {})],
)
def test_a_picture_of_each_rest_is_a_file(
    encoding: str, topic: str, more: dict[str, Any], tmp_path: Path
) -> None:
    found = imported(
        write_recording(tmp_path / "run", encoding=encoding, **more), image_topic=topic
    )
    assert isinstance(found, ImportedRows)
    found.write(tmp_path / "out.csv")
    names = ["run_001.png", "run_002.png", "run_003.png"]
    assert found.columns["image"].tolist() == names
    readings = np.stack([found.columns[name] for name in JOINTS], axis=1)
    np.testing.assert_allclose(readings, POSTURES, atol=1e-9)
    for k, name in enumerate(names):
        image = cv2.imread(str(tmp_path / "out_images" / name))
        np.testing.assert_array_equal(image, picture(k))
    camera = read_camera(tmp_path / "out_camera.yaml")
    assert (camera.width, camera.height) == (WIDTH, HEIGHT)
    np.testing.assert_array_equal(
        camera.intrinsics, [9.0, 9.0, 4.0, 3.0, 0.1, -0.2, 0.001, 0.002, 0.0]
    )
    told = imported_document(found, tmp_path / "out.csv")
    assert told.data["images"] == str(tmp_path / "out_images")
    # Once more, of fewer rests: what only the run before wrote goes, what others wrote stays.
    (tmp_path / "out_images" / "run_009.png").touch()
    (tmp_path / "out_images" / "mine.png").touch()
    found.write(tmp_path / "out.csv")
    left = sorted(file.name for file in (tmp_path / "out_images").iterdir())
    assert left == ["mine.png", *names]


def test_what_is_asked_for_must_be_there(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "run", encoding="mono8", camera_model="thin_prism")
    with pytest.raises(InputError, match=r"no topic '/cam' of this kind; expected one of /camera"):
        imported(path, image_topic="/cam")
    found = imported(path, image_topic=TOPIC)
    assert found.camera is None
    assert any("thin_prism with " in note for note in found.assessment.notes)
    with pytest.raises(InputError, match="no topic"):
        imported(write_recording(tmp_path / "blind"), image_topic=TOPIC)


def message(encoding: str, data: bytes, step: int, big: int = 0) -> SimpleNamespace:
    pixels = np.frombuffer(data, dtype=np.uint8)
    size = {"height": 2, "width": 2, "step": step, "is_bigendian": big}
    return SimpleNamespace(encoding=encoding, data=pixels, **size)


def read(each: SimpleNamespace) -> Any:
    data = picture_of(Path("run"), TOPIC, each).data
    return cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)


def test_encodings_are_what_ros_means_by_them() -> None:
    two = read(message("mono16", bytes([1, 2, 3, 4, 5, 6, 7, 8]), 4, 1))
    assert two.tolist() == [[0x102, 0x304], [0x506, 0x708]]
    other = read(message("16UC1", bytes([1, 2, 3, 4, 5, 6, 7, 8]), 4))
    assert other.tolist() == [[0x201, 0x403], [0x605, 0x807]]
    assert read(message("rgb8", bytes(range(12)), 6))[0, 0].tolist() == [2, 1, 0]
    assert read(message("bgra8", bytes(range(16)), 8))[0, 1].tolist() == [4, 5, 6]
    # Grey has no colour in YUV: 128 in both.
    grey = bytes([128, 50, 128, 200] * 2)
    assert (np.ptp(read(message("uyvy", grey, 4)).astype(int), axis=2) <= 2).all()


@pytest.mark.parametrize(("pattern", "at"), [("rggb", 2), ("bggr", 0)])
def test_bayer_patterns_begin_where_they_say(pattern: str, at: int) -> None:
    """A sensor of which only the first pixel of each two by two sees light."""
    raw = np.zeros((8, 8), dtype=np.uint8)
    raw[::2, ::2] = 200
    each = SimpleNamespace(
        encoding=f"bayer_{pattern}8", data=raw.ravel(), height=8, width=8, step=8, is_bigendian=0
    )
    colour = read(each)[4, 4]
    assert int(np.argmax(colour)) == at


@pytest.mark.parametrize(
    "each",
    [
        message("32FC1", bytes(16), 8),
        message("bgr8", bytes(5), 6),
        message("bgr8", bytes(12), 3),
        SimpleNamespace(format="jpeg", data=b"no picture"),
        SimpleNamespace(format="png; compressedDepth png", data=b"\0\0\0\0\x89PNG"),
    ],
)
def test_what_is_no_picture_is_refused(each: SimpleNamespace) -> None:
    with pytest.raises(InputError, match=f"a picture of {TOPIC}"):
        picture_of(Path("run"), TOPIC, each)


def info(**more: Any) -> SimpleNamespace:
    matrix, d = [500.0, 0, 320, 0, 501, 240, 0, 0, 1], [0.1, 0.2, 0.0, 0.0]
    values = {"width": 640, "height": 480, "distortion_model": "plumb_bob", "k": matrix, "d": d}
    return SimpleNamespace(**(values | more))


def test_a_camera_info_is_a_camera_or_says_why_not() -> None:
    camera, _ = camera_of(info())
    assert camera is not None
    np.testing.assert_array_equal(camera.intrinsics, [500, 501, 320, 240, 0.1, 0.2, 0, 0, 0])
    in_ros_1 = SimpleNamespace(
        width=640, height=480, distortion_model="plumb_bob", K=info().k, D=[]
    )
    first, _ = camera_of(in_ros_1)
    assert first is not None
    eight = [0.1, 0.2, 0.0, 0.0, 0.1, 0.3, 0.2, 0.1]
    wide, _ = camera_of(info(distortion_model="rational_polynomial", d=eight))
    assert wide is not None
    np.testing.assert_array_equal(wide.intrinsics, [500, 501, 320, 240, *eight])
    for more, why in (
        ({"k": [0.0] * 9}, "was not calibrated"),
        ({"distortion_model": "thin_prism", "d": [0.0] * 12}, "none of plumb_bob, rational_poly"),
        ({"distortion_model": "equidistant", "d": [0.0] * 5}, "equidistant with 5 coefficients"),
        ({"d": [float("nan")]}, "not a number"),
    ):
        none, said = camera_of(info(**more))
        assert none is None
        assert why in said
