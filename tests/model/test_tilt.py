"""A link that leans by what its sensor felt: poses and their derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from suta_calib import ArmModel
from suta_calib.arrays import FloatArray
from suta_calib.errors import UrdfError
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.model.tilt import TiltSensor
from tests.support.column_robot import SENSORS, column_robot, column_robot_urdf
from tests.support.column_robot import postures as random_postures
from tests.support.torso_robot import torso_robot

ARM = column_robot()
PLAIN = column_robot(sensors=False)
UP = np.array([0.0, 0.0, 1.0])


def postures(n: int, seed: int = 0) -> FloatArray:
    return random_postures(np.random.default_rng(seed), n)


def forward(
    q: FloatArray, felt: FloatArray, values: dict[str, float] | None = None
) -> tuple[FloatArray, FloatArray]:
    return ARM.forward(q, values or {}, {"tilt": felt})


def test_level_links_are_those_of_the_plain_arm() -> None:
    q = postures(5)
    level = np.tile([*UP, *UP], (5, 1))
    np.testing.assert_allclose(forward(q, level)[1], PLAIN.forward(q)[1], atol=1e-15)
    np.testing.assert_array_equal(forward(q, np.zeros((5, 6)))[1], PLAIN.forward(q)[1])
    np.testing.assert_array_equal(ARM.forward(q)[1], PLAIN.forward(q)[1])


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_a_base_turns_about_a_point_on_the_way_to_its_joint(share: float) -> None:
    q, turn = postures(1), np.array([0.002, -0.003, 0.0])
    leaning = rotation_from_vector(turn)
    felt = np.concatenate([leaning.T @ UP, np.zeros(3)])[None]
    rotation, position = forward(q, felt, {"tilt[base_link].share": share})
    R, p = PLAIN.forward(q)
    about = share * np.array([0.1, 0.0, 0.6])
    np.testing.assert_allclose(position[0], about + leaning @ (p[0] - about), atol=1e-9)
    np.testing.assert_allclose(rotation[0], leaning @ R[0], atol=1e-9)


def test_a_second_sensor_adds_what_the_first_has_left() -> None:
    q = postures(4, 1)
    base = rotation_from_vector([0.002, -0.001, 0.0])
    # The column leans as the base does, and no further.
    swing = np.array([rotation_from_vector([0.0, 0.0, a]) for a in q[:, 0]])
    felt = np.hstack([np.tile(base.T @ UP, (4, 1)), (base @ swing).transpose(0, 2, 1) @ UP])
    one = forward(q, np.hstack([felt[:, :3], np.zeros((4, 3))]))
    both = forward(q, felt, {"tilt[column].share": 0.2})
    np.testing.assert_allclose(both[1], one[1], atol=1e-14)


def test_a_turned_sensor_is_read_by_its_turn() -> None:
    q, leaning = postures(2, 2), rotation_from_vector([0.002, -0.003, 0.0])
    straight = np.hstack([np.tile(leaning.T @ UP, (2, 1)), np.zeros((2, 3))])
    turned = np.hstack(
        [np.tile(rotation_from_vector(-0.7 * UP) @ leaning.T @ UP, (2, 1)), np.zeros((2, 3))]
    )
    expected = forward(q, straight)[1]
    found = forward(q, turned, {"tilt[base_link].turn": 0.7})[1]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_the_jacobian_is_that_of_differences() -> None:
    rng = np.random.default_rng(3)
    names = [
        *("swing.rx", "swing.x", "swing.offset", "lift.ry", "lift.offset", "joint_2.rz"),
        *(
            f"tilt[{link}].{key}"
            for link in ("base_link", "column")
            for key in ("share", "turn", "mount_rx", "mount_ry", "mount_rz")
        ),
        *("tilt.up_rx", "tilt.up_ry", "joint_1.ry", "tip.x"),
    ]
    theta = np.array([ARM.offered[n].nominal for n in names])
    theta = theta + 0.05 * rng.standard_normal(len(names))
    q = postures(1, 4)[0]
    felt = rng.standard_normal((2, 3)) * 0.03 + UP
    felt = (felt / np.linalg.norm(felt, axis=1)[:, None]).reshape(6)
    function = ARM.function(names, ["tilt"])
    R, _, J = (np.array(part) for part in function(theta, q, felt))
    R = R.reshape(3, 3, order="F")
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    step = 1e-6
    for k, name in enumerate(names):
        (Ra, pa, _), (Rb, pb, _) = (
            function(theta + s * step * np.eye(len(names))[k], q, felt) for s in (-1, 1)
        )
        Ra, Rb = (np.array(m).reshape(3, 3, order="F") for m in (Ra, Rb))
        spin = (Rb - Ra) / (2 * step) @ R.T
        by_difference = [
            *((np.array(pb) - np.array(pa))[:, 0] / (2 * step)),
            *(spin[2, 1], spin[0, 2], spin[1, 0]),
        ]
        np.testing.assert_allclose(J[k], by_difference, atol=2e-9, err_msg=name)


def test_what_a_sensor_says_replaces_the_lean_of_the_model() -> None:
    """An axis below the column that is not upright leans nothing beyond the column."""
    q = postures(6, 5)
    felt = np.tile([0.0, 0.0, 0.0, *UP], (6, 1))
    names = {"tilt[column].share": 0.0, "swing.rx": 0.002}
    rotation, _ = forward(q, felt, names)
    np.testing.assert_allclose(rotation[:, 2, 2], PLAIN.forward(q)[0][:, 2, 2], atol=1e-5)


def test_refused() -> None:
    with pytest.raises(UrdfError, match=r"colum.*did you mean 'column'"):
        PLAIN.with_tilt_sensors([TiltSensor("colum")])
    with pytest.raises(UrdfError, match="two tilt sensors on column"):
        PLAIN.with_tilt_sensors([TiltSensor("column"), TiltSensor("column")])
    climbing = ArmModel.from_urdf(column_robot_urdf(), "base_link", "tip")
    with pytest.raises(UrdfError, match="begins at another tip"):
        climbing.with_tilt_sensors([SENSORS[1]])
    # What leans the whole of it leans both ends alike.
    assert not climbing.with_tilt_sensors([SENSORS[0]]).tilted


def test_chains_that_share_a_link_lean_about_one_point() -> None:
    robot = torso_robot().with_tilt_sensors([TiltSensor("torso_b"), TiltSensor("left_link_2")])
    left, right = robot.chains.values()
    np.testing.assert_allclose(left.tilted[0].reach, [0.0, 0.0, 0.3], atol=1e-12)
    np.testing.assert_allclose(right.tilted[0].reach, [0.0, 0.0, 0.3], atol=1e-12)
    assert [len(arm.tilted) for arm in robot.at({}).arms] == [2, 1]
    assert "tilt[left_link_2].share" in robot.nongeometric
    with pytest.raises(UrdfError, match="the link 'torso'"):
        torso_robot().with_tilt_sensors([TiltSensor("torso")])
