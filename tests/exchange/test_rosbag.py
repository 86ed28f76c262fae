"""Recordings of ROS: rests found and averaged, with what was seen meanwhile."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from foreign import check, imported
from ros_recordings import JOINTS, POSTURES, motion, seen, write_recording

from suta_calib.errors import InputError
from suta_calib.geometry.numbers import homogeneous

pytest.importorskip("rosbags")

KINDS = {"ROS 2": {}, "MCAP": {"storage": "mcap"}, "ROS 1": {"ros1": True}}


@pytest.fixture(params=KINDS)
def recording(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    name = "run.bag" if request.param == "ROS 1" else "run"
    return write_recording(tmp_path / name, **KINDS[request.param])


def test_rests_with_poses_by_topic(recording: Path, tmp_path: Path) -> None:
    """Without noise a mean is what was read, and what was seen during the rest."""
    found = imported(recording, pose_topic="/tool")
    assert found.form == "rosbag"
    readings = np.stack([found.columns[name] for name in JOINTS], axis=1)
    np.testing.assert_allclose(readings, POSTURES, atol=1e-9)
    check(found, tmp_path / "o.csv", *seen(POSTURES))


def test_rests_with_poses_through_tf(recording: Path, tmp_path: Path) -> None:
    """The tool in the tracker: a moving transform behind a static one."""
    found = imported(recording, body="tool", reference="tracker")
    T_tracker_base = homogeneous([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0, 0, 2])
    rotation, position = seen(POSTURES)
    R = T_tracker_base[:3, :3] @ rotation
    p = position @ T_tracker_base[:3, :3].T + T_tracker_base[:3, 3]
    check(found, tmp_path / "o.csv", R, p)


def test_a_recording_of_one_rest(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "run")
    assert len(imported(path, seconds="1.5")) == 3
    with pytest.raises(InputError, match=r"no rest of 5 s.*--seconds"):
        imported(path, seconds="5")
    with pytest.raises(InputError, match="--seconds: found 'no'"):
        imported(path, seconds="no")


def test_joints_alone_and_what_is_asked_for(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "run")
    both = imported(path)
    assert set(both.columns) == {*JOINTS, *"xyz", "qx", "qy", "qz", "qw", "time"}
    assert (np.diff(both.columns["time"]) > 0).all()
    assert both.columns["time"][-1] <= 100 + motion()[0][-1]
    for options, says in (
        ({"body": "tol", "reference": "tracker"}, "no frame 'tol' in tf; expected one of base, t"),
        ({"body": "tool"}, "no --reference"),
        ({"pose_topic": "/cam"}, "no topic '/cam' of this kind; expected one of /tool"),
        ({"joint_topic": "/js"}, "no topic '/js' of this kind; expected one of /joint_states"),
    ):
        with pytest.raises(InputError, match=says):
            imported(path, **options)


def test_a_damaged_recording(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "run")
    (file,) = path.glob("*.db3")
    file.write_bytes(file.read_bytes()[:5000])
    with pytest.raises(InputError, match="a recording that cannot be read"):
        imported(path)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_file_of_a_recording_stands_for_it(storage: str, tmp_path: Path) -> None:
    path = write_recording(tmp_path / "run", storage)
    (file,) = (each for each in path.iterdir() if each.suffix in (".db3", ".mcap"))
    assert len(imported(file, pose_topic="/tool")) == len(POSTURES)
    (path / "metadata.yaml").unlink()
    with pytest.raises(InputError, match=r"no metadata.yaml in its folder.*reindex"):
        imported(file)


def test_joints_that_tell_of_themselves_in_messages_of_their_own(tmp_path: Path) -> None:
    """An arm and its gripper on one topic: the rests are those of both."""
    found = imported(write_recording(tmp_path / "run", parted=True), pose_topic="/tool")
    readings = np.stack([found.columns[name] for name in JOINTS], axis=1)
    np.testing.assert_allclose(readings, POSTURES, atol=1e-9)


def test_every_row_of_a_moving_arm(tmp_path: Path) -> None:
    """Rows at the recorded times, of which a calibration in motion is made; poses beside them."""
    path = write_recording(tmp_path / "run", parted=True)
    time, q = motion()
    alone = imported(path, moving=True, body="tool", reference="tracker")
    assert [*alone.columns] == ["time", *JOINTS, *"xyz", "qx", "qy", "qz", "qw"]
    rows = imported(path, moving=True, pose_topic="/tool")
    at = rows.columns["time"] - 100.0
    readings = np.stack([rows.columns[name] for name in JOINTS], axis=1)
    expected = np.stack([np.interp(at, time, values) for values in q.T], axis=1)
    # In the rows next to a rest the motion has a corner.
    assert np.quantile(np.abs(readings - expected).max(axis=1), 0.9) < 1e-6
    position = np.stack([rows.columns[axis] for axis in "xyz"], axis=1)
    assert np.quantile(np.abs(position - seen(expected)[1]).max(axis=1), 0.9) < 1e-6
    assert len(rows) > 0.95 * len(time)
    with pytest.raises(InputError, match=r"--moving left out"):
        imported(path, moving=True, imu_topic="/imu")
