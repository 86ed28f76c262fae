"""Models and devices of other programs: the same arm, the same angles."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from cli_job import cli
from foreign_samples import MOTORS, SAMPLES

from suta_calib.device import read_device
from suta_calib.device.formats import decoder_for
from suta_calib.errors import InputError
from suta_calib.exchange import read_foreign
from suta_calib.job.dh_file import read_dh_table
from suta_calib.model.arm import ArmModel


def test_a_dh_table_becomes_a_urdf(tmp_path: Path) -> None:
    path = SAMPLES["dh"](tmp_path).path
    out = tmp_path / "arm.urdf"
    assert cli("import", path, "--robot", "three", "--out", out) == 0
    arm = ArmModel.from_urdf(out, "tip")
    assert arm.chain.robot == "three"
    q = np.array([[0.3, -0.7, 0.05], [-1.0, 0.4, 0.1]])
    rotation, position = arm.forward(q)
    poses = read_dh_table(path).poses(q)
    np.testing.assert_allclose(position, poses[:, :3, 3], atol=1e-12)
    np.testing.assert_allclose(rotation, poses[:, :3, :3], atol=1e-12)


def test_lerobot_motors_become_a_device(tmp_path: Path) -> None:
    """Angles of ticks are LeRobot's degrees, from the middle of the range, whatever the mode."""
    path = SAMPLES["lerobot-calibration"](tmp_path).path
    out = tmp_path / "device.yaml"
    words = ("--port", "/dev/ttyUSB3", "--motors", "elbow_flex=joint_3", "--out", out)
    assert cli("import", path, *words) == 0
    spec = read_device(out)
    assert spec.port == "/dev/ttyUSB3"
    assert spec.names == ("shoulder_pan", "shoulder_lift", "joint_3")
    assert spec.format == "feetech"
    assert [joint.number for joint in spec.joints] == [m["id"] for m in MOTORS.values()]
    decoder = decoder_for(spec)
    (reading,) = decoder.feed(b"\n2500,2500,1000\n", 0.0)
    for angle, ticks, motor in zip(
        reading.angles, (2500, 2500, 1000), MOTORS.values(), strict=True
    ):
        middle = (motor["range_min"] + motor["range_max"]) / 2
        wanted = (ticks - middle) * math.tau / 4096
        assert angle == pytest.approx(wanted, abs=0.5 * math.tau / 4096 + 1e-9)


@pytest.mark.parametrize("bus", ["feetech", "dynamixel", "lines"])
def test_a_drive_mode_turns_no_reading_round(bus: str, tmp_path: Path) -> None:
    """LeRobot 0.4 `_normalize` in degrees: (position - middle) 360 / 4095 of every servo."""
    path = SAMPLES["lerobot-calibration"](tmp_path).path
    found = read_foreign(path, bus=bus)
    found.write(tmp_path / "device.yaml")
    assert [joint.sign for joint in read_device(tmp_path / "device.yaml").joints] == [1, 1, 1]
    assert any("drive_mode of shoulder_lift is not applied" in each for each in found.remarks)


@pytest.mark.parametrize(
    ("file", "bus", "why"),
    [
        ("koch_follower/blue.json", "dynamixel", "'koch_follower' has 'koch' in it"),
        ("so_follower/blue.json", "feetech", "'so_follower' has 'so_follower' in it"),
        ("my_koch.json", "dynamixel", "'my_koch' has 'koch' in it"),
        ("so101.json", "feetech", "'so101' has 'so101' in it"),
        ("blue.json", "feetech", "LeRobot's arms have them if nothing says otherwise"),
    ],
)
def test_the_servos_are_those_of_lerobots_robot(
    file: str, bus: str, why: str, tmp_path: Path
) -> None:
    path = tmp_path / file
    path.parent.mkdir(exist_ok=True)
    SAMPLES["lerobot-calibration"](tmp_path).path.rename(path)
    found = read_foreign(path, "lerobot-calibration")
    assert any(f"are taken for {bus}: {why}." in each for each in found.remarks)
    found.write(tmp_path / "device.yaml")
    assert read_device(tmp_path / "device.yaml").format == bus


def test_a_pan_without_a_range_is_that_of_a_koch(tmp_path: Path) -> None:
    """LeRobot 0.6 `KochFollower.calibrate`: shoulder_pan and wrist_roll have 0 and 4095."""
    path = tmp_path / "blue.json"
    pan = MOTORS["shoulder_pan"] | {"range_min": 0, "range_max": 4095}
    path.write_text(json.dumps(MOTORS | {"shoulder_pan": pan}))
    found = read_foreign(path, "lerobot-calibration")
    assert any("the range of shoulder_pan is the whole turn" in each for each in found.remarks)


def test_motors_may_be_asked_by_another_program(tmp_path: Path) -> None:
    """Or must be, where the file does not tell their numbers."""
    path = SAMPLES["lerobot-calibration"](tmp_path).path
    out = tmp_path / "device.yaml"
    assert cli("import", path, "--bus", "lines", "--out", out) == 0
    assert (read_device(out).format, read_device(out).unit) == ("lines", "counts")
    path.write_text(path.read_text().replace('"id"', '"number"'))
    read_foreign(path, "lerobot-calibration").write(out)
    assert read_device(out).format == "lines"
    with pytest.raises(InputError, match="--bus: found dynamixel, and motors without a number"):
        read_foreign(path, "lerobot-calibration", bus="dynamixel")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('"homing_offset": -150', '"homing_offset": "x"', "shoulder_pan.homing_offset: found 'x'"),
        ('"range_min": 701', '"range_min": 1.5', "shoulder_pan.range_min: found 1.5"),
        ('"drive_mode": 0,', "", "shoulder_pan.drive_mode: found None"),
        ('"range_max": 3300', '"range_max": 701', "shoulder_pan: found a range from 701 to 701"),
        ("{", '{"motor_names": ["a"],', "lists by motor_names, as LeRobot wrote it until mid 2025"),
    ],
)
def test_motors_that_cannot_be_used(old: str, new: str, says: str, tmp_path: Path) -> None:
    path = SAMPLES["lerobot-calibration"](tmp_path).path
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=says):
        read_foreign(path, "lerobot-calibration")


def test_a_cell_of_thousands_of_digits_is_quoted_in_part(tmp_path: Path) -> None:
    path = SAMPLES["dh"](tmp_path).path
    path.write_text(
        path.read_text().replace("joint_2,revolute,", "joint_2,revolute,e" + "0" * 5000)
    )
    with pytest.raises(InputError) as refused:
        read_foreign(path, "dh")
    assert len(str(refused.value)) < 500
