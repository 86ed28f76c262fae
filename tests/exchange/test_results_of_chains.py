"""The result of a robot with several chains: exported, and tracked by one of them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from cli_job import cli
from torso_robot import torso_robot, write_torso_job

from suta_calib import ArmModel, CalibrationJob
from suta_calib.errors import InputError
from suta_calib.exchange import Result, read_foreign, read_result, write_foreign
from suta_calib.tracking import TrackOptions
from suta_calib.tracking.uncertainty import read_uncertainty
from suta_calib.trust.tip import sensitivity


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a job of two arms on a torso."""
    job: Path = write_torso_job(tmp_path_factory.mktemp("torso"))
    assert cli("calibrate", job) == 0
    return job.parent / "results"


@pytest.fixture
def result(results: Path) -> Result:
    return read_result(results)


def test_formats_of_a_whole_robot_hold_all_chains(results: Path, result: Result) -> None:
    assert write_foreign(result, "urdf").content == (results / "calibrated.urdf").read_bytes()
    offsets = yaml.safe_load(write_foreign(result, "joint-offsets").content)["joint_offsets"]
    assert [*offsets] == [*torso_robot().joints]
    kinematics = yaml.safe_load(write_foreign(result, "xacro-yaml").content)["kinematics"]
    assert len(kinematics) == len(torso_robot().joints) + 1  # and the hash
    data = json.loads(write_foreign(result, "json").content)
    assert data["joints"] == [*torso_robot().joints]


def test_poses_are_between_frames_of_their_own_chain(result: Result) -> None:
    ends = [(pose.parent, pose.child) for pose in result.every_transform]
    assert ("instrument", "base_link") in ends
    assert ends[-2:] == [("left_link_6", "left_hand"), ("right_link_6", "right_hand")]
    assert result.arm is not None
    assert result.arm.frame("tip", "right/A") == "right_hand"
    assert result.arm.frame("base", "P1") == "base_link"
    assert result.arm.frame("target", "left/A") == "target_left/A"


def test_a_format_of_one_chain_holds_the_one_that_is_named(results: Path, tmp_path: Path) -> None:
    right = read_result(results, chain="right")
    assert right.arm is not None
    out = tmp_path / "right.xml"
    out.write_bytes(write_foreign(right, "mjcf").content)
    assert b"left" not in out.read_bytes()
    arm = torso_robot().chains["right"]
    q = np.random.default_rng(0).uniform(-1, 1, (4, len(arm.joints)))
    _, expected = arm.forward(q, right.arm.values)
    again = tmp_path / "right.urdf"
    read_foreign(out).write(again)
    moved = type(arm).from_urdf(again, "right_hand")
    np.testing.assert_allclose(moved.forward(q)[1], expected, atol=1e-9)
    assert write_foreign(right, "dh").content.count(b"right_") == 6


@pytest.mark.parametrize("form", ["mjcf", "dh"])
def test_a_format_of_one_chain_asks_which(
    form: str, result: Result, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(InputError, match="several chains; expected the name of one of left, right"):
        write_foreign(result, form)
    assert cli("export", results, "--format", form) == 2
    assert "--chain NAME" in capsys.readouterr().err
    assert cli("export", results, "--format", form, "--chain", "rihgt") == 2
    assert "did you mean 'right'?" in capsys.readouterr().err


def test_a_robot_that_was_not_the_one_is_refused(results: Path) -> None:
    data = (results / "calibrated.urdf").read_text()
    other = data.replace('name="right_3"', 'name="right_three"')
    assert other != data
    try:
        (results / "calibrated.urdf").write_text(other)
        with pytest.raises(InputError, match=r"the joints differ from those in calibrated\.urdf"):
            read_result(results)
    finally:
        (results / "calibrated.urdf").write_text(data)


def test_the_tip_to_track_is_that_of_a_chain_of_the_result(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    urdf, result, device = (
        results / name for name in ("calibrated.urdf", "result.json", "no.yaml")
    )
    tracked = TrackOptions(urdf, None, device, result=result, chain="right")
    assert tracked.model().chain.ends == ("base_link", "right_hand")
    alone = TrackOptions(urdf, "left_hand", device)
    assert alone.model().chain.ends == ("base_link", "left_hand")
    with pytest.raises(InputError, match="a tip and a chain; expected only one of them"):
        TrackOptions(urdf, "left_hand", device, result=result, chain="left").model()
    for given, message in (
        (("--result", result), "several chains; expected the name of one of left, right"),
        (("--result", result, "--chain", "lift"), "did you mean 'left'?"),
        ((), "no tip; expected --tip LINK, or --result"),
    ):
        assert cli("track", urdf, "--device", device, *given) == 2
        assert message in capsys.readouterr().err


def test_a_chain_that_is_tracked_is_as_sure_as_it_was_calibrated(results: Path) -> None:
    """The calibrated URDF and the result tell of one chain what the job tells of the robot."""
    job = CalibrationJob.load(results.parent / "calibration.yaml")
    solution = job.run().solution
    robot = torso_robot().laid_out["right"]
    alone = ArmModel.from_urdf(results / "calibrated.urdf", "right_hand")
    q = np.random.default_rng(1).uniform(-1, 1, (3, len(robot.joints)))
    own = q[:, [robot.joints.index(name) for name in alone.joints]]
    calibration = read_uncertainty(results / "result.json", alone)
    names, factor = calibration.folded(alone)
    as_tracked = sensitivity(alone, {}, names, own)
    arm_names, covariance = solution.arm_covariance
    in_the_job = sensitivity(robot, solution.values, arm_names, q)
    np.testing.assert_allclose(as_tracked.position, in_the_job.position, atol=1e-9)
    stated, expected = (
        np.sqrt(np.einsum("nij,jk,nik->ni", at.jacobian, cov, at.jacobian))
        for at, cov in ((as_tracked, factor @ factor.T), (in_the_job, covariance))
    )
    np.testing.assert_allclose(stated, expected, rtol=1e-3)
