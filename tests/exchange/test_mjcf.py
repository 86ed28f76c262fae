"""MJCF as MuJoCo means it: every body and site of the URDF is where MuJoCo has it."""

from __future__ import annotations

import re
import time
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from cli_job import cli

from suta_calib.errors import InputError, MissingExtraError
from suta_calib.exchange import read_foreign
from suta_calib.model.arm import ArmModel

mujoco = pytest.importorskip("mujoco")

HEAD = '<mujoco model="m"><compiler angle="radian"/>'
INERTIA = '<inertial pos="0 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>'


def two_joints(name: str, place: str = "", inside: str = "", **options: str) -> str:
    """A body with two links that turn, and a site at the end."""
    site = options.get("site", '<site name="NAMEtip" pos="0.1 0.02 0"/>')
    text = (
        f'<body name="NAMEbase" {place}>{INERTIA}{inside}<body name="NAME1" pos="0 0 0.1">'
        f'{INERTIA}<joint name="NAMEj1" axis="0 0 1"/><body name="NAME2" pos="0.2 0 0">{INERTIA}'
        f'<joint name="NAMEj2" axis="0 1 0"/>{site}</body></body></body>'
    )
    return text.replace("NAME", name)


def world(inside: str, more: str = "", head: str = HEAD) -> str:
    return f"{head}{more}<worldbody>{inside}</worldbody></mujoco>"


def defaults(name: str, inside: str) -> str:
    return f'<default><default class="{name}">{inside}</default></default>'


BOX = '<geom size="0.1"/>'
FILES = {
    "two roots": world(
        two_joints("a", 'pos="0.3 0 0.75"') + two_joints("b", 'pos="-0.3 0 0.75" euler="0 0 1"')
    ),
    "frame": world(
        '<frame pos="0.1 0 0" euler="0 0 0.5"><frame quat="2 1 0 0">'
        + two_joints("a", 'pos="0 0 1"')
        + "</frame></frame>"
    ),
    "site default": world(
        two_joints("a", site='<site name="tip" class="t"/>'),
        defaults("t", '<site pos="0.08 0.01 0" euler="0 0.3 0"/>'),
    ),
    "several defaults": world(
        f'<body childclass="p" pos="0 1 0">{BOX}<joint name="j1"/>'
        '<joint name="j2" pos="0.1 0.2 0" class="p"/><site name="s" class="q"/>'
        f'<body name="b" axisangle="0 3 0 1">{BOX}<joint type="slide" name="j3" '
        'axis="3 0 4" pos="1 2 3"/></body></body>',
        defaults("p", '<joint axis="1 1 0" ref="0.3"/>')
        + defaults("q", '<site fromto="0 0 0 0.1 0.2 0.3" type="capsule" size=".01"/>'),
    ),
    "degrees": world(
        two_joints("a", 'euler="10 20 30"')
        + two_joints("b", 'xyaxes="0 1 0 1 0 1"')
        + two_joints("c", 'zaxis="1 1 1"'),
        head='<mujoco><compiler eulerseq="ZYX"/>',
    ),
    "replicate": world(
        '<replicate count="3" offset="0.5 0 0" euler="0 0 0.4">'
        + two_joints("a", 'pos="0.1 0 0"')
        + "</replicate>"
    ),
    "include and attach": world(
        f'<body name="holder" pos="0 1 0" euler="0 45 0">{BOX}<frame pos="0 0 0.1">'
        '<attach model="part" body="abase" prefix="left_"/></frame></body>',
        '<include file="included.xml"/><asset><model name="part" file="attached.xml"/></asset>',
        '<mujoco><compiler angle="degree"/>',
    ),
    "shapes that are not there": world(
        two_joints("a", 'pos="1 2 3"', '<geom type="mesh" mesh="m"/>').replace(
            "<site ", '<site material="c" '
        ),
        '<asset><mesh name="m" file="nowhere.stl"/><texture name="t" type="2d" file="no.png"/>'
        '<material name="c" texture="t"/></asset>',
    ).replace("</mujoco>", '<actuator><motor joint="aj1"/></actuator></mujoco>'),
    "names": world(
        '<body name="arm" mocap="true"/><body name="cube" pos="0 1 2" euler="1 0 0">'
        f'<freejoint/>{BOX}<site name="cube" pos="0 0 1"/></body><body>{BOX}<joint axis="0 0 1"/>'
        '<site pos="1 0 0"/><site name="world_fixed"/></body><site name="on_floor" pos="1 0 0"/>'
    ),
}


def judged(path: Path, urdf: str) -> int:
    """How many frames agree with MuJoCo at random joint positions; all that have a name there."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data, random = mujoco.MjData(model), np.random.default_rng(1)
    arm = pin.buildModelFromXML(urdf)
    arm_data, compared = arm.createData(), 0
    for _ in range(4):
        q = pin.neutral(arm)
        for k in range(model.njnt):
            if model.jnt_type[k] == int(mujoco.mjtJoint.mjJNT_FREE):
                continue
            reading = float(random.uniform(-3, 3))
            data.qpos[model.jnt_qposadr[k]] = reading
            body = int(model.jnt_bodyid[k])
            name = model.joint(k).name or f"{model.body(body).name or f'body_{body}'}_joint"
            joint = arm.joints[arm.getJointId(name)]
            both = (np.cos(reading), np.sin(reading)) if joint.nq == 2 else (reading,)
            q[joint.idx_q : joint.idx_q + joint.nq] = both
        mujoco.mj_kinematics(model, data)
        pin.framesForwardKinematics(arm, arm_data, q)
        for frame in arm.frames:
            for get in (data.body, data.site):
                try:
                    known = get(frame.name)
                except KeyError:
                    continue
                pose = arm_data.oMf[arm.getFrameId(frame.name, pin.FrameType.BODY)]
                np.testing.assert_allclose(pose.translation, known.xpos, rtol=0, atol=1e-9)
                turned = known.xmat.reshape(3, 3)
                np.testing.assert_allclose(pose.rotation, turned, rtol=0, atol=1e-9)
                compared += 1
                break
    return compared // 4


@pytest.mark.parametrize("name", FILES)
def test_every_frame_is_where_mujoco_has_it(name: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(FILES[name])
    for file, owner in (("included.xml", "c"), ("attached.xml", "a")):
        body = two_joints(owner, 'pos="0 0 7"')
        (tmp_path / file).write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    found = read_foreign(path, "mjcf")
    if name == "shapes that are not there":
        # Their absence is no obstacle; MuJoCo, the judge, needs a file without them.
        text = re.sub(r"<asset>.*</asset>|<geom[^>]*/>", "", path.read_text())
        path.write_text(text.replace('material="c"', ""))
    model = mujoco.MjModel.from_xml_path(str(path))
    named = [model.body(k).name for k in range(model.nbody)]
    named += [model.site(k).name for k in range(model.nsite)]
    assert judged(path, found.text()) == len(set(filter(None, named)))


def test_a_body_with_several_joints_and_a_chain_of_it(tmp_path: Path) -> None:
    """Readings are MuJoCo's: a reference is taken off there, and limits are the model's."""
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco model="m"><worldbody><body name="a"><geom size="1"/><joint name="j1" axis="0 0 1" '
        'ref="90" range="10 100"/><joint name="j2" type="slide" axis="1 0 0" range="-1 2" ref="0.5"'
        '/><site name="tip" pos="1 0 0"/></body></worldbody></mujoco>'
    )
    found = read_foreign(path, "mjcf")
    found.write(tmp_path / "arm.urdf")
    arm = ArmModel.from_urdf(tmp_path / "arm.urdf", "tip")
    assert arm.joints == ("j1", "j2")
    assert [(j.lower, j.upper) for j in arm.chain.moving] == [
        pytest.approx(np.deg2rad([10, 100])),
        (-1.0, 2.0),
    ]
    _, position = arm.forward([np.pi / 2, 0.5])
    np.testing.assert_allclose(position, [1, 0, 0], atol=1e-11)
    _, position = arm.forward([np.pi, 0.75])
    np.testing.assert_allclose(position, [0, 1.25, 0], atol=1e-11)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (f"<!DOCTYPE a [<!ENTITY b 'c'>]>{HEAD}</mujoco>", "a document type or an entity"),
        ("<robot/>", "the root element <robot>; expected <mujoco>"),
        ("<mujoco>", "arm.xml:1: found text that is not XML"),
        (f"{HEAD}<worldbody/></mujoco>", "found a model without revolute or prismatic joints"),
        (
            f"{HEAD}<worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>",
            "found a model without revolute or prismatic joints",
        ),
        (
            f"{HEAD}<worldbody>{two_joints('a')}<body><joint name='any' type='ball'/>"
            "<geom size='1'/></body></worldbody></mujoco>",
            "found the joint 'any', which turns about any axis (ball)",
        ),
        (FILES["two roots"].replace('"0.3 0 0.75"', '"0 nan 0"'), "numbers that are not finite"),
        (
            f"{HEAD}\n<worldbody><bodi/></worldbody></mujoco>",
            "arm.xml:2: found a model that MuJoCo",
        ),
        (f"{HEAD}<include file='nowhere.xml'/></mujoco>", "Error opening file 'nowhere.xml'"),
        (f"{HEAD}\n<include file='deep.xml'/></mujoco>", "deep.xml:1: "),
        (f"{HEAD}\n<include file='/dev/zero'/></mujoco>", "arm.xml:2: /dev/zero: found "),
    ],
)
def test_refusals(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(text)
    (tmp_path / "deep.xml").write_text("<mujoco><include file='/dev/zero'/></mujoco>")
    with pytest.raises(InputError) as refused:
        read_foreign(path, "mjcf")
    assert says in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


@pytest.mark.slow
def test_a_model_without_end_is_ended(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    many = f"<replicate count='100000' offset='1 0 0'>{two_joints('a')}</replicate>"
    path.write_text(f"{HEAD}<worldbody>{many}</worldbody></mujoco>")
    started = time.monotonic()
    with pytest.raises(InputError, match="takes more than"):
        read_foreign(path, "mjcf")
    assert time.monotonic() - started < 35


def test_what_the_urdf_does_not_say_is_said(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    equality = '<equality><joint joint1="aj1" joint2="aj2"/></equality>'
    path.write_text(f"{HEAD}<worldbody>{two_joints('a')}</worldbody>{equality}</mujoco>")
    found = read_foreign(path, "mjcf")
    assert found.assessment.level == "care"
    assert "equality constraints" in found.notes[0]
    path.write_text(FILES["names"])
    found = read_foreign(path, "mjcf")
    assert found.assessment.level == "good"
    assert found.remarks == (
        "cube floats freely (cube_joint); it may be the base of a chain.",
        "arm is moved from outside (mocap); in the URDF it is fixed.",
        "A body and a site are both called cube; the URDF calls the site cube_site.",
    )


def test_without_mujoco_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(FILES["frame"])
    monkeypatch.setattr("suta_calib.optional_packages.find_spec", lambda _: None)
    with pytest.raises(MissingExtraError, match=r"pip install 'suta_calib\[formats\]'"):
        read_foreign(path, "mjcf")
    assert cli("import", path, "--out", tmp_path / "arm.urdf") == 2
    assert not (tmp_path / "arm.urdf").exists()
