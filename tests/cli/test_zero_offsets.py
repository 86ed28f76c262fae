"""``suta-calib baseline``: from readings and known poses to a URDF that agrees."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_job import Capture, answer, cli, printed, refused

from suta_calib.geometry.numbers import rpy_from_rotation, wrap
from suta_calib.measurements import Samples, write_samples
from suta_calib.model.arm import ArmModel

OFFSETS = np.array([0.1, -0.05, 0.2, 0.3, -0.15, 0.4])


@pytest.fixture(scope="module")
def arm(suta_urdf: Path) -> ArmModel:
    return ArmModel.from_urdf(suta_urdf, "tip")


def known(arm: ArmModel, count: int) -> Samples:
    """Readings in known poses."""
    q = np.random.default_rng(5).uniform(-1.5, 1.5, (count, 6))
    values = dict(zip((f"{j}.offset" for j in arm.joints), OFFSETS, strict=True))
    rotation, position = arm.forward(q, values)
    return Samples.from_arrays(arm.joints, q, position=position, rotation=rotation)


def pose_of(samples: Samples, row: int = 0, *, oriented: bool = True) -> str:
    assert samples.position is not None
    assert samples.rotation is not None
    numbers = 1e3 * samples.position[row]
    if oriented:
        numbers = np.append(numbers, np.degrees(rpy_from_rotation(samples.rotation[row])))
    return ",".join(repr(float(number)) for number in numbers)


def test_the_urdf_written_agrees_with_every_pose(arm: ArmModel, tmp_path: Path) -> None:
    samples, file, out = known(arm, 5), tmp_path / "r.csv", tmp_path / "out.urdf"
    write_samples(file, samples)
    command = ("baseline", arm.chain.path, "--tip", "tip", "--readings", file)
    found = answer(*command, "--out", out)
    assert found["status"] == "found"
    assert found["urdf"] == str(out)
    assert len(found["branches"]) == 1
    values = [found["offsets"][f"{joint}.offset"]["value"] for joint in arm.joints]
    assert np.abs(wrap(np.array(values) - OFFSETS)).max() < 1e-6
    rotation, position = ArmModel.from_urdf(out, "tip").forward(samples.q)
    assert np.allclose(position, samples.position, atol=1e-8)
    assert np.allclose(rotation, samples.rotation, atol=1e-8)


def test_no_input_is_replaced(arm: ArmModel, tmp_path: Path) -> None:
    file, urdf = tmp_path / "r.csv", tmp_path / "arm.urdf"
    write_samples(file, known(arm, 5))
    urdf.write_bytes(arm.chain.path.read_bytes())
    for out in (urdf, file):
        before = out.read_bytes()
        command = ("zero-offsets", urdf, "--tip", "tip", "--readings", file, "--out", out)
        assert f"{out}: found an input of the same command" in refused(*command)
        assert out.read_bytes() == before


def test_a_branch_is_chosen_by_number(arm: ArmModel, tmp_path: Path, capsys: Capture) -> None:
    samples, file = known(arm, 1), tmp_path / "r.csv"
    write_samples(file, Samples.from_arrays(arm.joints, samples.q))
    command = ["baseline", arm.chain.path, "--tip", "tip", "--readings", file]
    command += [f"--pose={pose_of(samples)}"]
    found = answer(*command)
    count = len(found["branches"])
    assert count > 1
    assert found["branch"] == 1
    errors = [
        np.abs(wrap(np.array(list(branch["offsets"].values())) - OFFSETS)).max()
        for branch in found["branches"]
    ]
    assert min(errors) < 1e-6
    assert f"{count} branches fit; this is number 1. Choose another with --branch N" in (
        printed(*command)
    )
    out = tmp_path / "last.urdf"
    assert answer(*command, "--branch", count, "--out", out)["branch"] == count
    _, position = ArmModel.from_urdf(out, "tip").forward(samples.q)
    assert np.allclose(position, samples.position, atol=1e-8)
    assert cli(*command, "--branch", count + 1) == 2
    assert f"--branch: found {count + 1}; expected 1 to {count}" in capsys.readouterr().err


def test_one_position_is_not_enough(arm: ArmModel, tmp_path: Path) -> None:
    samples, file, out = known(arm, 1), tmp_path / "r.csv", tmp_path / "out.urdf"
    write_samples(file, Samples.from_arrays(arm.joints, samples.q))
    command = ("baseline", arm.chain.path, "--tip", "tip", "--readings", file, "--out", out)
    said = printed(*command, f"--pose={pose_of(samples, oriented=False)}", code=1)
    assert "determined only together with" in said
    assert "Give more poses" in said
    assert not out.exists()


def test_poses_that_no_offsets_explain_exit_with_1(arm: ArmModel, tmp_path: Path) -> None:
    samples, file, out = known(arm, 3), tmp_path / "r.csv", tmp_path / "out.urdf"
    write_samples(file, Samples.from_arrays(arm.joints, samples.q))
    command = ["baseline", arm.chain.path, "--tip", "tip", "--readings", file, "--out", out]
    command += [f"--pose={x},0,0" for x in (5000, 6000, 7000)]
    assert answer(*command, code=1)["status"] == "no_fit"
    assert not out.exists()


@pytest.mark.parametrize(
    ("poses", "said"),
    [
        ([], "column 'x'"),
        (["1,2"], "--pose: found '1,2'; expected x,y,z or x,y,z,roll,pitch,yaw"),
        (["1,2,nan"], "--pose: found '1,2,nan'"),
        (["1,2,3"], "found 1 --pose for 2 rows"),
        (["1,2,3", "1,2,3,4,5,6"], "poses with and without orientation"),
    ],
)
def test_bad_poses_are_one_line(arm: ArmModel, tmp_path: Path, poses: list[str], said: str) -> None:
    file = tmp_path / "r.csv"
    write_samples(file, Samples.from_arrays(arm.joints, known(arm, 2).q))
    command = ["baseline", arm.chain.path, "--tip", "tip", "--readings", file]
    err = refused(*command, *(f"--pose={pose}" for pose in poses))
    assert said in err
