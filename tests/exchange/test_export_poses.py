"""Exports of poses and cameras, read back by the libraries that users read them with."""

from __future__ import annotations

import ast
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from foreign import poses, result_of, transforms
from lxml import etree
from scipy.spatial.transform import Rotation

from suta_calib.errors import InputError
from suta_calib.exchange import Result, Transform, read_result, write_foreign
from suta_calib.exchange.result import _cameras
from suta_calib.geometry.numbers import homogeneous, rotation_from_rpy
from suta_calib.measurements import Camera, read_camera
from suta_calib.model.arm import ArmModel
from suta_calib.model.urdf_tree import read_tree
from suta_calib.units import mm

SAME = 1e-9
EXAMPLE = Path(__file__).parents[2] / "examples/so101_printed_sheet/arm.urdf"
POSES = transforms(*poses(2))
CAMERA = Camera(
    1280, 960, np.array([1010.5, 1009.25, 640.1, 479.9, -0.12, 0.031, 1e-4, -2.5e-5, 1e-3])
)


@pytest.fixture
def found(tmp_path: Path) -> Result:
    """Two poses and a camera, as an answer may hold them."""
    both = (Transform("tool0", "eye", POSES[0]), Transform("base", "board 1", POSES[1]))
    return Result(tmp_path / "result.json", None, both, {"default": CAMERA})


def test_ros_transforms(found: Result) -> None:
    told = yaml.safe_load(write_foreign(found, "ros-tf").content)["transforms"]
    assert [each["child_frame_id"] for each in told] == ["eye", "board 1"]
    for each, pose in zip(told, POSES, strict=True):
        place, turn = each["transform"]["translation"], each["transform"]["rotation"]
        np.testing.assert_allclose([place[a] for a in "xyz"], pose[:3, 3], atol=SAME)
        R = Rotation.from_quat([turn[a] for a in "xyzw"]).as_matrix()
        np.testing.assert_allclose(R, pose[:3, :3], atol=SAME)


def test_ros_launch(found: Result) -> None:
    """ROS is not here: the file is Python, and its numbers are the poses."""
    tree = ast.parse(write_foreign(found, "ros-launch").content)
    (table,) = (node for node in tree.body if isinstance(node, ast.Assign))
    for (parent, child, place, turn), pose in zip(
        ast.literal_eval(table.value), POSES, strict=True
    ):
        assert (parent, child) in {("tool0", "eye"), ("base", "board 1")}
        np.testing.assert_allclose(place, pose[:3, 3], atol=SAME)
        np.testing.assert_allclose(Rotation.from_quat(turn).as_matrix(), pose[:3, :3], atol=SAME)


def test_plus(found: Result) -> None:
    root = etree.fromstring(write_foreign(found, "plus").content)
    told = root.findall("CoordinateDefinitions/Transform")
    assert [(each.get("From"), each.get("To")) for each in told] == [
        ("Eye", "Tool0"),
        ("Board1", "Base"),
    ]
    for each, pose in zip(told, POSES, strict=True):
        matrix = np.array(each.get("Matrix").split(), dtype=float).reshape(4, 4)
        np.testing.assert_allclose(matrix[:3, 3], mm(pose[:3, 3]), atol=1e3 * SAME)
        np.testing.assert_allclose(matrix[:3, :3], pose[:3, :3], atol=SAME)


@pytest.mark.parametrize("form", ["slicer-tfm", "slicer-h5"])
def test_slicer_transforms(form: str, found: Result, tmp_path: Path) -> None:
    """ITK's goes from the parent to the child in its own axes: Slicer turns it round again."""
    itk = pytest.importorskip("SimpleITK")
    path = tmp_path / write_foreign(found, form, pose="eye").file
    write_foreign(found, form, pose="eye").write(path)
    read = itk.ReadTransform(str(path))
    to_ras = np.diag([-1.0, -1.0, 1.0])
    for point in np.random.default_rng(0).uniform(-0.3, 0.3, (5, 3)):
        in_parent = POSES[0, :3, :3] @ point + POSES[0, :3, 3]
        back = to_ras @ np.array(read.TransformPoint(to_ras @ mm(in_parent)))
        np.testing.assert_allclose(back, mm(point), atol=1e3 * SAME)
    with pytest.raises(InputError, match=r"--pose: found 2 poses; expected .*eye, board 1"):
        write_foreign(found, form)


def test_camera_info_is_read_by_opencv(found: Result, tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    path = tmp_path / "camera.yaml"
    write_foreign(found, "camera-info", camera_name="left").write(path)
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert file.getNode("image_width").real() == CAMERA.width
    for key, numbers in (
        ("camera_matrix", CAMERA.matrix),
        ("distortion_coefficients", CAMERA.intrinsics[4:]),
    ):
        node = file.getNode(key).getNode("data")
        told = [node.at(k).real() for k in range(node.size())]
        np.testing.assert_allclose(told, numbers.ravel(), rtol=1e-12)
    assert file.getNode("projection_matrix").getNode("data").size() == 12
    assert yaml.safe_load(path.read_text())["camera_name"] == "left"


def test_every_camera_is_written(found: Result, tmp_path: Path) -> None:
    """The first in the file, the others beside it; kalibr has all in one."""
    right = replace(CAMERA, intrinsics=np.add(CAMERA.intrinsics, [3.0, *np.zeros(8)]))
    both = replace(found, cameras={"left": CAMERA, "arm/right": right})
    for form, key in (("camera-info", "camera_matrix"), ("opencv-camera", "camera_matrix")):
        written = write_foreign(both, form).write(tmp_path / f"{form}.yaml")
        assert [path.name for path in written] == [f"{form}.yaml", f"{form}-arm_right.yaml"]
        for path, camera in zip(written, (CAMERA, right), strict=True):
            assert key in path.read_text()
            assert np.array_equal(read_camera(path).intrinsics, camera.intrinsics)
    names = [yaml.safe_load(path.read_text())["camera_name"] for path in tmp_path.glob("camera-i*")]
    assert sorted(names) == ["arm_right", "left"]
    assert write_foreign(both, "camera-info").assessment.notes == (
        "The file is of camera left; beside it are files of arm/right.",
    )
    # Of a k3 of zero that was estimated too, hardly anything is left.
    flat = {
        name: replace(c, intrinsics=c.intrinsics * [*np.ones(8), 1e-10])
        for name, c in both.cameras.items()
    }
    chain = yaml.safe_load(write_foreign(replace(both, cameras=flat), "kalibr").content)
    assert [chain[name]["intrinsics"][0] for name in ("cam0", "cam1")] == [1010.5, 1013.5]
    with pytest.raises(InputError, match="a name for 2 cameras"):
        write_foreign(replace(both, cameras=flat), "kalibr", camera_name="eye")


def test_the_cameras_of_a_job_are_found_by_their_labels(tmp_path: Path) -> None:
    """One that was held, one that was estimated, and one on a chain."""
    rows = [("left", "", "fixed"), ("right", "", "free"), ("default", "arm", "free")]
    job = SimpleNamespace(
        observations=[
            SimpleNamespace(
                settings={"camera": CAMERA}, label=label, chain=chain, base_chain="", link=""
            )
            for label, chain, _ in rows
        ]
    )
    values = dict(zip(CAMERA.lens.names, (CAMERA.intrinsics + 1.0).tolist(), strict=True))
    parameters = {
        f"camera[{owner}].{key}": {"value": value}
        for owner in ("right", "arm")
        for key, value in values.items()
    }
    cameras = _cameras({"parameters": parameters}, job, tmp_path)  # type: ignore[arg-type]
    assert [*cameras] == ["left", "right", "arm"]
    moved = [
        np.ptp(camera.intrinsics - CAMERA.intrinsics) + camera.intrinsics[0]
        for camera in cameras.values()
    ]
    assert moved == pytest.approx([1010.5, 1011.5, 1011.5])


def test_answers_of_closed_problems(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    verdict = {"level": "good", "usable": True, "sentence": "", "notes": []}
    X, Z = POSES.tolist()
    answers = {
        ("hand", "eye"): {"setup": "eye-in-hand", "model": "AX=XB", "X": X},
        ("base", "eye"): {"setup": "eye-to-hand", "model": "AX=ZB", "X": X, "Z": Z},
        ("b", "a"): {"T_b_a": X},
    }
    for frames, data in answers.items():
        path.write_text(json.dumps({**data, "verdict": verdict}))
        first, *rest = read_result(tmp_path).transforms
        assert (first.parent, first.child) == frames
        np.testing.assert_array_equal(first.matrix, POSES[0])
        assert [each.child for each in rest] == (["target"] if "Z" in data else [])
    path.write_text(json.dumps({"tip_mm": [1.0, 2.0, 300.0], "verdict": verdict}))
    (tip,) = read_result(path).transforms
    np.testing.assert_allclose(tip.matrix[:3, 3], [0.001, 0.002, 0.3])
    with pytest.raises(InputError, match="no calibrated arm, which the format mjcf needs"):
        write_foreign(read_result(path), "mjcf")


def test_frames_of_one_kind_keep_their_labels(results: Path, tmp_path: Path) -> None:
    """Two placements are two frames: one could not be chosen, nor published, by one name."""
    data = json.loads((results / "result.json").read_text())
    pose = {"what": "placement", "within": "base"}
    data["external_poses"] = {
        f"placement[{label}]": pose | {"matrix": matrix.tolist()}
        for label, matrix in zip(("P1", "P2"), POSES, strict=True)
    }
    (tmp_path / "result.json").write_text(json.dumps(data))
    found = read_result(tmp_path).transforms
    assert [each.child for each in found] == ["placement_P1", "placement_P2"]
    assert {each.parent for each in found} == {"base_link"}


def test_a_matrix_that_is_no_pose_is_refused(tmp_path: Path) -> None:
    stretched = POSES[0] @ np.diag([1.0, 1.0, 5.0, 1.0])
    (tmp_path / "result.json").write_text(json.dumps({"T_b_a": stretched.tolist()}))
    with pytest.raises(InputError, match=r"result\.json: T_b_a: found numbers that are not a pose"):
        read_result(tmp_path)


def test_what_was_insisted_on_is_still_called_unusable(tmp_path: Path) -> None:
    verdict = {"level": "bad", "usable": False, "sentence": "not determined", "notes": []}
    data = {"T_b_a": POSES[0].tolist(), "verdict": verdict}
    (tmp_path / "result.json").write_text(json.dumps(data))
    found = write_foreign(read_result(tmp_path, anyway=True), "ros-tf").assessment
    assert found.level == "care"
    assert "do not use it" in found.notes[0]


def test_frames_have_the_users_names_and_only_their_pose_is_written(found: Result) -> None:
    named = {"frame": ("tool0=flange", "eye=camera_link")}
    (one,) = yaml.safe_load(write_foreign(found, "ros-tf", **named).content)["transforms"]
    assert (one["header"]["frame_id"], one["child_frame_id"]) == ("flange", "camera_link")
    by_pose = write_foreign(found, "ros-tf", pose="camera_link", **named)
    assert yaml.safe_load(by_pose.content)["transforms"] == [one]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (
            {"frame": ("hand=flange",)},
            "--frame: found the frame 'hand'; expected one of tool0, eye",
        ),
        ({"frame": ("eye=camera",)}, "names for only eye; expected names for both frames of a po"),
        ({"pose": "camera"}, "--pose: found the pose 'camera'; expected one of eye, board 1"),
        ({"frame": ("eye",)}, "--frame: found 'eye'; expected parts such as hand=tool0"),
    ],
)
def test_frames_that_are_not_there(options: dict[str, Any], says: str, found: Result) -> None:
    with pytest.raises(InputError, match=says):
        write_foreign(found, "ros-launch", **options)


def test_a_urdf_gets_a_link_for_each_camera(tmp_path: Path) -> None:
    """On the link that carries it, where the result has it; all else stays as it was."""
    arm = ArmModel.from_urdf(EXAMPLE, "hand")
    answer = result_of(arm, {}, tmp_path / "result.json")
    cameras = ("camera_wrist", "camera_front", "board")
    parents = ("hand", "base", "base")
    pairs = zip(parents, cameras, POSES[[0, 1, 0]], strict=True)
    found = replace(answer, transforms=tuple(Transform(*pair) for pair in pairs))
    plain = write_foreign(found, "urdf").content.decode()
    text = write_foreign(found, "urdf", cameras=True).content.decode()
    assert text.startswith(plain.rpartition("</robot>")[0])
    assert "board" not in text.removeprefix(plain.rpartition("</robot>")[0])
    q = np.array([[0.3, -0.2, 0.5, 0.1, -0.4]])
    hand = homogeneous(*(array[0] for array in arm.forward(q)))
    for name, wanted in (("camera_wrist", hand @ POSES[0]), ("camera_front", POSES[1])):
        tree = read_tree(text)
        assert name in tree.links
        joint = tree.joints[f"{name}_joint"].element.find("origin")
        assert joint is not None
        xyz, rpy = (np.array(str(joint.get(key)).split(), dtype=float) for key in ("xyz", "rpy"))
        own = homogeneous(rotation_from_rpy(rpy), xyz)
        parent = hand if name == "camera_wrist" else np.eye(4)
        np.testing.assert_allclose(parent @ own, wanted, atol=1e-8)
    with pytest.raises(InputError, match="a result without a camera"):
        write_foreign(answer, "urdf", cameras=True)
