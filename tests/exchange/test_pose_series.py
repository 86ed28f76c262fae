"""Poses that programs for hand-eye calibration keep in files of their own."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign import check, imported, read_back, transforms, written
from foreign_samples import KEPT, POSES, REFERENCE, TOOL, P, R, c3d, quaternion

from suta_calib.errors import InputError
from suta_calib.exchange.pose_table import pose_table
from suta_calib.measurements.pose_files import read_pose_pairs

DATA = Path(__file__).resolve().parents[2] / "data"


@pytest.mark.parametrize("form", ["pose-list", "bop", "visp", "matlab"])
def test_two_series_of_poses_are_pairs_and_one_is_a_body(form: str, tmp_path: Path) -> None:
    sample = POSES[form](tmp_path)
    pairs = imported(sample.path)
    assert pairs.form == form
    check(pairs, tmp_path / "o.csv", R, P, "a_")
    check(pairs, tmp_path / "o.csv", REFERENCE[:, :3, :3], REFERENCE[:, :3, 3], "b_")
    assert len(pairs.columns["frame"]) == 8
    check(imported(sample.path, **sample.options), tmp_path / "o.csv", R, P)
    relative = imported(sample.path, **sample.options, reference=sample.reference)
    in_reference = np.linalg.inv(REFERENCE) @ TOOL
    check(relative, tmp_path / "o.csv", in_reference[:, :3, :3], in_reference[:, :3, 3])


def test_frames_of_colmap_are_named_as_there(tmp_path: Path) -> None:
    found = imported(POSES["colmap"](tmp_path).path)
    check(found, tmp_path / "o.csv", R, P)
    assert found.columns["image"].tolist() == [f"im_{k}.png" for k in range(8)]


def test_markers_of_c3d_without_the_frames_that_did_not_see_them(tmp_path: Path) -> None:
    found = imported(c3d(tmp_path).path, body="probe")
    assert found.dropped == 1
    _, position = read_back(found, tmp_path / "o.csv")
    # The file holds single precision, mm.
    np.testing.assert_allclose(position, P[KEPT], atol=1e-7)
    np.testing.assert_allclose(np.diff(found.columns["time"][:3]), 0.01)


def transform(T: np.ndarray, k: int) -> dict[str, Any]:
    place = dict(zip("xyz", T[k, :3, 3].tolist(), strict=True))
    return {
        "translation": place,
        "rotation": dict(zip("xyzw", quaternion(T)[k].tolist(), strict=True)),
    }


LAYOUTS: dict[str, Any] = {
    "easy_handeye2": {
        "samples": [
            {"robot": transform(TOOL, k), "tracking": transform(REFERENCE, k)} for k in range(8)
        ]
    },
    "easy_handeye": {
        "camera_marker_samples": {"transforms": [transform(REFERENCE, k) for k in range(8)]},
        "hand_world_samples": {"transforms": [transform(TOOL, k) for k in range(8)]},
    },
    "lists of 4x4, the target first": {
        "T_cam_target": REFERENCE.tolist(),
        "T_base_gripper": TOOL.tolist(),
    },
    "rotation and translation": [
        {
            side: {"R": T[k, :3, :3].tolist(), "t": T[k, :3, 3:].tolist()}
            for side, T in (("target2cam", REFERENCE), ("gripper2base", TOOL))
        }
        for k in range(8)
    ],
    "numbered keys": {
        f"{side}_{k}": T[k, :3].ravel().tolist()
        for k in range(8)
        for side, T in (("robot", TOOL), ("marker", REFERENCE))
    },
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_roles_are_told_by_names(layout: str, tmp_path: Path) -> None:
    path = tmp_path / "samples.json"
    path.write_text(json.dumps(LAYOUTS[layout], indent=1))
    found = imported(path)
    check(found, tmp_path / "o.csv", R, P, "a_")
    check(found, tmp_path / "o.csv", REFERENCE[:, :3, :3], REFERENCE[:, :3, 3], "b_")
    assert found.assessment.level == "good"
    assert found.columns["frame"].tolist() == list(range(8))


@pytest.mark.parametrize("layout", ["easy_handeye2", "easy_handeye"])
def test_easy_handeye_records_the_base_in_the_hand_where_the_camera_is_beside_the_robot(
    layout: str, tmp_path: Path
) -> None:
    path = tmp_path / "samples.json"
    path.write_text(json.dumps(LAYOUTS[layout], indent=1))
    beside, back = imported(path, setup="eye-to-hand"), np.linalg.inv(TOOL)
    check(beside, tmp_path / "o.csv", back[:, :3, :3], back[:, :3, 3], "a_")
    check(beside, tmp_path / "o.csv", REFERENCE[:, :3, :3], REFERENCE[:, :3, 3], "b_")
    assert "these poses were inverted" in beside.remarks[-1]
    table, notes = pose_table(path, setup="eye-to-hand")
    np.testing.assert_allclose(read_pose_pairs(table).hand[1], back[:, :3, 3], atol=1e-12)
    assert "were inverted" in notes[-1]


def test_other_lists_are_as_they_say_wherever_the_camera_is(tmp_path: Path) -> None:
    path = tmp_path / "samples.json"
    path.write_text(json.dumps(LAYOUTS["lists of 4x4, the target first"]))
    check(imported(path, setup="eye-to-hand"), tmp_path / "o.csv", R, P, "a_")


def test_a_sample_without_one_of_its_poses_is_named(tmp_path: Path) -> None:
    path, samples = tmp_path / "samples.json", LAYOUTS["easy_handeye2"]["samples"]
    lame = [{**samples[3], "tracking": {**samples[3]["tracking"], "translation": None}}]
    path.write_text(json.dumps({"samples": samples[:3] + lame + samples[4:]}))
    with pytest.raises(
        InputError, match=r"8 robot and 7 tracking \(sample 3 has only a pose of robot"
    ):
        imported(path)


def test_names_that_tell_no_roles_are_asked_about(tmp_path: Path) -> None:
    path = tmp_path / "samples.json"
    path.write_text(json.dumps({"first": TOOL.tolist(), "second": REFERENCE.tolist()}))
    assert "first is treated as the hand in the base (a_)" in imported(path).notes[0]


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda T: T[:4].tolist(), "different numbers of poses: 8 robot and 4 marker"),
        (lambda T: (2 * T).tolist(), "last row is not 0 0 0 1"),
        (lambda T: (T * [1.0, 1.0, -1.0, 1.0]).tolist(), "not a rotation matrix"),
    ],
)
def test_what_is_no_pose(spoil: Any, says: str, tmp_path: Path) -> None:
    path = tmp_path / "samples.json"
    path.write_text(json.dumps({"robot": TOOL.tolist(), "marker": spoil(REFERENCE)}))
    with pytest.raises(InputError, match=says):
        imported(path)


def test_lengths_in_mm(tmp_path: Path) -> None:
    path = tmp_path / "list.yaml"
    rows = [f"- {T.ravel().tolist()}\n" for T in TOOL * [1.0, 1.0, 1.0, 1e3]]
    path.write_text("# recorded by hand\n---\n" + "".join(rows).replace("1000.0]", "1.0]"))
    assert "check whether they are millimetres" in imported(path).notes[0]
    check(imported(path, unit="mm"), tmp_path / "o.csv", R, P)


def test_matlab_7_3_is_refused_in_words(tmp_path: Path) -> None:
    path = tmp_path / "new.mat"
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM"
    path.write_bytes(header + bytes(512))
    with pytest.raises(InputError, match=r"MATLAB 7\.3.*save -v7"):
        imported(path)


def test_a_hand_eye_calibration_reads_samples_directly(tmp_path: Path) -> None:
    """The same answer as over `import`, and a row is named by its line in the source."""
    pairs = read_pose_pairs(DATA / "poses/hand_eye.csv")
    names = "effector_wrt_world", "object_wrt_sensor"
    both = [transforms(*pairs.hand), transforms(*pairs.target)]
    samples = [
        {name: T[k].ravel().tolist() for name, T in zip(names, both, strict=True)}
        for k in range(len(both[0]))
    ]
    path = tmp_path / "samples.yaml"
    path.write_text("".join(f"- {json.dumps(sample)}\n" for sample in samples))
    table, notes = pose_table(path)
    assert any("effector_wrt_world is treated as the hand" in note for note in notes)
    direct = read_pose_pairs(table)
    assert table.lines == tuple(range(1, len(samples) + 1))
    for one, other in ((direct.hand, pairs.hand), (direct.target, pairs.target)):
        np.testing.assert_allclose(transforms(*one), transforms(*other), atol=1e-12)


def test_our_own_csv_stays_as_it_is() -> None:
    table, notes = pose_table(DATA / "poses/pivot.csv")
    assert (table.lines[0], notes) == (2, ())


def test_a_file_that_is_an_arm_is_no_poses(tmp_path: Path) -> None:
    path = tmp_path / "nothing.yaml"
    path.write_text("a: 1\n")
    with pytest.raises(InputError, match=r"unknown format"):
        pose_table(path)


def test_a_recording_of_several_bodies_names_the_command_that_has_the_options() -> None:
    path = DATA.parent / "examples/stylus_polaris/track.csv"
    with pytest.raises(InputError, match=r"--body NAME.* those of suta-calib import .*--out"):
        pose_table(path)


def test_rows_of_hand_and_target_in_turn(tmp_path: Path) -> None:
    """4x4 blocks below one another, as many scripts print them."""
    both = np.stack([TOOL, REFERENCE], axis=1).reshape(-1, 4)
    path = written(tmp_path / "blocks.txt", both, " ")
    found = imported(path, alternating=True)
    check(found, tmp_path / "o.csv", R, P, "a_")
    check(found, tmp_path / "o.csv", REFERENCE[:, :3, :3], REFERENCE[:, :3, 3], "b_")
    with pytest.raises(InputError, match=r"--alternating: .* an even number of rows"):
        imported(written(path, both[:-4], " "), alternating=True)


def test_pictures_that_a_list_names_are_a_column(tmp_path: Path) -> None:
    path = tmp_path / "poses.json"
    samples = [{"image": f"p/{k}.png", "T_base_hand": TOOL[k].tolist()} for k in range(8)]
    path.write_text(json.dumps(samples))
    found = imported(path, prefix="a_")
    check(found, tmp_path / "o.csv", R, P, "a_")
    assert found.columns["image"].tolist() == [f"p/{k}.png" for k in range(8)]
