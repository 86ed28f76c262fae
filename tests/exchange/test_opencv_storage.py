"""4x4 matrices of OpenCV's FileStorage: pairs, or one body."""

from __future__ import annotations

from pathlib import Path

import pytest
from foreign import check, imported
from foreign_samples import REFERENCE, TOOL, P, R, opencv_storage

from suta_calib.errors import InputError


def test_two_series_are_pairs_and_one_is_a_body(tmp_path: Path) -> None:
    path = opencv_storage(tmp_path).path
    found = imported(path)
    check(found, tmp_path / "o.csv", TOOL[:, :3, :3], TOOL[:, :3, 3], "a_")
    check(found, tmp_path / "o.csv", REFERENCE[:, :3, :3], REFERENCE[:, :3, 3], "b_")
    assert found.assessment.level == "care"
    assert "T1 is treated as the hand in the base" in found.notes[0]
    check(imported(path, body="T1"), tmp_path / "o.csv", R, P)
    check(imported(path, body="T1", unit="mm"), tmp_path / "o.csv", R, P / 1e3)
    relative = imported(path, body="T1", reference="T2")
    assert len(relative) == len(P)
    path.write_text(path.read_text().replace("frameCount: 8", "frameCount: 9"))
    assert any(
        "frameCount is 9, but there are 8 matrices T1" in note for note in imported(path).notes
    )


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("frameCount: 8", "frameCount: 17", "found 16 matrices; expected 17, as the file states"),
        ("T2_7: ", "T2_9: ", "different numbers of poses: 8 T1 and 8 T2 .*--body T1"),
        ("cols: 4", "cols: 3", "T1_0: found a matrix of 4 x 3; expected a 4x4 matrix"),
        (" ]", ", 1.0 ]", r"poses\.yml:4: T1_0: found other data; expected 16 finite numbers"),
        ("0.0, 0.0, 0.0, 1.0", "0.0, 0.0, 0.0, 2.0", "a last row that is not 0 0 0 1"),
        (
            "T1_0: !!opencv-matrix",
            "T2_8: !!opencv-matrix\nT1_0: !!opencv-matrix",
            "T2_8: found no m",
        ),
        (
            "%YAML:1.0",
            "<?xml version='1.0'?>\n<opencv_storage>",
            "OpenCV's XML format; expected its YAML",
        ),
    ],
)
def test_what_is_no_pose(old: str, new: str, says: str, tmp_path: Path) -> None:
    path = opencv_storage(tmp_path).path
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=says):
        imported(path)


def test_other_yaml_is_called_so(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text("image_width: 640\ndata: [1, 0, 0]\n")
    with pytest.raises(InputError, match=r"found a \.yaml file of an unknown format"):
        imported(path)


def test_an_empty_file_is_called_so(tmp_path: Path) -> None:
    path = tmp_path / "poses.yaml"
    path.write_text("\n")
    with pytest.raises(InputError, match="found an empty file"):
        imported(path)


def test_a_camera_is_no_pose(tmp_path: Path) -> None:
    path = tmp_path / "camera.yml"
    path.write_text(
        "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
        "   data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]\n"
    )
    with pytest.raises(
        InputError, match=r"no numbered 4x4 matrices .* read by the option --camera"
    ):
        imported(path)
