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

from suta_calib.geometry.numbers import rotation_from_rpy, rotation_from_vector
from suta_calib.model.chain import Chain, ChainJoint, read_chain
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

Changes = dict[str, tuple[np.ndarray, np.ndarray, float]]


@pytest.fixture
def awkward(tmp_path: Path) -> Path:
    path = tmp_path / "arm.urdf"
    path.write_bytes(AWKWARD.encode())
    return path


@pytest.fixture(params=ARMS)
def other_arm(request: pytest.FixtureRequest) -> tuple[Path, str, str]:
    """Somebody else's URDF, a base and a tip in it."""
    file, base, tip = ARMS[request.param]
    if not (ROBOTS / file).is_file():
        pytest.skip("example-robot-data is not installed")
    return ROBOTS / file, base, tip


def pose(rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position
    return matrix


def motion(joint: ChainJoint, reading: float) -> np.ndarray:
    if joint.type == "prismatic":
        return pose(np.eye(3), joint.axis * reading)
    return pose(Rotation.from_rotvec(joint.axis * reading).as_matrix(), np.zeros(3))


def calibrated_pose(chain: Chain, changes: Changes, q: dict[str, float]) -> np.ndarray:
    """T_base_tip by definition: nominal rotation, then exp(r), then the motion by q + offset."""
    T_base_tip = np.eye(4)
    for joint in chain.joints:
        xyz, vector, offset = changes[joint.name]
        nominal = Rotation.from_euler("xyz", joint.rpy).as_matrix()
        turned = nominal @ Rotation.from_rotvec(vector).as_matrix()
        T_base_tip = T_base_tip @ pose(turned, xyz)
        if joint.moving:
            T_base_tip = T_base_tip @ motion(joint, q[joint.name] + offset)
    return T_base_tip


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


def random_changes(chain: Chain, rng: np.random.Generator, size: float) -> Changes:
    return {
        joint.name: (
            joint.xyz + rng.normal(0, size, 3),
            rng.normal(0, size, 3),
            float(rng.normal(0, size)) if joint.moving else 0.0,
        )
        for joint in chain.joints
    }


def assert_calibrated(source: Path, base: str | None, tip: str, seed: int) -> None:
    """The written file's kinematics on raw readings are the calibrated ones, in two libraries."""
    chain = read_chain(source, tip, base)
    rng = np.random.default_rng(seed)
    changes = random_changes(chain, rng, size=0.2)
    calibrated = source.with_name("calibrated.urdf")
    origins = {joint.name: folded_origin(joint, *changes[joint.name]) for joint in chain.joints}
    write_urdf(source, calibrated, origins)
    for _ in range(5):
        q = {joint.name: float(rng.uniform(-3, 3)) for joint in chain.moving}
        expected = calibrated_pose(chain, changes, q)
        for poses in (pinocchio_pose, yourdfpy_pose):
            found = poses(calibrated, chain.base, chain.tip_link, q)
            np.testing.assert_allclose(found, expected, rtol=0, atol=WRITTEN, err_msg=str(poses))


def test_pinocchio_and_yourdfpy_load_the_calibrated_arm(awkward: Path) -> None:
    assert_calibrated(awkward, None, "tip", seed=0)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2, 1.5707963])
def test_gimbal_lock_is_no_obstacle(awkward: Path, pitch: float) -> None:
    text = AWKWARD.replace("'0  1.50 .5'", f"'0.4 {pitch!r} -1.1'")
    assert text != AWKWARD
    awkward.write_bytes(text.encode())
    assert_calibrated(awkward, "base", "tip", seed=1)


def test_other_peoples_arms(other_arm: tuple[Path, str, str], tmp_path: Path) -> None:
    file, base, tip = other_arm
    source = tmp_path / "arm.urdf"
    source.write_bytes(file.read_bytes())
    assert_calibrated(source, base, tip, seed=2)


def test_in_other_peoples_files_only_origins_of_the_chain_change(
    other_arm: tuple[Path, str, str], tmp_path: Path
) -> None:
    source, base, tip = other_arm
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


def triple(elements: st.SearchStrategy[float]) -> st.SearchStrategy[tuple[float, ...]]:
    return st.tuples(elements, elements, elements)


@given(
    kind=st.sampled_from(["revolute", "continuous", "prismatic", "fixed"]),
    rpy=triple(st.one_of(ANGLE, st.sampled_from([math.pi / 2, -math.pi / 2]))),
    vector=triple(ANGLE),
    axis=triple(ANGLE).filter(lambda axis: np.linalg.norm(axis) > 0.01),
    offset=ANGLE,
)
def test_the_folded_origin_is_the_calibrated_frame_at_reading_zero(
    kind: str,
    rpy: tuple[float, ...],
    vector: tuple[float, ...],
    axis: tuple[float, ...],
    offset: float,
) -> None:
    unit = np.array(axis) / np.linalg.norm(axis)
    joint = ChainJoint("j", kind, "a", "b", np.zeros(3), np.array(rpy), unit, 0.0, 0.0, 1)
    xyz, folded = folded_origin(joint, [0.1, 0.2, 0.3], vector, offset)
    frame = pose(rotation_from_rpy(rpy) @ rotation_from_vector(vector), np.array([0.1, 0.2, 0.3]))
    expected = frame @ motion(joint, offset) if joint.moving else frame
    np.testing.assert_allclose(pose(rotation_from_rpy(folded), xyz), expected, atol=1e-13)


def test_what_does_not_turn_keeps_its_angles_exactly() -> None:
    rpy = np.array([4.0, math.pi / 2, -7.0])
    slide = ChainJoint("j", "prismatic", "a", "b", np.zeros(3), rpy, np.eye(3)[0], 0.0, 1.0, 1)
    np.testing.assert_array_equal(folded_origin(slide, np.ones(3), np.zeros(3), 0.5)[1], rpy)
    turn = ChainJoint("j", "revolute", "a", "b", np.zeros(3), rpy, np.eye(3)[0], 0.0, 1.0, 1)
    np.testing.assert_array_equal(folded_origin(turn, np.ones(3), np.zeros(3), 0.0)[1], rpy)
