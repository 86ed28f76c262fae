"""Every export of an arm that has whatever a URDF may have, read back: the same poses."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Final
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
import yaml

from suta_calib.arrays import FloatArray
from suta_calib.exchange import Result, write_foreign
from suta_calib.exchange.result import CalibratedArm
from suta_calib.geometry.numbers import homogeneous, rotation_from_rpy
from suta_calib.job.dh_file import read_dh_table
from suta_calib.model.arm import ArmModel
from suta_calib.tracking.uncertainty import CalibrationUncertainty

# m and, of a rotation matrix, its elements.
SAME: Final = 1e-9
LONG: Final = "joint_" + "x" * 200
# Pitches at the singularity of rpy, and a hair beside it; names as CAD programs make them.
ARM: Final = (
    # Name, type, xyz, rpy, axis, mimic.
    ("Gelenk für α & β", "revolute", "0.1 0 0.2", f"0.3 {np.pi / 2!r} -0.2", "0 0 1", ""),
    ("the 2nd joint", "prismatic", "0 0.05 0.1", f"1 {-np.pi / 2 + 1e-10!r} 2", "0 1 0", ""),
    ("fixed <plate>", "fixed", "1e-17 0 0.3", f"{np.pi!r} 0 {-np.pi!r}", "", ""),
    (LONG, "continuous", "0.2 0.1 0", f"0 {np.pi / 2 - 1e-7!r} 0", "0.6 0 0.8", ""),
    ("follower", "revolute", "0.1 0 0", "0 0 0", "0 0 -1", LONG),
    ('it\'s "quoted"', "revolute", "0.12 -0.3 0.02", "-3 -1.5707963 3", "1 0 0", ""),
)
MOVES: Final = (
    ("x", 1e-3),
    ("y", -2e-3),
    ("z", 5e-4),
    ("rx", 0.01),
    ("ry", -0.02),
    ("rz", 0.015),
    ("offset", 0.03),
)


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


def result_of(path: Path) -> Result:
    """Every origin and offset moved; nothing was measured."""
    model = ArmModel.from_urdf(path, "tip")
    values = {p.name: p.nominal for p in model.offered.values()}
    for name in values:
        owner, _, key = name.rpartition(".")
        if key in dict(MOVES) and owner in {joint.name for joint in model.chain.joints}:
            values[name] += dict(MOVES)[key]
    known = CalibrationUncertainty(
        path.with_name("result.json"), (), np.zeros((0, 0)), values, "none", (), {}
    )
    return Result(known.path, CalibratedArm(model, known), (), None, {})


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return result_of(urdf(tmp_path_factory.mktemp("awkward"), ARM))


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """Without a follower, and without names that some formats refuse."""
    return result_of(urdf(tmp_path_factory.mktemp("plain"), (*ARM[:4],)))


def readings(result: Result) -> FloatArray:
    assert result.arm is not None
    joints = result.arm.model.joints
    return np.random.default_rng(0).uniform(-1.5, 1.5, (12, len(joints)))


def wanted(result: Result) -> FloatArray:
    assert result.arm is not None
    rotation, position = result.arm.model.forward(readings(result), result.arm.values)
    return np.array([homogeneous(*pose) for pose in zip(rotation, position, strict=True)])


def through_pinocchio(result: Result, path: Path) -> FloatArray:
    rotation, position = ArmModel.from_urdf(path, "tip").forward(readings(result))
    return np.array([homogeneous(*pose) for pose in zip(rotation, position, strict=True)])


def exported(result: Result, form: str, folder: Path, **options: object) -> Path:
    found = write_foreign(result, form, **options)
    return found.write(folder / found.file)[0]


def test_the_arm_is_as_awkward_as_it_seems(result: Result) -> None:
    assert result.arm is not None
    assert len(result.arm.model.joints) == 4
    nominal = result.arm.model.forward(readings(result))[1]
    assert np.linalg.norm(nominal - wanted(result)[:, :3, 3], axis=1).min() > 1e-3


def test_urdf(result: Result, tmp_path: Path) -> None:
    yourdfpy = pytest.importorskip("yourdfpy")
    assert result.arm is not None
    path = exported(result, "urdf", tmp_path)
    np.testing.assert_allclose(through_pinocchio(result, path), wanted(result), atol=SAME)
    robot = yourdfpy.URDF.load(str(path), load_meshes=False, build_collision_scene_graph=False)
    for q, pose in zip(readings(result), wanted(result), strict=True):
        robot.update_cfg(dict(zip(result.arm.model.joints, q, strict=True)))
        np.testing.assert_allclose(robot.get_transform("tip", "base"), pose, atol=SAME)
    # The rest of the file is as it was.
    assert b"package://no such/m \xc3\xbc.stl" in path.read_bytes()


def test_mjcf(result: Result, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    assert result.arm is not None
    model = mujoco.MjModel.from_xml_path(str(exported(result, "mjcf", tmp_path)))
    data = mujoco.MjData(model)
    for q, pose in zip(readings(result), wanted(result), strict=True):
        told = dict(zip(result.arm.model.joints, q, strict=True))
        # MuJoCo keeps a follower by a constraint, which kinematics alone do not heed.
        told["follower"] = -0.5 * told[LONG] + 0.1
        for name, value in told.items():
            data.joint(name).qpos[0] = value
        mujoco.mj_kinematics(model, data)
        site = data.site("tip")
        np.testing.assert_allclose(site.xpos, pose[:3, 3], atol=SAME)
        np.testing.assert_allclose(site.xmat.reshape(3, 3), pose[:3, :3], atol=SAME)
    (row,) = model.eq_data[:, :5]
    np.testing.assert_array_equal(row, [0.1, -0.5, 0, 0, 0])


@pytest.mark.parametrize("convention", ["classic", "modified"])
def test_dh(convention: str, plain: Result, tmp_path: Path) -> None:
    path = exported(plain, "dh", tmp_path, convention=convention)
    poses = read_dh_table(path).poses(readings(plain))
    np.testing.assert_allclose(poses, wanted(plain), atol=SAME)


def as_xacro(result: Result, include: str, folder: Path) -> Path:
    """The nominal URDF, with the macro in place of each origin; run through xacro."""
    xacro = pytest.importorskip("xacro")
    assert result.arm is not None
    text = result.arm.model.chain.path.read_text(encoding="utf-8")
    inside = re.search(r"<robot [^>]*>(.*)</robot>", text, re.DOTALL)
    assert inside is not None
    origin = re.compile(r"(<joint name=(\S[^>]*?) type=.*?)<origin[^>]*/>", re.DOTALL)
    joints = origin.sub(r"\1<xacro:calibrated_origin joint=\2/>", inside[1])
    space = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    file = folder / "arm.xacro"
    head = f'<xacro:include filename="{include}"/>'
    file.write_text(f'<robot name="r" {space}>{head}{joints}</robot>', encoding="utf-8")
    made = file.with_suffix(".urdf")
    made.write_text(xacro.process_file(str(file)).toxml(), encoding="utf-8")
    return made


def test_xacro(plain: Result, tmp_path: Path) -> None:
    path = exported(plain, "xacro", tmp_path)
    made = as_xacro(plain, path.name, tmp_path)
    np.testing.assert_allclose(through_pinocchio(plain, made), wanted(plain), atol=SAME)


def test_xacro_yaml(plain: Result, tmp_path: Path) -> None:
    path = exported(plain, "xacro-yaml", tmp_path)
    assert plain.arm is not None
    moving = [joint for joint in plain.arm.model.chain.joints if joint.moving]
    keys = {joint.child.removesuffix("_link"): joint.name for joint in moving}
    origins = yaml.safe_load(path.read_text(encoding="utf-8"))["kinematics"]
    assert list(origins) == [*keys, "hash"]
    for key, name in keys.items():
        place = [origins[key][number] for number in "xyz"]
        turn = [origins[key][number] for number in ("roll", "pitch", "yaw")]
        expected = plain.arm.origins[name]
        np.testing.assert_allclose(homogeneous(rotation_from_rpy(turn), place), expected, atol=SAME)


@pytest.mark.parametrize("form", ["xacro-patch", "joint-offsets", "numpy", "json"])
def test_other_formats_say_what_they_cannot(form: str, result: Result, tmp_path: Path) -> None:
    """Or hold it: what is written is read again by the plainest reader."""
    assert result.arm is not None
    if form == "xacro-patch":
        path = exported(result, form, tmp_path, source=str(result.arm.model.chain.path))
        assert path.read_bytes().startswith(b"--- a/")
        return
    path = exported(result, form, tmp_path)
    if form == "joint-offsets":
        told = yaml.safe_load(path.read_text(encoding="utf-8"))["joint_offsets"]
        assert list(told) == list(result.arm.model.joints)
        assert told["the 2nd joint"]["offset_m"] == 0.03
        return
    data = json.loads(path.read_text()) if form == "json" else np.load(path, allow_pickle=False)
    assert list(map(str, data["joints"])) == list(result.arm.model.joints)
    origins = dict(zip(map(str, data["origins"]), data["T_parent_joint"], strict=True))
    np.testing.assert_allclose(origins[LONG], result.arm.origins[LONG], atol=1e-15)
