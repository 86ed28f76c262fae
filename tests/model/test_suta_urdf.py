"""The SUTA's URDF against the Denavit-Hartenberg table it was written from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

# theta offset (deg), d (m), a (m), alpha (deg); classic convention Rz Tz Tx Rx.
DH_TABLE = np.array(
    [
        [-1.6, 0.047, 0.0, 90.0],
        [20.7, 0.0, 0.0, 90.0],
        [201.3, 0.571, 0.0, -90.0],
        [117.1, 0.0, 0.0, 90.0],
        [88.7, 0.371, 0.0, 90.0],
        [-11.6, 0.0, 0.0, 90.0],
    ]
)
TOOL_LENGTH = 0.253
JOINTS = tuple(f"joint_{i}" for i in range(1, 7))
READINGS = np.random.default_rng(0).uniform(-np.pi, np.pi, (50, 6))


def dh_row(theta: float, d: float, a: float, alpha: float) -> np.ndarray:
    """One row's transform as the textbook prints it, so that nothing is shared with the package."""
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array(
        [
            [ct, -st * ca, st * sa, a * ct],
            [st, ct * ca, -ct * sa, a * st],
            [0.0, sa, ca, d],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def dh_product(q: np.ndarray) -> np.ndarray:
    """T_base_tip of the table."""
    pose = np.eye(4)
    for reading, (offset, d, a, alpha) in zip(q, DH_TABLE, strict=True):
        pose = pose @ dh_row(reading + np.deg2rad(offset), d, a, np.deg2rad(alpha))
    tool = np.eye(4)
    tool[2, 3] = TOOL_LENGTH
    return pose @ tool


@pytest.fixture(scope="module")
def model(suta_urdf: Path) -> pin.Model:
    return pin.buildModelFromUrdf(str(suta_urdf))


def pinocchio_pose(model: pin.Model, q: np.ndarray) -> np.ndarray:
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[model.getFrameId("tip")].homogeneous


def test_pinocchio_agrees_with_the_dh_table(model: pin.Model) -> None:
    for q in READINGS:
        np.testing.assert_allclose(pinocchio_pose(model, q), dh_product(q), rtol=0, atol=1e-12)


def test_yourdfpy_agrees_with_the_dh_table(suta_urdf: Path) -> None:
    import yourdfpy

    robot = yourdfpy.URDF.load(suta_urdf)
    assert robot.validate()
    for q in READINGS[:10]:
        robot.update_cfg(dict(zip(JOINTS, q, strict=True)))
        pose = robot.get_transform("tip", "base_link")
        np.testing.assert_allclose(pose, dh_product(q), rtol=0, atol=1e-12)


def test_joints_are_revolute_about_z_over_one_turn(model: pin.Model) -> None:
    assert tuple(model.names)[1:] == JOINTS
    assert {joint.shortname() for joint in list(model.joints)[1:]} == {"JointModelRZ"}
    np.testing.assert_array_equal(model.lowerPositionLimit, np.full(6, -np.pi))
    np.testing.assert_array_equal(model.upperPositionLimit, np.full(6, np.pi))


def test_link_lengths_stand_where_parameter_names_expect_them(model: pin.Model) -> None:
    positions = [placement.translation for placement in list(model.jointPlacements)[1:]]
    tip = model.frames[model.getFrameId("tip")].placement.translation
    expected = np.zeros((7, 3))
    expected[[1, 3, 5], 2] = 0.047, 0.571, 0.371  # joint_2.z, joint_4.z, joint_6.z
    expected[6, 1] = -0.253  # tip.y
    np.testing.assert_allclose([*positions, tip], expected, rtol=0, atol=1e-16)


def test_inertias_are_those_of_bodies(model: pin.Model) -> None:
    for inertia in list(model.inertias)[1:]:
        moments = np.linalg.eigvalsh(inertia.inertia)
        assert inertia.mass > 0
        assert moments[0] > 0
        assert moments[2] <= moments[0] + moments[1]
