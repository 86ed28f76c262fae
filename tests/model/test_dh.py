"""DH tables against Pinocchio, both ways, for any chain; and the thesis' two readings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from suta_calib import ArmModel
from suta_calib.errors import InputError, UrdfError
from suta_calib.job import dh_text, read_dh_table
from suta_calib.model import DhRow, DhTable, dh_table

REPOSITORY = Path(__file__).parents[2]
READINGS = np.random.default_rng(0).uniform(-3, 3, (5, 6))
# Tables 3.2 and 4.2 of the thesis: theta (deg), d (m), alpha (deg); a is 0 throughout.
TABLES = {
    "suta": (
        [-1.6, 20.7, 201.3, 117.1, 88.7, -11.6],
        [0.047, 0, 0.571, 0, 0.371, 0],
        [90, 90, -90, 90, 90, 90],
        0.253,
    ),
    "suta_table_4_2": (
        [2.54, 21.28, 200.44, 115.46, 86.23, -9.88],
        [0.047, 0, 0.571, 0, 0.361, 0],
        [90, 90, -90, 90, 90, 0],
        0.254,
    ),
}
ROTATIONS = st.sampled_from([-180.0, -90.0, 0.0, 90.0, 180.0]) | st.floats(-170, 170)
LENGTHS = st.just(0.0) | st.floats(0.02, 0.6) | st.floats(-0.6, -0.02)
# Lines nearly parallel have their normal far away, and rounding grows with its distance.
TWISTS = st.sampled_from([-180.0, -90.0, 0.0, 90.0, 180.0]) | st.floats(5, 175)
ROWS = st.lists(
    st.tuples(st.sampled_from(["revolute", "prismatic"]), ROTATIONS, LENGTHS, LENGTHS, TWISTS),
    min_size=1,
    max_size=7,
)


def textbook(theta: float, d: float, a: float, alpha: float) -> np.ndarray:
    """One classic row's transform as it is printed, so that nothing is shared with the package."""
    ct, st_, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    rows = [[ct, -st_ * ca, st_ * sa, a * ct], [st_, ct * ca, -ct * sa, a * st_]]
    return np.array([*rows, [0.0, sa, ca, d], [0.0, 0.0, 0.0, 1.0]])


def published(name: str) -> DhTable:
    theta, d, alpha, tool = TABLES[name]
    rows = [
        DhRow(f"joint_{k + 1}", "revolute", *np.radians([t]), length, 0.0, *np.radians([twist]))
        for k, (t, length, twist) in enumerate(zip(theta, d, alpha, strict=True))
    ]
    return DhTable("classic", (*rows, DhRow("tip", "fixed", 0.0, tool, 0.0, 0.0)))


def cells(table: DhTable) -> np.ndarray:
    return np.array([[r.theta, r.d, r.a, r.alpha] for r in table.rows])


def pinocchio_poses(file: Path, q: np.ndarray) -> np.ndarray:
    """By the URDF itself, with nothing of the package in between."""
    model = pin.buildModelFromUrdf(str(file))
    data, poses = model.createData(), []
    frame = model.getFrameId("tip")
    for row in q:
        full = []
        for joint, reading in zip(list(model.joints)[1:], row, strict=True):
            full += [np.cos(reading), np.sin(reading)] if joint.nq == 2 else [reading]
        pin.framesForwardKinematics(model, data, np.array(full))
        poses.append(data.oMf[frame].homogeneous)
    return np.array(poses)


@pytest.mark.parametrize("name", TABLES)
def test_a_shipped_arm_has_the_table_it_was_written_from(name: str):
    arm, table = ArmModel.from_urdf(REPOSITORY / f"urdf/{name}.urdf", "tip"), published(name)
    found = dh_table(arm, like=table)
    assert found.joints == table.joints
    np.testing.assert_allclose(cells(found), cells(table), rtol=0, atol=1e-12)
    poses = pinocchio_poses(arm.chain.path, READINGS)
    np.testing.assert_allclose(table.poses(READINGS), poses, rtol=0, atol=1e-12)
    product = np.eye(4)
    for row, angle in zip(table.rows, [*READINGS[0], 0.0], strict=True):
        product = product @ textbook(row.theta + angle, row.d, row.a, row.alpha)
    np.testing.assert_allclose(product, poses[0], rtol=0, atol=1e-12)


def test_the_sutas_urdf_is_as_its_parameter_names_expect(suta_urdf: Path) -> None:
    """Joints turn about z over one turn, lengths stand where they are looked for, bodies exist."""
    import yourdfpy

    robot = yourdfpy.URDF.load(suta_urdf)
    assert robot.validate()
    for q, pose in zip(READINGS, published("suta").poses(READINGS), strict=True):
        robot.update_cfg({f"joint_{k}": angle for k, angle in enumerate(q, 1)})
        there = robot.get_transform("tip", "base_link")
        np.testing.assert_allclose(there, pose, rtol=0, atol=1e-12)
    model = pin.buildModelFromUrdf(str(suta_urdf))
    assert {joint.shortname() for joint in list(model.joints)[1:]} == {"JointModelRZ"}
    np.testing.assert_array_equal(model.lowerPositionLimit, np.full(6, -np.pi))
    np.testing.assert_array_equal(model.upperPositionLimit, np.full(6, np.pi))
    lengths = {n: p.nominal for n, p in ArmModel.from_urdf(suta_urdf, "tip").parameters.items()}
    expected = {"joint_2.z": 0.047, "joint_4.z": 0.571, "joint_6.z": 0.371, "tip.y": -0.253}
    assert {n: length for n, length in lengths.items() if abs(length) > 1e-16} == expected
    for inertia in list(model.inertias)[1:]:
        moments = np.linalg.eigvalsh(inertia.inertia)
        assert inertia.mass > 0
        assert moments[0] > 0
        assert moments[2] <= moments[0] + moments[1]


def test_an_offset_is_an_angle_and_a_length_a_d():
    arm = ArmModel.from_urdf(REPOSITORY / "urdf/suta.urdf", "tip")
    nominal = published("suta")
    values = {"joint_3.offset": 0.02, "joint_6.z": 0.361, "tip.y": -0.254}
    changed = cells(dh_table(arm, values, like=nominal)) - cells(nominal)
    expected = np.zeros_like(changed)
    expected[2, 0], expected[4, 1], expected[6, 1] = 0.02, -0.01, 0.001
    np.testing.assert_allclose(changed, expected, rtol=0, atol=1e-12)


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(rows=ROWS, modified=st.booleans(), seed=st.integers(0, 2**32 - 1))
def test_any_chain_there_and_back(
    rows: list[tuple], modified: bool, seed: int, tmp_path: Path
) -> None:
    made = [
        DhRow(f"j{k}", motion, np.radians(t), d, a, np.radians(alpha))
        for k, (motion, t, d, a, alpha) in enumerate(rows)
    ]
    ends = [DhRow(end, "fixed", 0.3, 0.1, -0.2, 0.7) for end in ("base", "tip")]
    table = DhTable("modified" if modified else "classic", (ends[0], *made, ends[1]))
    file = tmp_path / "arm.urdf"
    file.write_text(table.urdf())
    arm = ArmModel.from_urdf(file, "tip")
    q = np.random.default_rng(seed).uniform(-1, 1, (3, len(made)))
    poses = pinocchio_poses(file, q)
    np.testing.assert_allclose(table.poses(q), poses, rtol=0, atol=1e-12)
    for convention in ("classic", "modified"):
        again = dh_table(arm, convention=convention)
        assert again.joints == arm.joints
        np.testing.assert_allclose(again.poses(q), poses, rtol=0, atol=1e-12)


@pytest.mark.parametrize("convention", ["classic", "modified"])
def test_a_file_holds_a_table(convention: str, tmp_path: Path):
    arm = ArmModel.from_urdf(REPOSITORY / "urdf/suta.urdf", "tip")
    table = dh_table(arm, convention=convention)
    file = tmp_path / "dh.csv"
    file.write_text(dh_text(table))
    again = read_dh_table(file)
    assert again.convention == convention
    np.testing.assert_allclose(cells(again), cells(table), rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("joint,theta_deg,d_mm,a_mm\nj,0,0,0\n", "a column alpha_deg or alpha_rad"),
        (
            "joint,theta_deg,d_mm,d_m,a_mm,alpha_deg\nj,0,0,0,0,0\n",
            "found the columns d_m and d_mm",
        ),
        ("joint,theta_deg,d_mm,a_mm,alpha_prev_deg\nj,0,0,0,0\n", "a and alpha of one convention"),
        ("joint,theta_deg,d_mm,a_mm,alpha_deg\nj,0,nan,0,0\n", "dh.csv:2: column 'd_mm'"),
        ("joint,type,theta_deg,d_mm,a_mm,alpha_deg\nj,R,0,0,0,0\n", "revolute, prismatic, fixed"),
        ("joint,theta_deg,d_mm,a_mm,alpha_deg\nj,0,0,0,0\nj,0,0,0,0\n", "the joint 'j' twice"),
        ("joint,type,theta_deg,d_mm,a_mm,alpha_deg\nj,fixed,0,0,0,0\n", "without moving joints"),
    ],
)
def test_what_is_no_table_is_refused_by_name(text: str, said: str, tmp_path: Path):
    file = tmp_path / "dh.csv"
    file.write_text(text)
    with pytest.raises(InputError) as refused:
        read_dh_table(file)
    assert said in str(refused.value)
    assert str(file) in str(refused.value)


def test_another_arms_table_is_no_guide():
    arm = ArmModel.from_urdf(REPOSITORY / "urdf/suta.urdf", "tip")
    other = DhTable("classic", (DhRow("elbow", "revolute", 0.0, 0.0, 0.0, 0.0),))
    with pytest.raises(UrdfError, match=r"joints elbow; expected a table of the same joints"):
        dh_table(arm, like=other)
