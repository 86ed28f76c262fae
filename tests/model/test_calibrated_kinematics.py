"""A written URDF, loaded by other libraries, is the calibrated arm for raw readings."""

from __future__ import annotations

import math
import sysconfig
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from suta_calib.geometry.numbers import homogeneous, rotation_from_rpy, rotation_from_vector
from suta_calib.model.arm import ArmModel
from suta_calib.model.chain import ChainJoint, read_chain
from suta_calib.model.urdf import folded_origin, write_urdf

# Numbers of a written URDF are rounded to 1e-12 m or rad; along a chain that adds up.
WRITTEN = 1e-11

AWKWARD = (Path(__file__).parents[1] / "data" / "awkward.urdf").read_bytes().decode()

ROBOTS = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix/share/example-robot-data/robots"
ARMS = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "base_link", "tool0"),
    "panda": ("panda_description/urdf/panda.urdf", "panda_link0", "panda_hand"),
    "z1": ("z1_description/urdf/z1.urdf", "link00", "link06"),
    "tiago": ("tiago_description/robots/tiago.urdf", "torso_fixed_link", "arm_tool_link"),
}


@pytest.fixture(params=ARMS)
def other_arm(request: pytest.FixtureRequest) -> tuple[Path, str, str]:
    """Somebody else's URDF, a base and a tip in it."""
    file, base, tip = ARMS[request.param]
    if not (ROBOTS / file).is_file():
        pytest.skip("example-robot-data is not installed")
    return ROBOTS / file, base, tip


def pinocchio_pose(path: Path, base: str, tip: str, q: dict[str, float]) -> np.ndarray:
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    configuration = pin.neutral(model)
    for name, reading in q.items():
        joint = model.joints[model.getJointId(name)]
        value = [reading] if joint.nq == 1 else [math.cos(reading), math.sin(reading)]
        configuration[joint.idx_q : joint.idx_q + joint.nq] = value
    pin.framesForwardKinematics(model, data, configuration)
    T_root_base, T_root_tip = (data.oMf[model.getFrameId(f, pin.BODY)] for f in (base, tip))
    return np.asarray(T_root_base.actInv(T_root_tip).homogeneous)


def yourdfpy_pose(path: Path, base: str, tip: str, q: dict[str, float]) -> np.ndarray:
    # Meshes' libraries come with it: not in every process that collects this file.
    import yourdfpy

    robot = yourdfpy.URDF.load(str(path), load_meshes=False, build_scene_graph=True)
    robot.update_cfg(q)
    return np.asarray(robot.get_transform(tip, base))


def assert_calibrated(source: Path, base: str | None, tip: str, seed: int) -> None:
    """The arm's own kinematics are Pinocchio's (`test_kinematics`)."""
    arm = ArmModel.from_urdf(source, tip, base)
    rng = np.random.default_rng(seed)
    values = {name: p.nominal + rng.normal(0, 0.2) for name, p in arm.parameters.items()}
    calibrated = source.with_name("calibrated.urdf")
    arm.write_urdf(calibrated, values)
    readings = rng.uniform(-3, 3, (5, len(arm.joints)))
    for row, R, p in zip(readings, *arm.forward(readings, values), strict=True):
        q = dict(zip(arm.joints, row.tolist(), strict=True))
        for pose in (pinocchio_pose, yourdfpy_pose):
            there = pose(calibrated, arm.chain.base, arm.chain.tip_link, q)
            np.testing.assert_allclose(there, homogeneous(R, p), rtol=0, atol=WRITTEN)


@pytest.mark.parametrize("pitch", [None, math.pi / 2, -math.pi / 2, 1.5707963])
def test_gimbal_lock_is_no_obstacle(pitch: float | None, tmp_path: Path) -> None:
    old = "'0  1.50 .5'"
    assert old in AWKWARD
    text = AWKWARD if pitch is None else AWKWARD.replace(old, f"'0.4 {pitch!r} -1.1'")
    (tmp_path / "arm.urdf").write_bytes(text.encode())
    assert_calibrated(tmp_path / "arm.urdf", "base", "tip", seed=1)


def test_other_peoples_arms(other_arm: tuple[Path, str, str], tmp_path: Path) -> None:
    """In their files only origins of the chain change."""
    source, base, tip = other_arm
    (tmp_path / "arm.urdf").write_bytes(source.read_bytes())
    assert_calibrated(tmp_path / "arm.urdf", base, tip, seed=2)
    calibrated = tmp_path / "calibrated.urdf"
    chain = read_chain(source, tip, base)
    origins = {joint.name: (joint.xyz + 0.125, joint.rpy) for joint in chain.joints}
    write_urdf(source, calibrated, origins)
    before, after = (path.read_text().splitlines() for path in (source, calibrated))
    changed = [new for old, new in zip(before, after, strict=True) if old != new]
    assert len(changed) == len(chain.joints)
    assert all("<origin" in line for line in changed)
    reread = read_chain(calibrated, tip, base)
    for nominal, joint in zip(chain.joints, reread.joints, strict=True):
        np.testing.assert_allclose(joint.xyz, nominal.xyz + 0.125, rtol=0, atol=0.51e-12)
        np.testing.assert_array_equal(joint.rpy, nominal.rpy)


ANGLE = st.floats(-math.pi, math.pi)
ANGLES = st.tuples(ANGLE, ANGLE, ANGLE)
PITCH = st.one_of(ANGLE, st.sampled_from([math.pi / 2, -math.pi / 2]))


@given(
    kind=st.sampled_from(["revolute", "continuous", "prismatic", "fixed"]),
    rpy=st.tuples(PITCH, PITCH, PITCH),
    vector=ANGLES,
    axis=ANGLES.filter(lambda axis: np.linalg.norm(axis) > 0.01),
    offset=ANGLE,
)
def test_the_folded_origin_is_the_calibrated_frame_at_reading_zero(
    kind: str,
    rpy: tuple[float, ...],
    vector: tuple[float, ...],
    axis: tuple[float, ...],
    offset: float,
) -> None:
    unit, place = np.array(axis) / np.linalg.norm(axis), np.array([0.1, 0.2, 0.3])
    joint = ChainJoint("j", kind, "a", "b", np.zeros(3), np.array(rpy), unit, 0.0, 0.0, 1)
    xyz, folded = folded_origin(joint, place, vector, offset)
    expected = homogeneous(rotation_from_rpy(rpy) @ rotation_from_vector(vector), place)
    if kind == "prismatic":
        expected = expected @ homogeneous(np.eye(3), unit * offset)
    elif joint.moving:
        turn = Rotation.from_rotvec(unit * offset).as_matrix()
        expected = expected @ homogeneous(turn, np.zeros(3))
    np.testing.assert_allclose(homogeneous(rotation_from_rpy(folded), xyz), expected, atol=1e-13)


@pytest.mark.parametrize(("kind", "offset"), [("prismatic", 0.5), ("revolute", 0.0)])
def test_what_does_not_turn_keeps_its_angles_exactly(kind: str, offset: float) -> None:
    rpy = np.array([4.0, math.pi / 2, -7.0])
    joint = ChainJoint("j", kind, "a", "b", np.zeros(3), rpy, np.eye(3)[0], 0.0, 1.0, 1)
    np.testing.assert_array_equal(folded_origin(joint, np.ones(3), np.zeros(3), offset)[1], rpy)
