"""The symbolic kinematics against Pinocchio's own, and against differences.

Pinocchio is told the changed geometry by setting its joint placements: nothing of the symbolic
chain takes part in that.
"""

from __future__ import annotations

import contextlib
import math
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from simulated import ARMS, arm_named, perturbed, random_readings

from suta_calib.batched import MANY
from suta_calib.errors import ParameterError, UrdfError
from suta_calib.model.arm import ArmModel
from suta_calib.model.chain import ChainJoint
from suta_calib.model.parameters import COMPLIANCE, Selection

AXES = ("x", "y", "z")
GEOMETRIES = {"nominal": 0.0, "perturbed": 0.15}


@pytest.fixture(params=ARMS)
def arm(request: pytest.FixtureRequest) -> ArmModel:
    return arm_named(request.param)


def tip_is_fixed(arm: ArmModel) -> bool:
    return not arm.chain.joints[-1].moving


def values_of(arm: ArmModel, size: float, names: list[str]) -> dict[str, float]:
    parameters = arm.select(*names)
    return perturbed(parameters, seed=1, length=size, angle=size)


def known_names(arm: ArmModel) -> list[str]:
    """Every parameter Pinocchio can be told: those of moving joints and of the tip's own joint."""
    owners = {j.name for j in arm.chain.moving} | {arm.tip}
    return [name for name, p in arm.parameters.items() if p.owner in owners]


def origin(joint: ChainJoint, prefix: str, values: dict[str, float]) -> pin.SE3:
    """The joint's origin in its parent link by definition."""
    xyz = [values.get(f"{prefix}.{k}", joint.xyz[i]) for i, k in enumerate(AXES)]
    r = np.array([values.get(f"{prefix}.r{k}", 0.0) for k in AXES])
    return pin.SE3(pin.rpy.rpyToMatrix(joint.rpy) @ pin.exp3(r), np.array(xyz))


def told(arm: ArmModel, values: dict[str, float]) -> pin.Model:
    """Pinocchio's model with the changed geometry in its placements, offsets left out."""
    model = arm.model.copy()
    for joint in arm.chain.joints:
        parent = model.frames[model.getFrameId(joint.parent, pin.FrameType.BODY)].placement
        if joint.moving:
            placement = parent * origin(joint, joint.name, values)
            model.jointPlacements[model.getJointId(joint.name)] = placement
    if tip_is_fixed(arm):
        last = arm.chain.joints[-1]
        parent = model.frames[model.getFrameId(last.parent, pin.FrameType.BODY)].placement
        frame = model.getFrameId(arm.chain.tip_link, pin.FrameType.BODY)
        model.frames[frame].placement = parent * origin(last, arm.tip, values)
    return model


def at(
    arm: ArmModel, model: pin.Model, q: np.ndarray, values: dict[str, float]
) -> tuple[pin.Data, int]:
    """Pinocchio's data at readings plus offsets, and the number of the tip's frame."""
    configuration = pin.neutral(model)
    for name, reading in zip(arm.joints, q, strict=True):
        joint = model.joints[model.getJointId(name)]
        moved = reading + values.get(f"{name}.offset", 0.0)
        state = [moved] if joint.nq == 1 else [math.cos(moved), math.sin(moved)]
        configuration[joint.idx_q : joint.idx_q + joint.nq] = state
    data = model.createData()
    pin.computeJointJacobians(model, data, configuration)
    pin.updateFramePlacements(model, data)
    return data, model.getFrameId(arm.chain.tip_link, pin.FrameType.BODY)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_forward_kinematics_are_pinocchios(arm: ArmModel, geometry: str) -> None:
    values = values_of(arm, GEOMETRIES[geometry], known_names(arm))
    model = told(arm, values)
    readings = random_readings(arm, np.random.default_rng(2), 20)
    for q, R, p in zip(readings, *arm.forward(readings, values), strict=True):
        data, frame = at(arm, model, q, values)
        np.testing.assert_allclose(R, data.oMf[frame].rotation, rtol=0, atol=1e-12)
        np.testing.assert_allclose(p, data.oMf[frame].translation, rtol=0, atol=1e-12)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_the_symbols_are_those_of_pinocchio_with_casadi(arm: ArmModel, geometry: str) -> None:
    """Both symbolic, where Pinocchio is built with CasADi: conda-forge's is, the wheel is not.

    The pose, and how its position changes with every offset.
    """
    symbolic = pytest.importorskip("pinocchio.casadi")
    values = values_of(arm, GEOMETRIES[geometry], known_names(arm))
    model = symbolic.Model(told(arm, values))
    data, turns = model.createData(), ca.SX.sym("turns", len(arm.joints))
    configuration = ca.SX(pin.neutral(arm.model))
    for k, name in enumerate(arm.joints):
        joint = arm.model.joints[arm.model.getJointId(name)]
        state = [turns[k]] if joint.nq == 1 else [ca.cos(turns[k]), ca.sin(turns[k])]
        configuration[joint.idx_q : joint.idx_q + joint.nq] = ca.vertcat(*state)
    symbolic.framesForwardKinematics(model, data, configuration)
    tip = data.oMf[arm.model.getFrameId(arm.chain.tip_link, pin.FrameType.BODY)]
    outputs = [ca.vec(tip.rotation), tip.translation, ca.jacobian(tip.translation, turns)]
    theirs = ca.Function("theirs", [turns], outputs)
    names = [f"{name}.offset" for name in arm.joints]
    ours = arm.at(values).function(names)
    offsets = np.array([values.get(name, 0.0) for name in names])
    for q in random_readings(arm, np.random.default_rng(5), 5):
        R, p, by_offset = ours(offsets, q)
        for found, expected in zip((R, p, by_offset[:, :3].T), theirs(q + offsets), strict=True):
            np.testing.assert_allclose(np.array(found), np.array(expected), rtol=0, atol=1e-12)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_the_jacobian_is_the_derivative_of_the_pose(arm: ArmModel, geometry: str) -> None:
    """Every parameter there is, those of fixed joints within the chain included."""
    names = list(arm.parameters)
    values = values_of(arm, GEOMETRIES[geometry], names)
    theta = np.array([values[name] for name in names])
    function = arm.function(names)
    q = random_readings(arm, np.random.default_rng(4), 1)[0]
    found = np.array(function(theta, q)[2]).T
    for k, name in enumerate(names):
        step = 1e-5 * (np.arange(len(theta)) == k)
        (R0, p0), (R, _), (R1, p1) = (
            _pose(function(theta + s, q)) for s in (-step, 0 * step, step)
        )
        spin = (R1 - R0) / 2e-5 @ R.T
        expected = [*(p1 - p0) / 2e-5, spin[2, 1], spin[0, 2], spin[1, 0]]
        np.testing.assert_allclose(found[:, k], expected, atol=2e-9, err_msg=name)


def _pose(outputs: tuple[object, ...]) -> tuple[np.ndarray, np.ndarray]:
    return np.array(outputs[0]).reshape(3, 3, order="F"), np.array(outputs[1]).reshape(3)


def test_the_jacobian_may_have_fewer_rows(arm: ArmModel) -> None:
    """Those of the first parameters, or none: the pose does not notice."""
    names = known_names(arm)
    values = values_of(arm, 0.15, names)
    theta = [values[name] for name in names]
    (q,) = random_readings(arm, np.random.default_rng(3), 1)
    R, p, J = (each.full() for each in arm.function(names)(theta, q))
    for rows in (0, 2):
        R_alone, p_alone, first = arm.function(names, rows=rows)(theta, q)
        np.testing.assert_array_equal(R_alone.full(), R)
        np.testing.assert_array_equal(p_alone.full(), p)
        np.testing.assert_allclose(first.full().reshape(rows, 6), J[:rows], rtol=1e-14)


def test_unknown_parameters_and_wrong_readings_are_refused() -> None:
    arm = arm_named("suta")
    with pytest.raises(ParameterError, match=r"joint_1\.offset"):
        arm.function(["joint_1.ofset"])
    with pytest.raises(ParameterError, match="5 joints"):
        arm.forward(np.zeros((2, 5)))


def test_parameters_of_other_things_are_ignored() -> None:
    arm = arm_named("suta")
    q = np.full(6, 0.3)
    R, p = arm.forward(q, {"placement[P1].x": 5.0})
    np.testing.assert_array_equal(R, arm.forward(q)[0])
    np.testing.assert_array_equal(p, arm.forward(q)[1])


def random_values(arm: ArmModel, rng: np.random.Generator) -> dict[str, float]:
    """Everything off: placements, offsets, eccentricities, compliances where there are masses."""
    values = {}
    for name, p in arm.offered.items():
        size = 1e-3 if p.key == COMPLIANCE else 0.1
        with contextlib.suppress(UrdfError):
            arm.select(name)
            values[name] = p.nominal + size * rng.standard_normal()
    return values


def test_an_arm_at_other_values_is_the_arm_with_these_values(arm: ArmModel) -> None:
    rng = np.random.default_rng(7)
    values = random_values(arm, rng)
    q = random_readings(arm, rng, 10)
    there = arm.at(values | {"placement[P1].x": 3.0})
    for found, expected in zip(there.forward(q), arm.forward(q, values), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    # From there on as from here: other values, and zero where it is not nominal any more.
    other = random_values(arm, rng) | dict.fromkeys(arm.nongeometric, 0.0)
    for found, expected in zip(there.forward(q, other), arm.forward(q, other), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    assert arm.forward(q)[1] != pytest.approx(there.forward(q)[1], abs=1e-3)


def test_an_arm_at_other_values_has_the_same_derivatives(arm: ArmModel) -> None:
    rng = np.random.default_rng(8)
    values = random_values(arm, rng)
    asked = [*rng.permutation(list(values))[:12]]
    x = [values[name] for name in asked]
    all_there = [values[name] for name in values]
    rows = [list(values).index(name) for name in asked]
    for q in random_readings(arm, rng, 3):
        found = np.array(arm.at(values).function(asked)(x, q)[2])
        expected = np.array(arm.function(list(values))(all_there, q)[2])[rows]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_an_arm_at_other_values_writes_them(tmp_path: Path) -> None:
    arm = arm_named("suta")
    values = values_of(arm, 0.05, known_names(arm))
    arm.write_urdf(tmp_path / "one.urdf", values)
    arm.at(values).write_urdf(tmp_path / "other.urdf", {})
    assert (tmp_path / "one.urdf").read_bytes() == (tmp_path / "other.urdf").read_bytes()
    chosen = arm.at(values).select(Selection(("*.offset",), bound_rad=0.1))
    assert chosen["joint_2.offset"].upper == pytest.approx(values["joint_2.offset"] + 0.1)


def test_arms_that_are_alike_share_their_kinematics(suta_urdf: Path) -> None:
    first, again = (ArmModel.from_urdf(suta_urdf, "tip") for _ in range(2))
    names = ["joint_2.offset", "joint_4.z"]
    assert first.function(names) is again.function(names)
    longer = again.at({"joint_3.z": 0.5})
    assert longer.function(names) is not first.function(names)
    assert not np.allclose(longer.forward(np.zeros(6))[1], first.forward(np.zeros(6))[1])


def test_many_rows_lie_where_each_lies_by_itself(arm: ArmModel) -> None:
    values = values_of(arm, 0.1, ["*"])
    q = random_readings(arm, np.random.default_rng(0), MANY)
    rotation, position = arm.forward(q, values)
    for row in range(0, MANY, 50):
        alone = arm.forward(q[row], values)
        np.testing.assert_allclose(rotation[row], alone[0], atol=1e-14)
        np.testing.assert_allclose(position[row], alone[1], atol=1e-14)
