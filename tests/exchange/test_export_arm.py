"""Exports of an arm, read back by the libraries that users read them with: the same poses."""

from __future__ import annotations

import io
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import yaml
from lxml import etree

from suta_calib.arrays import FloatArray
from suta_calib.device import read_device
from suta_calib.device.formats import decoder_for
from suta_calib.errors import InputError
from suta_calib.exchange import Result, read_foreign, write_foreign
from suta_calib.exchange.result import CalibratedArm
from suta_calib.geometry.numbers import homogeneous, rotation_from_rpy
from suta_calib.job.dh_file import read_dh_table
from suta_calib.model.arm import ArmModel
from suta_calib.tracking.uncertainty import CalibrationUncertainty

# m and, of a rotation matrix, its elements.
SAME = 1e-9


def readings(result: Result, n: int = 20) -> FloatArray:
    assert result.arm is not None
    joints = result.arm.model.joints
    return np.random.default_rng(0).uniform(-1.5, 1.5, (n, len(joints)))


def wanted(result: Result) -> FloatArray:
    """(n, 4, 4) poses of the calibrated arm."""
    assert result.arm is not None
    rotation, position = result.arm.model.forward(readings(result), result.arm.values)
    return np.array([homogeneous(*pose) for pose in zip(rotation, position, strict=True)])


def exported(result: Result, form: str, folder: Path, **options: object) -> Path:
    found = write_foreign(result, form, **options)
    return found.write(folder / found.file)[0]


def through_pinocchio(result: Result, urdf: Path) -> FloatArray:
    rotation, position = ArmModel.from_urdf(urdf, "tip").forward(readings(result))
    return np.array([homogeneous(*pose) for pose in zip(rotation, position, strict=True)])


def test_the_calibration_moved_the_arm(result: Result) -> None:
    """Or the comparisons below would compare nominal arms."""
    assert result.arm is not None
    nominal = result.arm.model.forward(readings(result))[1]
    assert np.linalg.norm(nominal - wanted(result)[:, :3, 3], axis=1).min() > 1e-3


def test_urdf(result: Result, tmp_path: Path) -> None:
    yourdfpy = pytest.importorskip("yourdfpy")
    path = exported(result, "urdf", tmp_path)
    np.testing.assert_allclose(through_pinocchio(result, path), wanted(result), atol=SAME)
    robot = yourdfpy.URDF.load(str(path), load_meshes=False, build_collision_scene_graph=False)
    assert result.arm is not None
    for q, pose in zip(readings(result), wanted(result), strict=True):
        robot.update_cfg(dict(zip(result.arm.model.joints, q, strict=True)))
        np.testing.assert_allclose(robot.get_transform("tip", "base_link"), pose, atol=SAME)


@pytest.mark.parametrize("convention", ["classic", "modified"])
def test_dh(convention: str, result: Result, tmp_path: Path) -> None:
    path = exported(result, "dh", tmp_path, convention=convention)
    poses = read_dh_table(path).poses(readings(result))
    np.testing.assert_allclose(poses, wanted(result), atol=SAME)


def test_mjcf(result: Result, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(exported(result, "mjcf", tmp_path)))
    data = mujoco.MjData(model)
    assert result.arm is not None
    for q, pose in zip(readings(result), wanted(result), strict=True):
        for name, value in zip(result.arm.model.joints, q, strict=True):
            data.joint(name).qpos[0] = value
        mujoco.mj_kinematics(model, data)
        site = data.site("tip")
        np.testing.assert_allclose(site.xpos, pose[:3, 3], atol=SAME)
        np.testing.assert_allclose(site.xmat.reshape(3, 3), pose[:3, :3], atol=SAME)


def expanded(path: Path) -> Path:
    """A xacro file, run through xacro."""
    xacro = pytest.importorskip("xacro")
    urdf = path.with_suffix(".urdf")
    urdf.write_text(xacro.process_file(str(path)).toxml(), encoding="utf-8")
    return urdf


def as_xacro(result: Result, include: str) -> etree._Element:
    """The nominal URDF as a xacro file."""
    assert result.arm is not None
    text = result.arm.model.chain.path.read_text(encoding="utf-8")
    text = re.sub(r"<\?xml[^>]*\?>", "", text)
    space = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    return etree.fromstring(re.sub(r"<robot ", f"<robot {space} ", text).replace("@", include))


def test_xacro_yaml(result: Result, tmp_path: Path) -> None:
    """Keys are child links of joints that move; what fixed joints changed by is said."""
    found = write_foreign(result, "xacro-yaml")
    path = found.write(tmp_path / found.file)[0]
    assert result.arm is not None
    chain = result.arm.model.chain
    links = {
        joint.child.removesuffix("_link"): joint.name for joint in chain.joints if joint.moving
    }
    origins = yaml.safe_load(path.read_text())["kinematics"]
    assert list(origins) == [*links, "hash"]
    assert origins["hash"].startswith("calib_")
    root = as_xacro(result, "")
    file = etree.Element("{http://www.ros.org/wiki/xacro}property", name="k")
    file.set("value", f"${{xacro.load_yaml('{path}')['kinematics']}}")
    root.insert(0, file)
    names = {joint.get("name"): joint for joint in root.iterchildren("joint")}
    for link, joint in links.items():
        origin = names[joint].find("origin")
        if origin is None:
            origin = etree.SubElement(names[joint], "origin")
        for key, numbers in (("xyz", ("x", "y", "z")), ("rpy", ("roll", "pitch", "yaw"))):
            origin.set(key, " ".join(f"${{k['{link}']['{number}']}}" for number in numbers))
    # What the file has no place for is written by hand, as the sentences say.
    for sentence in found.care:
        said = re.search(r"fixed joint (\S+), which .*: write (<origin .*/>) into", sentence)
        assert said is not None
        joint = names[said[1]]
        for origin in joint.findall("origin"):
            joint.remove(origin)
        joint.append(etree.fromstring(said[2]))
    (tmp_path / "arm.xacro").write_bytes(etree.tostring(root))
    poses = through_pinocchio(result, expanded(tmp_path / "arm.xacro"))
    np.testing.assert_allclose(poses, wanted(result), atol=SAME)


UR = (("shoulder_pan", "shoulder"), ("shoulder_lift", "upper_arm"), ("elbow", "forearm"))
UR += tuple((f"wrist_{k}", f"wrist_{k}") for k in (1, 2, 3))


@pytest.mark.parametrize("prefix", ["", "left_"])
def test_xacro_yaml_as_universal_robots_loads_it(prefix: str, tmp_path: Path) -> None:
    """A description of that shape, with its names: it reads six links, and a prefix is its own."""
    space = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    links = ["base_link", *(f"{link}_link" for _, link in UR), "flange", "tool0"]
    text = "".join(f'<link name="${{tf}}{link}"/>' for link in links)
    for parent, (joint, link) in zip(links, UR, strict=False):
        xyz, rpy = (
            " ".join(f"${{k['{link}']['{number}']}}" for number in numbers)
            for numbers in (("x", "y", "z"), ("roll", "pitch", "yaw"))
        )
        text += (
            f'<joint name="${{tf}}{joint}_joint" type="revolute"><parent link="${{tf}}{parent}"/>'
            f'<child link="${{tf}}{link}_link"/><origin xyz="{xyz}" rpy="{rpy}"/>'
            '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )
    for parent, child in (("wrist_3_link", "flange"), ("flange", "tool0")):
        text += (
            f'<joint name="${{tf}}{parent}-{child}" type="fixed"><parent link="${{tf}}{parent}"/>'
            f'<child link="${{tf}}{child}"/><origin xyz="0 0 0.01"/></joint>'
        )
    arm_file, kinematics = tmp_path / "ur.xacro", tmp_path / "kin.yaml"
    arm_file.write_text(
        f'<robot name="ur" {space}><xacro:property name="tf" value="{prefix}"/>'
        "<xacro:property name=\"k\" value=\"${xacro.load_yaml('kin.yaml')['kinematics']}\"/>"
        f"{text}</robot>"
    )
    drawn = {"x": 0.1, "y": 0.0, "z": 0.2, "roll": 1.57, "pitch": 0.0, "yaw": 0.0}
    nominal = {"kinematics": {link: dict(drawn) for _, link in UR}}
    kinematics.write_text(yaml.safe_dump(nominal))
    arm = ArmModel.from_urdf(arm_file, f"{prefix}tool0")
    random = np.random.default_rng(0)
    moving = {joint.name for joint in arm.chain.joints if joint.moving}
    geometry = [p for p in arm.parameters.values() if p.owner in moving]
    values = {p.name: p.nominal + random.normal(0, 0.01) for p in geometry}
    values[f"{prefix}tool0.y"] = 0.0025
    known = CalibrationUncertainty(tmp_path, (), np.zeros((0, 0)), values, "none", (), {})
    found = write_foreign(Result(tmp_path, CalibratedArm(arm, known), ()), "xacro-yaml")
    q = random.uniform(-2, 2, (5, 6))
    expected = arm.forward(q, {n: v for n, v in values.items() if "tool0" not in n})
    found.write(kinematics)
    assert list(yaml.safe_load(kinematics.read_text())["kinematics"]) == [
        *(link for _, link in UR),
        "hash",
    ]
    loaded = ArmModel.from_urdf(arm_file, f"{prefix}tool0").forward(q)
    for mine, theirs in zip(loaded, expected, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-10)
    assert found.assessment.level == "care"
    assert f"the fixed joint {prefix}flange-tool0, which changed by 2.500 mm and 0.000°" in str(
        found.assessment.notes
    )


def test_xacro_macro(result: Result, tmp_path: Path) -> None:
    path = exported(result, "xacro", tmp_path)
    root = as_xacro(result, "")
    include = etree.Element("{http://www.ros.org/wiki/xacro}include", filename=str(path))
    root.insert(0, include)
    assert result.arm is not None
    for joint in root.iterchildren("joint"):
        if joint.get("name") in result.arm.origins:
            for origin in joint.findall("origin"):
                joint.remove(origin)
            tag = "{http://www.ros.org/wiki/xacro}calibrated_origin"
            joint.append(etree.Element(tag, joint=joint.get("name")))
    (tmp_path / "arm.xacro").write_bytes(etree.tostring(root))
    poses = through_pinocchio(result, expanded(tmp_path / "arm.xacro"))
    np.testing.assert_allclose(poses, wanted(result), atol=SAME)


def test_joint_offsets(result: Result, tmp_path: Path) -> None:
    assert result.arm is not None
    path = exported(result, "joint-offsets", tmp_path)
    offsets = yaml.safe_load(path.read_text())["joint_offsets"]
    assert list(offsets) == list(result.arm.model.joints)
    for joint, told in offsets.items():
        value = result.arm.values.get(f"{joint}.offset", 0.0)
        assert told["offset_rad"] == pytest.approx(value, abs=1e-15)
        assert told["offset_deg"] == pytest.approx(np.rad2deg(value), abs=1e-12)
    # A length is no offset, and it is said that it is missing.
    found = write_foreign(result, "joint-offsets")
    assert "joint_4.z" in found.lost
    assert found.assessment.level == "care"


def degrees(motor: dict[str, int], encoder: float) -> float:
    """What LeRobot shows of an encoder, as its drivers compute it."""
    middle = (motor["range_min"] + motor["range_max"]) / 2
    return (encoder - motor["homing_offset"] - middle) * 360 / 4096


def test_lerobot(result: Result, tmp_path: Path) -> None:
    assert result.arm is not None
    motors = {
        f"motor_{k}": {
            "id": k,
            "drive_mode": 0,
            "homing_offset": 100 * k - 300,
            "range_min": 700,
            "range_max": 3300,
        }
        for k in range(1, len(result.arm.model.joints) + 1)
    }
    before = tmp_path / "before.json"
    before.write_text(json.dumps(motors))
    names = [f"motor_{k}={name}" for k, name in enumerate(result.arm.model.joints, 1)]
    path = exported(result, "lerobot", tmp_path, calibration=str(before), motors=names)
    after = json.loads(path.read_text())
    for motor, joint in zip(motors, result.arm.model.joints, strict=True):
        change = degrees(after[motor], 2000) - degrees(motors[motor], 2000)
        offset = np.rad2deg(result.arm.values.get(f"{joint}.offset", 0.0))
        assert change == pytest.approx(offset, abs=0.5 * 360 / 4096 + 1e-9)
        assert {**after[motor], "homing_offset": 0} == {**motors[motor], "homing_offset": 0}


@pytest.mark.parametrize(("bus", "sign"), [("feetech", -1), ("dynamixel", 1)])
def test_lerobot_in_and_out_again(bus: str, sign: int, result: Result, tmp_path: Path) -> None:
    """The device of the new file reads what the old one's did and the offset, whatever the mode.

    A gripper, which is no joint of the chain, stays as it is.
    """
    assert result.arm is not None
    joints, values = result.arm.model.joints, result.arm.values
    numbers = {"homing_offset": 120, "range_min": 700, "range_max": 3300}
    motors = {
        name: {"id": k, "drive_mode": k % 2, **numbers}
        for k, name in enumerate((*joints, "gripper"), 1)
    }
    before = tmp_path / "before.json"
    before.write_text(json.dumps(motors))
    after = exported(result, "lerobot", tmp_path, calibration=str(before), bus=bus)
    changed = json.loads(after.read_text())
    encoder = np.linspace(1500, 2700, len(motors)).round()
    readings = []
    for path, held in ((before, motors), (after, changed)):
        read_foreign(path, bus="lines").write(tmp_path / "device.yaml")
        decoder = decoder_for(read_device(tmp_path / "device.yaml"))
        ticks = [e + sign * m["homing_offset"] for e, m in zip(encoder, held.values(), strict=True)]
        (reading,) = decoder.feed(f"\n{','.join(map(str, ticks))}\n".encode(), 0.0)
        readings.append(reading.angles)
    offsets = [*(values.get(f"{joint}.offset", 0.0) for joint in joints), 0.0]
    np.testing.assert_allclose(readings[1] - readings[0], offsets, atol=0.51 * np.pi / 2048)
    assert sum(abs(offset) > 0.005 for offset in offsets) >= 2
    assert changed["gripper"] == motors["gripper"]


def test_numpy_and_json_hold_everything(result: Result, tmp_path: Path) -> None:
    assert result.arm is not None
    found = write_foreign(result, "numpy")
    assert not found.left_out
    arrays = np.load(io.BytesIO(found.content), allow_pickle=False)
    told = json.loads(write_foreign(result, "json").content)
    for data in (arrays, told):
        values = dict(zip(map(str, data["parameters"]), map(float, data["values"]), strict=True))
        assert values == dict(result.arm.values)
        np.testing.assert_array_equal(data["covariance"], result.arm.calibration.covariance)
        at = list(map(str, data["origins"])).index("joint_4")
        origin = np.asarray(data["T_parent_joint"])[at]
        xyz, rpy = result.arm.model.origins(result.arm.values)["joint_4"]
        np.testing.assert_allclose(origin, homogeneous(rotation_from_rpy(rpy), xyz), atol=1e-15)


# ── A patch of one's own xacro ───────────────────────────────────────────────────────────────
SPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'


def as_macro(result: Result, prefix: str = "${prefix}") -> str:
    """The nominal URDF as descriptions have it: joints in a macro, names with a prefix."""
    assert result.arm is not None
    text = result.arm.model.chain.path.read_text(encoding="utf-8")
    inside = re.search(r"<robot [^>]*>(.*)</robot>", text, re.DOTALL)
    assert inside is not None
    named = re.sub(r'(<joint\s+name=")', rf"\1{prefix}", inside[1])
    macro = f'<xacro:macro name="arm" params="prefix">{named}</xacro:macro>'
    return f'<robot name="r" {SPACE}>\n{macro}\n<xacro:arm prefix=""/>\n</robot>'


@pytest.mark.parametrize("end", ["\n", "\r\n", ""])
def test_xacro_patch(end: str, result: Result, tmp_path: Path) -> None:
    """What patch makes of the files, and xacro of that, is the calibrated arm."""
    (tmp_path / "urdf").mkdir()
    source = tmp_path / "urdf" / "arm.xacro"
    text = as_macro(result).replace("\n", end or "\n") + end
    source.write_bytes(text.encode())
    path = exported(result, "xacro-patch", tmp_path, source=str(source))
    if (patch := shutil.which("patch")) is None:
        pytest.skip("there is no program patch")
    command = [patch, "-p1", "--binary", "-i", str(path)]
    subprocess.run(command, cwd=source.parent, check=True, capture_output=True)
    changed = source.read_bytes()
    assert changed != text.encode()
    # Nothing but numbers of origins changed.
    numbers = re.compile(rb"(<origin)[^>]*>")
    assert numbers.sub(rb"\1", changed) == numbers.sub(rb"\1", text.encode())
    poses = through_pinocchio(result, expanded(source))
    np.testing.assert_allclose(poses, wanted(result), atol=SAME)


def test_xacro_patch_of_several_files(result: Result, tmp_path: Path) -> None:
    """Joints are looked for where they are said to be, and none is left out."""
    whole = as_macro(result)
    joints = re.findall(r"<joint\b.*?</joint>", whole, re.DOTALL)
    here, there = tmp_path / "a.xacro", tmp_path / "sub" / "b.xacro"
    there.parent.mkdir()
    kept = whole
    for joint in joints[3:]:
        kept = kept.replace(joint, "")
    here.write_text(kept)
    with pytest.raises(InputError, match=r"no joint .*joint_4.*--source"):
        write_foreign(result, "xacro-patch", source=str(here))
    there.write_text(f"<robot {SPACE}>{''.join(joints[3:])}</robot>")
    text = write_foreign(result, "xacro-patch", source=(str(here), str(there))).content.decode()
    assert "+++ b/sub/b.xacro" in text
    there.write_text(whole)
    with pytest.raises(InputError, match="each joint in one of the files"):
        write_foreign(result, "xacro-patch", source=(str(here), str(there)))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('"${prefix}joint_4"', '"${prefix}joint_${k}"', "what may be"),
        ('<joint name="${prefix}joint_3"', '<joint name="${prefix}joint_4"', "as line"),
        ("<origin", '<xacro:insert_block name="origin"/><x', "an origin that a macro puts in"),
        ("</robot>", "", "cannot be edited in place"),
    ],
)
def test_what_a_patch_cannot_tell_apart(
    old: str, new: str, says: str, result: Result, tmp_path: Path
) -> None:
    source = tmp_path / "arm.xacro"
    text = as_macro(result)
    assert old in text
    source.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=says):
        write_foreign(result, "xacro-patch", source=str(source))


def test_a_patch_needs_a_xacro_file(result: Result) -> None:
    with pytest.raises(InputError, match=r"--source: found no .xacro file to patch"):
        write_foreign(result, "xacro-patch")
