"""Exports of an arm, read back by the libraries that users read them with: the same poses.

Of a calibrated arm, and of one that has whatever a URDF may have.
"""

from __future__ import annotations

import io
import json
import re
import shutil
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
import yaml
from foreign import exported, result_of
from lxml import etree

from suta_calib.arrays import FloatArray
from suta_calib.device import read_device
from suta_calib.device.formats import decoder_for
from suta_calib.errors import InputError
from suta_calib.exchange import Result, read_foreign, write_foreign
from suta_calib.exchange.result import CalibratedArm
from suta_calib.geometry.numbers import homogeneous, rotation_from_rpy
from suta_calib.model.arm import ArmModel

# m and, of a rotation matrix, its elements.
SAME: Final = 1e-9
LONG: Final = "joint_" + "x" * 200
# Pitches at the singularity of rpy, and a hair beside it; names as CAD programs make them.
AWKWARD: Final = (
    # Name, type, xyz, rpy, axis, mimic.
    ("Gelenk für α & β", "revolute", "0.1 0 0.2", f"0.3 {np.pi / 2!r} -0.2", "0 0 1", ""),
    ("the 2nd joint", "prismatic", "0 0.05 0.1", f"1 {-np.pi / 2 + 1e-10!r} 2", "0 1 0", ""),
    ("fixed <plate>", "fixed", "1e-17 0 0.3", f"{np.pi!r} 0 {-np.pi!r}", "", ""),
    (LONG, "continuous", "0.2 0.1 0", f"0 {np.pi / 2 - 1e-7!r} 0", "0.6 0 0.8", ""),
    ("follower", "revolute", "0.1 0 0", "0 0 0", "0 0 -1", LONG),
    ('it\'s "quoted"', "revolute", "0.12 -0.3 0.02", "-3 -1.5707963 3", "1 0 0", ""),
)
MOVES: Final = dict(
    zip(("x", "y", "z", "rx", "ry", "rz"), (1e-3, -2e-3, 5e-4, 0.01, -0.02, 0.015), strict=True),
    offset=0.03,
)
SPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'


def urdf(folder: Path, rows: tuple[tuple[str, ...], ...]) -> Path:
    """A chain of these joints, each link with a mesh of a package and in another manner."""
    parts = ["<?xml version='1.0' encoding='utf-8'?>\n<robot name='ärm &amp; hand'>"]
    mesh = '<visual><geometry><mesh filename="package://no such/m ü.stl"/></geometry></visual>'
    links = ["base", *(f"link of {row[0]}" for row in rows[:-1]), "tip"]
    parts += [f"<link name={quoteattr(name)}>{mesh}</link>" for name in links]
    for (name, kind, xyz, rpy, axis, master), parent, child in zip(
        rows, links, links[1:], strict=False
    ):
        parts.append(
            f"<joint name={quoteattr(name)} type='{kind}'>\n <parent link={quoteattr(parent)}/>"
            f"<child link={quoteattr(child)}/><origin rpy='{rpy}'\n  xyz='{xyz}' />"
        )
        parts.append(f"<axis xyz='{axis}'/>" if axis else "")
        if kind in ("revolute", "prismatic"):
            parts.append("<limit lower='-2' upper='2' effort='1' velocity='1'/>")
        if master:
            parts.append(f"<mimic joint={quoteattr(master)} multiplier='-0.5' offset='0.1'/>")
        parts.append("</joint>")
    path = folder / "arm with ü.urdf"
    path.write_text("\n".join([*parts, "</robot>"]), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def results_by_name(result: Result, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Result]:
    """The plain one is without a follower, and without names that some formats refuse."""
    answers = {"calibrated": result}
    for name, rows in (("awkward", AWKWARD), ("plain", AWKWARD[:4])):
        model = ArmModel.from_urdf(urdf(tmp_path_factory.mktemp(name), rows), "tip")
        owners = {joint.name for joint in model.chain.joints}
        values = {
            n: p.nominal + MOVES.get(p.key, 0.0) * (p.owner in owners)
            for n, p in model.offered.items()
        }
        answers[name] = result_of(model, values, model.chain.path.with_name("result.json"))
    return answers


def arms(*names: str) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("name", names)


@pytest.fixture
def arm(name: str, results_by_name: dict[str, Result]) -> CalibratedArm:
    return arm_in(results_by_name[name])


def arm_in(result: Result) -> CalibratedArm:
    assert result.arm is not None
    return result.arm


def readings(arm: CalibratedArm) -> FloatArray:
    return np.random.default_rng(0).uniform(-1.5, 1.5, (12, len(arm.model.joints)))


def poses(model: ArmModel, q: FloatArray, values: Any = None) -> FloatArray:
    """(n, 4, 4)."""
    return np.array([homogeneous(*pose) for pose in zip(*model.forward(q, values), strict=True)])


def expected(arm: CalibratedArm) -> FloatArray:
    """(n, 4, 4) poses of the calibrated arm."""
    return poses(arm.model, readings(arm), arm.values)


def check_urdf(arm: CalibratedArm, path: Path) -> None:
    """The URDF makes these poses of raw readings."""
    there = poses(ArmModel.from_urdf(path, "tip"), readings(arm))
    np.testing.assert_allclose(there, expected(arm), atol=SAME)


@arms("calibrated", "awkward")
def test_the_calibration_moved_the_arm(arm: CalibratedArm) -> None:
    """Or the comparisons below would compare nominal arms."""
    nominal = arm.model.forward(readings(arm))[1]
    assert np.linalg.norm(nominal - expected(arm)[:, :3, 3], axis=1).min() > 1e-3


@arms("calibrated", "awkward")
def test_urdf(
    name: str, arm: CalibratedArm, results_by_name: dict[str, Result], tmp_path: Path
) -> None:
    yourdfpy = pytest.importorskip("yourdfpy")
    path = exported(results_by_name[name], "urdf", tmp_path)
    check_urdf(arm, path)
    robot = yourdfpy.URDF.load(str(path), load_meshes=False, build_collision_scene_graph=False)
    for q, pose in zip(readings(arm), expected(arm), strict=True):
        robot.update_cfg(dict(zip(arm.model.joints, q, strict=True)))
        there = robot.get_transform("tip", arm.model.chain.base)
        np.testing.assert_allclose(there, pose, atol=SAME)
    # The rest of the file is as it was.
    assert (b"package://no such/m \xc3\xbc.stl" in path.read_bytes()) == (name == "awkward")


@arms("calibrated", "awkward")
def test_mjcf(
    name: str, arm: CalibratedArm, results_by_name: dict[str, Result], tmp_path: Path
) -> None:
    mujoco = pytest.importorskip("mujoco")
    path = exported(results_by_name[name], "mjcf", tmp_path)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for q, pose in zip(readings(arm), expected(arm), strict=True):
        by_joint = dict(zip(arm.model.joints, q, strict=True))
        if name == "awkward":
            # MuJoCo keeps a follower by a constraint, which kinematics alone do not heed.
            by_joint["follower"] = -0.5 * by_joint[LONG] + 0.1
        for joint, value in by_joint.items():
            data.joint(joint).qpos[0] = value
        mujoco.mj_kinematics(model, data)
        site = data.site("tip")
        np.testing.assert_allclose(site.xpos, pose[:3, 3], atol=SAME)
        np.testing.assert_allclose(site.xmat.reshape(3, 3), pose[:3, :3], atol=SAME)
    followers = [[0.1, -0.5, 0, 0, 0]] if name == "awkward" else np.zeros((0, 5))
    np.testing.assert_array_equal(model.eq_data[:, :5], followers)


# ── xacro ────────────────────────────────────────────────────────────────────────────────────
def expanded(path: Path) -> Path:
    """A xacro file, run through xacro."""
    xacro = pytest.importorskip("xacro")
    made = path.with_suffix(".urdf")
    made.write_text(xacro.process_file(str(path)).toxml(), encoding="utf-8")
    return made


def as_xacro(
    arm: CalibratedArm, names: Iterable[str]
) -> tuple[etree._Element, dict[str, etree._Element]]:
    """The nominal URDF as a xacro file, and its joints, some without their origins."""
    text = re.sub(r"<\?xml[^>]*\?>", "", arm.model.chain.path.read_text(encoding="utf-8"))
    root = etree.fromstring(text.replace("<robot ", f"<robot {SPACE} ", 1))
    joints = {joint.get("name"): joint for joint in root.iterchildren("joint")}
    for name in names:
        for origin in joints[name].findall("origin"):
            joints[name].remove(origin)
    return root, joints


@arms("calibrated", "plain")
def test_xacro_yaml(
    name: str, arm: CalibratedArm, results_by_name: dict[str, Result], tmp_path: Path
) -> None:
    """Keys are child links of joints that move; what fixed joints changed by is said."""
    made = write_foreign(results_by_name[name], "xacro-yaml")
    path = made.write(tmp_path / made.file)[0]
    moving = [joint for joint in arm.model.chain.joints if joint.moving]
    links = {joint.child.removesuffix("_link"): joint.name for joint in moving}
    origins = yaml.safe_load(path.read_text(encoding="utf-8"))["kinematics"]
    assert list(origins) == [*links, "hash"]
    assert origins["hash"].startswith("calib_")
    # What the file has no place for is written by hand, as the sentences say.
    sentence = re.compile(r"fixed joint (.+), which .*\. Write (<origin .*/>) for it")
    by_hand = dict(match.groups() for match in map(sentence.search, made.care) if match)
    assert len(by_hand) == len(made.care)
    root, joints = as_xacro(arm, {*links.values(), *by_hand})
    for joint, text in by_hand.items():
        joints[joint].append(etree.fromstring(text))
    file = etree.Element("{http://www.ros.org/wiki/xacro}property", name="k")
    file.set("value", f"${{xacro.load_yaml('{path}')['kinematics']}}")
    root.insert(0, file)
    for link, joint in links.items():
        origin = etree.SubElement(joints[joint], "origin")
        for key, numbers in (("xyz", ("x", "y", "z")), ("rpy", ("roll", "pitch", "yaw"))):
            origin.set(key, " ".join(f"${{k['{link}']['{number}']}}" for number in numbers))
    (tmp_path / "arm.xacro").write_bytes(etree.tostring(root))
    check_urdf(arm, expanded(tmp_path / "arm.xacro"))


UR = (("shoulder_pan", "shoulder"), ("shoulder_lift", "upper_arm"), ("elbow", "forearm"))
UR += tuple((f"wrist_{k}", f"wrist_{k}") for k in (1, 2, 3))


@pytest.mark.parametrize("prefix", ["", "left_"])
def test_xacro_yaml_as_universal_robots_loads_it(prefix: str, tmp_path: Path) -> None:
    """A description of that shape, with its names: it reads six links, and a prefix is its own."""
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
        f'<robot name="ur" {SPACE}><xacro:property name="tf" value="{prefix}"/>'
        "<xacro:property name=\"k\" value=\"${xacro.load_yaml('kin.yaml')['kinematics']}\"/>"
        f"{text}</robot>"
    )
    drawn = {"x": 0.1, "y": 0.0, "z": 0.2, "roll": 1.57, "pitch": 0.0, "yaw": 0.0}
    kinematics.write_text(yaml.safe_dump({"kinematics": {link: dict(drawn) for _, link in UR}}))
    arm = ArmModel.from_urdf(arm_file, f"{prefix}tool0")
    random = np.random.default_rng(0)
    moving = {joint.name for joint in arm.chain.joints if joint.moving}
    geometry = [p for p in arm.parameters.values() if p.owner in moving]
    values = {p.name: p.nominal + random.normal(0, 0.01) for p in geometry}
    values[f"{prefix}tool0.y"] = 0.0025
    made = write_foreign(result_of(arm, values, tmp_path), "xacro-yaml")
    q = random.uniform(-2, 2, (5, 6))
    there = arm.forward(q, {n: v for n, v in values.items() if "tool0" not in n})
    made.write(kinematics)
    keys = list(yaml.safe_load(kinematics.read_text())["kinematics"])
    assert keys == [*(link for _, link in UR), "hash"]
    loaded = ArmModel.from_urdf(arm_file, f"{prefix}tool0").forward(q)
    for mine, theirs in zip(loaded, there, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-10)
    assert made.assessment.level == "care"
    note = f"the fixed joint {prefix}flange-tool0, which changed by 2.500 mm and 0.000°"
    assert note in str(made.assessment.notes)


@arms("calibrated", "plain")
def test_xacro_macro(
    name: str, arm: CalibratedArm, results_by_name: dict[str, Result], tmp_path: Path
) -> None:
    path = exported(results_by_name[name], "xacro", tmp_path)
    root, joints = as_xacro(arm, arm.origins)
    include = etree.Element("{http://www.ros.org/wiki/xacro}include", filename=str(path))
    root.insert(0, include)
    for joint in arm.origins:
        tag = "{http://www.ros.org/wiki/xacro}calibrated_origin"
        joints[joint].append(etree.Element(tag, joint=joint))
    (tmp_path / "arm.xacro").write_bytes(etree.tostring(root))
    check_urdf(arm, expanded(tmp_path / "arm.xacro"))


def as_macro(result: Result, prefix: str = "${prefix}") -> str:
    """The nominal URDF as descriptions have it: joints in a macro, names with a prefix."""
    text = arm_in(result).model.chain.path.read_text(encoding="utf-8")
    inside = re.search(r"<robot [^>]*>(.*)</robot>", text, re.DOTALL)
    assert inside is not None
    named = re.sub(r'(<joint\s+name=")', rf"\1{prefix}", inside[1])
    macro = f'<xacro:macro name="arm" params="prefix">{named}</xacro:macro>'
    return f'<robot name="r" {SPACE}>\n{macro}\n<xacro:arm prefix=""/>\n</robot>'


@pytest.mark.parametrize("end", ["\n", "\r\n", ""])
def test_xacro_patch(end: str, result: Result, tmp_path: Path) -> None:
    """What patch makes of the files, and xacro of that, is the calibrated arm."""
    source = tmp_path / "urdf" / "arm.xacro"
    source.parent.mkdir()
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
    check_urdf(arm_in(result), expanded(source))


def test_xacro_patch_of_several_files(result: Result, tmp_path: Path) -> None:
    """Joints are looked for where they are said to be, and none is left out."""
    text = as_macro(result)
    joints = re.findall(r"<joint\b.*?</joint>", text, re.DOTALL)
    here, there = tmp_path / "a.xacro", tmp_path / "sub" / "b.xacro"
    there.parent.mkdir()
    less = text
    for joint in joints[3:]:
        less = less.replace(joint, "")
    here.write_text(less)
    with pytest.raises(InputError, match=r"no joint .*joint_4.*--source"):
        write_foreign(result, "xacro-patch", source=str(here))
    there.write_text(f"<robot {SPACE}>{''.join(joints[3:])}</robot>")
    both = (str(here), str(there))
    assert b"+++ b/sub/b.xacro" in write_foreign(result, "xacro-patch", source=both).content
    there.write_text(text)
    with pytest.raises(InputError, match="each joint in only one of the files"):
        write_foreign(result, "xacro-patch", source=both)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('"${prefix}joint_4"', '"${prefix}joint_${k}"', "a joint that could be"),
        ('<joint name="${prefix}joint_3"', '<joint name="${prefix}joint_4"', "as the one in line"),
        ("<origin", '<xacro:insert_block name="origin"/><x', "an origin that a macro inserts"),
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


# ── Numbers ──────────────────────────────────────────────────────────────────────────────────
@arms("calibrated", "awkward")
def test_joint_offsets(
    name: str, arm: CalibratedArm, results_by_name: dict[str, Result], tmp_path: Path
) -> None:
    path = exported(results_by_name[name], "joint-offsets", tmp_path)
    offsets = yaml.safe_load(path.read_text(encoding="utf-8"))["joint_offsets"]
    assert list(offsets) == list(arm.model.joints)
    for joint, entry in offsets.items():
        value, slides = arm.values.get(f"{joint}.offset", 0.0), arm.model.units[joint] == "m"
        assert entry["offset_m" if slides else "offset_rad"] == pytest.approx(value, abs=1e-15)
        shown = 1e3 * value if slides else np.rad2deg(value)
        assert entry["offset_mm" if slides else "offset_deg"] == pytest.approx(shown, abs=1e-12)
    # A length is no offset, and it is said that it is missing.
    made = write_foreign(results_by_name[name], "joint-offsets")
    assert ("joint_4.z" if name == "calibrated" else f"{LONG}.z") in made.lost
    assert made.assessment.level == "care"


@arms("calibrated", "awkward")
def test_numpy_and_json_hold_everything(
    name: str, arm: CalibratedArm, results_by_name: dict[str, Result]
) -> None:
    made = write_foreign(results_by_name[name], "numpy")
    assert not made.left_out
    arrays = np.load(io.BytesIO(made.content), allow_pickle=False)
    plain = json.loads(write_foreign(results_by_name[name], "json").content)
    for data in (arrays, plain):
        assert list(map(str, data["joints"])) == list(arm.model.joints)
        values = dict(zip(map(str, data["parameters"]), map(float, data["values"]), strict=True))
        assert values == dict(arm.values)
        covariance = np.reshape(data["covariance"], arm.calibration.covariance.shape)
        np.testing.assert_array_equal(covariance, arm.calibration.covariance)
        joints = map(str, data["origins"])
        for joint, origin in zip(joints, data["T_parent_joint"], strict=True):
            xyz, rpy = arm.model.origins(arm.values)[joint]
            np.testing.assert_allclose(origin, homogeneous(rotation_from_rpy(rpy), xyz), atol=1e-15)


def degrees(motor: dict[str, int], encoder: float) -> float:
    """What LeRobot shows of an encoder, as its drivers compute it."""
    middle = (motor["range_min"] + motor["range_max"]) / 2
    return (encoder - motor["homing_offset"] - middle) * 360 / 4096


@pytest.mark.parametrize(("bus", "sign"), [("feetech", -1), ("dynamixel", 1)])
def test_lerobot_in_and_out_again(bus: str, sign: int, result: Result, tmp_path: Path) -> None:
    """The device of the new file reads what the old one's did and the offset, whatever the mode.

    So do LeRobot's degrees. A gripper, which is no joint of the chain, stays as it is.
    """
    arm = arm_in(result)
    names = [*(f"motor_{joint}" for joint in arm.model.joints), "gripper"]
    numbers = {"homing_offset": 120, "range_min": 700, "range_max": 3300}
    motors = {name: {"id": k, "drive_mode": k % 2, **numbers} for k, name in enumerate(names, 1)}
    before = tmp_path / "before.json"
    before.write_text(json.dumps(motors))
    renamed = [f"motor_{joint}={joint}" for joint in arm.model.joints]
    options = {"calibration": str(before), "motors": renamed, "bus": bus}
    after = exported(result, "lerobot", tmp_path, **options)
    changed = json.loads(after.read_text())
    encoder = np.linspace(1500, 2700, len(motors)).round()
    angles = []
    for path, held in ((before, motors), (after, changed)):
        read_foreign(path, bus="lines").write(tmp_path / "device.yaml")
        decoder = decoder_for(read_device(tmp_path / "device.yaml"))
        ticks = [e + sign * m["homing_offset"] for e, m in zip(encoder, held.values(), strict=True)]
        (reading,) = decoder.feed(f"\n{','.join(map(str, ticks))}\n".encode(), 0.0)
        angles.append(reading.angles)
    offsets = [*(arm.values.get(f"{joint}.offset", 0.0) for joint in arm.model.joints), 0.0]
    np.testing.assert_allclose(angles[1] - angles[0], offsets, atol=0.51 * np.pi / 2048)
    assert sum(abs(offset) > 0.005 for offset in offsets) >= 2
    for motor, offset in zip(names, offsets, strict=True):
        change = degrees(changed[motor], 2000) - degrees(motors[motor], 2000)
        assert change * -sign == pytest.approx(np.rad2deg(offset), abs=0.5 * 360 / 4096 + 1e-9)
        assert {**changed[motor], "homing_offset": 0} == {**motors[motor], "homing_offset": 0}
    assert changed["gripper"] == motors["gripper"]


@pytest.mark.parametrize(("bus", "sign"), [("feetech", -1), ("dynamixel", 1)])
def test_the_middle_of_lerobots_range_becomes_the_zero_of_the_urdf(
    bus: str, sign: int, result: Result, tmp_path: Path
) -> None:
    """With the device's file, whose zeros and motors are those of the samples.

    A motor's own position does not change, so what it will report is its homing offset more or
    less. In LeRobot's degrees the joint is then 0 where the URDF has it.
    """
    arm = arm_in(result)
    joints = arm.model.joints
    motors = {
        f"motor_{k}": {
            "id": 10 + k,
            "drive_mode": 0,
            "homing_offset": 100 * k,
            "range_min": 0 if k == 1 else 700,
            "range_max": 4095 if k == 1 else 3300,
        }
        for k in range(len(joints))
    }
    before, device = tmp_path / "before.json", tmp_path / "device.yaml"
    before.write_text(json.dumps(motors))
    # Motors in another order than the joints, every second one turned round.
    zeros = [2000 + 30 * k - 90 for k in range(len(joints))]
    specs = [
        {"name": joint, "id": 10 + (k + 1) % len(joints), "sign": 1 - 2 * (k % 2), "zero": zeros[k]}
        for k, joint in enumerate(joints)
    ]
    device.write_text(yaml.safe_dump({"port": "p", "format": bus, "joints": specs}))
    changed = json.loads(
        exported(
            *(result, "lerobot", tmp_path), calibration=str(before), device=str(device)
        ).read_text()
    )
    for k, (joint, spec) in enumerate(zip(joints, specs, strict=True)):
        name = f"motor_{(k + 1) % len(joints)}"
        old, new = motors[name], changed[name]
        offset = arm.values.get(f"{joint}.offset", 0.0)
        reported = spec["zero"] - spec["sign"] * offset * 4096 / (2 * np.pi)
        own = reported - sign * old["homing_offset"]
        middle = (new["range_min"] + new["range_max"]) / 2
        apart = own + sign * new["homing_offset"] - middle
        assert abs((apart + 2048) % 4096 - 2048) <= 1.0
        # LeRobot gives a Feetech's offset 11 bits beside its sign.
        assert abs(new["homing_offset"]) <= 2047 or bus == "dynamixel"
        if old["range_max"] == 4095:
            assert (new["range_min"], new["range_max"]) == (0, 4095)
            continue
        # No end of the range is beyond a stop of the joint.
        ends = np.array([new["range_min"], new["range_max"]]) - sign * new["homing_offset"]
        stops = np.array([old["range_min"], old["range_max"]]) - sign * old["homing_offset"]
        assert ends[0] >= stops[0] - 1
        assert ends[1] <= stops[1] + 1


@pytest.mark.parametrize(
    ("bus", "expected"), [("feetech", 2000 + 140 - 4096), ("dynamixel", -2000 - 140)]
)
def test_an_offset_beyond_half_a_turn(
    bus: str, expected: int, result: Result, tmp_path: Path
) -> None:
    """A Feetech reports a place within a turn; a Dynamixel would report a turn less or more."""
    arm = arm_in(result)
    sign = -1 if bus == "feetech" else 1
    motor = {"drive_mode": 0, "homing_offset": -2000 * sign, "range_min": 0, "range_max": 4095}
    before, device = tmp_path / "koch.json", tmp_path / "device.yaml"
    joints = arm.model.joints
    before.write_text(json.dumps({j: {"id": k, **motor} for k, j in enumerate(joints)}))
    offsets = [arm.values.get(f"{j}.offset", 0.0) * 4096 / (2 * np.pi) for j in joints]
    # 140 ticks above the middle of the whole turn, and a turn more.
    specs = [
        {"name": joint, "id": k, "zero": round(2047.5 + 140 + 4096 + offset)}
        for k, (joint, offset) in enumerate(zip(joints, offsets, strict=True))
    ]
    device.write_text(yaml.safe_dump({"port": "p", "format": bus, "joints": specs}))
    files = {"calibration": str(before), "device": str(device)}
    changed = json.loads(exported(result, "lerobot", tmp_path, **files).read_text())
    found = [changed[joint]["homing_offset"] for joint in joints]
    assert found == pytest.approx([expected] * len(joints), abs=1.0)


def test_a_zero_outside_the_range_is_refused(result: Result, tmp_path: Path) -> None:
    joints = arm_in(result).model.joints
    motor = {"drive_mode": 0, "homing_offset": 0, "range_min": 2000, "range_max": 2100}
    before, device = tmp_path / "before.json", tmp_path / "device.yaml"
    before.write_text(json.dumps({j: {"id": k, **motor} for k, j in enumerate(joints)}))
    specs = [{"name": joint, "id": k, "zero": 3000} for k, joint in enumerate(joints)]
    device.write_text(yaml.safe_dump({"port": "p", "format": "feetech", "joints": specs}))
    with pytest.raises(InputError, match="ticks from the middle; expected a zero within the range"):
        exported(result, "lerobot", tmp_path, calibration=str(before), device=str(device))


def test_a_urdf_without_offsets_is_for_encoders_that_have_them(
    result: Result, tmp_path: Path
) -> None:
    """Of readings plus offsets it gives the pose that the other one gives of raw readings."""
    arm = arm_in(result)
    offsets = [arm.values.get(f"{joint}.offset", 0.0) for joint in arm.model.joints]
    q = np.random.default_rng(3).uniform(-0.5, 0.5, (5, len(offsets)))
    poses = []
    for options, readings in (({}, q), ({"without_offsets": True}, q + offsets)):
        path = exported(result, "urdf", tmp_path, **options)
        poses.append(ArmModel.from_urdf(path, arm.alone.tip).forward(readings))
    for one, other in zip(*poses, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-8)
    assert max(map(abs, offsets)) > 0.005
