"""What a URDF holds beside kinematics spoils no chain: it is read, and noted where it is odd."""

from __future__ import annotations

import math
import resource
from pathlib import Path

import numpy as np
import pytest
from cli_job import cli
from hypothesis import given
from hypothesis import strategies as st

from suta_calib.errors import UrdfError
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import COMPLIANCE

SOUND = """\
<robot name="r">
  <link name="base"/>
  <link name="a"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="tip"/>
  <link name="finger"/>
  <joint name="j1" type="revolute">
    <origin xyz="0 0 0.5" rpy="0.1 0.2 0.3"/><parent link="base"/><child link="a"/>
    <axis xyz="0 1 1"/><limit lower="-1" upper="1" effort="10" velocity="1"/></joint>
  <joint name="j2" type="prismatic">
    <origin xyz="0.3 0 0"/><parent link="a"/><child link="tip"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="10" velocity="1"/></joint>
  <joint name="grip" type="revolute">
    <parent link="tip"/><child link="finger"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
</robot>
"""
Q = np.array([[0.3, -0.2], [-0.9, 0.4]])
BASE, TIP = '<link name="base"/>', '<link name="tip"/>'
FAULTS = {
    # What is replaced by what, and the note, if the file deserves one.
    "effort off the chain": ('effort="1" ', 'effort="-1" ', "effort is ignored (line 15)"),
    "effort on the chain": ('effort="10"', 'effort="-1"', "effort is ignored (lines 9, 12)"),
    "velocity": ('velocity="1"', 'velocity="-1"', "velocity is ignored (lines 9, 12, 15)"),
    "effort in words": ('effort="1" ', 'effort="unknown" ', "effort is ignored (line 15)"),
    "limits the other way round": ('lower="-1" upper="1"', 'lower="1" upper="-1"', "below its"),
    "loose link": (BASE, '<link name="world"/>' + BASE, "'world'"),
    "limits of nothing": (
        'lower="-1" upper="1"',
        'lower="0" upper="0"',
        "below its upper limit is",
    ),
    "no limit": ('<limit lower="-1" upper="1" effort="10" velocity="1"/>', "", "without <limit>"),
    "no name": ('<robot name="r">', "<robot>", "<robot> has no name (line 1)"),
    "no effort": (' effort="10" velocity="1"', "", ""),
    "left-over xacro": ("<link name", '<xacro:property name="x" value="1"/><link name', "not exp"),
    "negative mass": ('<mass value="2"/>', '<mass value="-2"/>', "impossible mass"),
    "no mass": ('<mass value="2"/>', "", "impossible mass"),
    "no inertia": ('<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>', "", ""),
    "odd inertia": ('ixx="1"', 'ixx="-1e9 x"', ""),
    "missing mesh": (
        TIP,
        '<link name="tip"><visual><geometry><mesh filename="a.stl"/></geometry></visual></link>',
        "",
    ),
    "shape without a size": (
        TIP,
        '<link name="tip"><collision><geometry><box/></geometry></collision></link>',
        "",
    ),
    "material twice": (
        BASE,
        '<material name="m"><color rgba="1 0 0 1"/></material><material name="m"/>' + BASE,
        "",
    ),
    "unknown tags": (BASE, "<thing><joint/></thing>" + BASE, ""),
    "odd origin off the chain": (
        '<parent link="tip"/>',
        '<origin xyz="a b"/><parent link="tip"/>',
        "not three numbers",
    ),
    "odd axis off the chain": ('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>', ""),
    "odd type off the chain": ('"grip" type="revolute"', '"grip" type="hinge"', ""),
    "calibration and safety": (
        '<axis xyz="1 0 0"/>',
        '<axis xyz="1 0 0"/><calibration falling="x"/><safety_controller/><dynamics damping="?"/>',
        "",
    ),
}


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", FAULTS)
def test_the_same_kinematics(name: str, tmp_path: Path) -> None:
    old, new, note = FAULTS[name]
    text = SOUND.replace(old, new)
    assert text != SOUND
    sound = ArmModel.from_urdf(written(tmp_path / "sound.urdf", SOUND), "tip")
    arm = ArmModel.from_urdf(written(tmp_path / "arm.urdf", text), "tip")
    for found, expected in zip(arm.forward(Q), sound.forward(Q), strict=True):
        np.testing.assert_array_equal(found, expected)
    assert sound.chain.notes == ()
    assert len(arm.chain.notes) == bool(note)
    assert note in "".join(arm.chain.notes)
    # What was calibrated can be written, and is read again.
    arm.write_urdf(tmp_path / "calibrated.urdf", {"j2.x": 0.31})
    again = ArmModel.from_urdf(tmp_path / "calibrated.urdf", "tip")
    assert again.parameters["j2.x"].nominal == 0.31


def test_a_joint_whose_limits_are_none_has_none(tmp_path: Path) -> None:
    text = SOUND.replace('lower="-1" upper="1" effort', 'lower="2" upper="-2" effort', 1)
    arm = ArmModel.from_urdf(written(tmp_path / "arm.urdf", text), "tip")
    assert [(j.lower, j.upper) for j in arm.chain.moving] == [(-math.inf, math.inf), (-1.0, 1.0)]


def test_init_reads_it_and_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    urdf = written(tmp_path / "arm.urdf", SOUND.replace('effort="1" ', 'effort="-1" '))
    assert cli("init", urdf, "--tip", "tip", "--out", tmp_path / "job") == 0
    assert f"{urdf}: an impossible limit of effort is ignored (line 15)." in capsys.readouterr().err
    assert (tmp_path / "job/calibration.yaml").is_file()


@pytest.mark.parametrize(
    ("old", "new", "tip", "says"),
    [
        (TIP, f'<xacro:if value="1">{TIP}</xacro:if>', "tip", ":5: .*<xacro:if>"),
        ("</robot>", "<xacro:hand/></robot>", "hand_tip", ":16: .*<xacro:hand>"),
        (
            '<origin xyz="0.3 0 0"/>',
            '<xacro:insert_block name="origin"/>',
            *("tip", ":11: .*<xacro:insert_block>"),
        ),
    ],
)
def test_what_xacro_would_have_made_is_missed(
    old: str, new: str, tip: str, says: str, tmp_path: Path
) -> None:
    """Left-over tags are the cause where the chain is not whole."""
    with pytest.raises(UrdfError, match=f"{says}.*run xacro first"):
        ArmModel.from_urdf(written(tmp_path / "arm.urdf", SOUND.replace(old, new)), tip)


def test_masses_stay_what_they_were(tmp_path: Path) -> None:
    """Gravity's torque needs mass and centre, of what hangs fixed on a joint too."""
    text = SOUND.replace(
        '<link name="finger"/>',
        '<link name="finger"><inertial><mass value="0.5"/><inertia ixx="1" ixy="0" ixz="0" '
        'iyy="1" iyz="0" izz="1"/></inertial></link>',
    )
    arm = ArmModel.from_urdf(written(tmp_path / "arm.urdf", text), "tip")
    assert [load.mass for load in arm.loads] == [2.0, 0.5]
    np.testing.assert_allclose(arm.loads[0].centre, [0.1, 0, 0])
    assert arm.select(f"j1.{COMPLIANCE}")


@given(data=st.sampled_from(["-1", "nan", "1e999", "", "x", "0x1", "1 2"]), at=st.integers(0, 6))
def test_whatever_stands_beside_kinematics(
    tmp_path_factory: pytest.TempPathFactory, data: str, at: int
) -> None:
    parts = SOUND.split('"10"')
    pieces = [*SOUND.split('effort="10"'), *parts][: 2 + at % 2]
    text = f'effort="{data}"'.join(pieces) if at % 2 == 0 else SOUND.replace('"2"', f'"{data}"')
    path = tmp_path_factory.getbasetemp() / "beside.urdf"
    path.write_text(text if text.endswith("</robot>\n") else SOUND)
    assert ArmModel.from_urdf(path, "tip").joints == ("j1", "j2")


def long_chain(n: int) -> str:
    text = "".join(f'<link name="l{k}"/>' for k in range(n + 1))
    for k in range(n):
        text += (
            f'<joint name="j{k}" type="continuous"><origin xyz="0.05 0 0.02"/><parent link="l{k}"/>'
            f'<child link="l{k + 1}"/><axis xyz="{k % 2} 0 1"/></joint>'
        )
    return f'<robot name="long">{text}</robot>'


def test_a_chain_of_two_hundred_joints(tmp_path: Path) -> None:
    """It took 45 s of the processor, in which Pinocchio's workspace was made for each joint."""
    urdf = written(tmp_path / "long.urdf", long_chain(200))
    before = resource.getrusage(resource.RUSAGE_SELF)
    assert cli("init", urdf, "--tip", "l200", "--out", tmp_path / "job") == 0
    after = resource.getrusage(resource.RUSAGE_SELF)
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 8.0
    with pytest.raises(UrdfError, match=r"found 251 joints that move .*; expected at most 250"):
        ArmModel.from_urdf(written(tmp_path / "longer.urdf", long_chain(251)), "l251")
