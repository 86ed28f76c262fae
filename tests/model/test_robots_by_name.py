"""Arms of example-robot-data by name, and where each ends."""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import numpy as np
import pytest
from simulated import ROBOTS

from suta_calib import robots
from suta_calib.errors import InputError, MissingExtraError, UrdfError
from suta_calib.model.arm import ArmModel

installed = pytest.mark.skipif(not ROBOTS.is_dir(), reason="example-robot-data is not installed")


@installed
@pytest.mark.parametrize(
    ("name", "tip", "joints"),
    [
        ("ur5", "tool0", 6),
        ("ur3", "tool0", 6),  # beside a ur3.urdf that is no robot
        ("panda", "panda_hand_tcp", 7),  # between the fingers
        ("kinova", "j2s6s200_end_effector", 6),
        ("so101", "gripper_frame_link", 5),  # without the jaw
        ("tiago", "arm_tool_link", 8),  # neither a wheel nor the head
        ("xarm7", "link_eef", 7),
    ],
)
def test_an_arm_ends_at_its_tool(name: str, tip: str, joints: int) -> None:
    arm = robots.load(name)
    assert (arm.tip, len(arm.joints)) == (tip, joints)


@installed
def test_it_is_the_arm_of_its_file_and_takes_another_tip() -> None:
    arm = robots.load("ur5", tip="wrist_1_link", base="base_link")
    assert arm.chain.path == robots.path("ur5") == ROBOTS / "ur_description/urdf/ur5_robot.urdf"
    same = ArmModel.from_urdf(arm.chain.path, "wrist_1_link", "base_link")
    q = np.full(len(arm.joints), 0.3)
    np.testing.assert_array_equal(arm.forward(q)[1], same.forward(q)[1])


@installed
def test_files_that_are_called_alike_are_called_by_their_folders() -> None:
    assert {"anymal_b_simple", "anymal_c_simple"} <= set(robots.names())
    assert "anymal" not in robots.names()
    assert list(robots.names()) == sorted(robots.names())


@installed
@pytest.mark.parametrize("name", ["baxter", "talos_reduced", "anymal_b_simple"])
def test_a_body_with_limbs_says_where_they_end(name: str) -> None:
    with pytest.raises(UrdfError, match="no single arm") as refused:
        robots.load(name)
    ends = re.findall("'([^']+)'", refused.value.hint)
    assert len(ends) > 1
    for end in ends[:4]:
        assert robots.load(name, tip=end).tip == end


@installed
def test_a_name_that_is_nearly_right_is_recognised() -> None:
    with pytest.raises(InputError, match=r"found 'UR55'.*did you mean 'ur5'\?"):
        robots.load("UR55")
    with pytest.raises(InputError, match=r"the names are .*, panda, "):
        robots.path("zzzzzzzz")


def test_without_the_robots_it_says_how_to_install_them(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(name: str) -> Path:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(robots, "distribution", nothing)
    robots._files.cache_clear()
    with pytest.raises(MissingExtraError, match=r"pip install 'suta_calib\[robots\]'"):
        robots.names()
